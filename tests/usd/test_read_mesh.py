import numpy as np
import pytest
import warp.examples
from pxr import Usd, UsdGeom
from stage_text import QUAD, scene_of

from warp_smoke.geometry import Mesh, corner_normals
from warp_smoke.record import Samples
from warp_smoke.scene import Scene
from warp_smoke.usd.read import read_stage

ASSETS = warp.examples.get_asset_directory()


def mesh_of(folder, prim):
    """The mesh of the only surface."""
    (surface,) = scene_of(folder, prim).surfaces
    return surface.mesh


def face_normals(mesh):
    """Unit normal of each triangle, [m, 3]."""
    return corner_normals(mesh.points, mesh.triangles)[:, 0]


def test_quad_becomes_two_triangles(tmp_path):
    """A square without normals and texture coordinates: a fan, faceted."""
    mesh = mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} }}')
    assert mesh == Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def test_left_handed_orientation_turns_the_triangles(tmp_path):
    """Points listed clockwise on a left-handed mesh face the same way as counter-clockwise ones on a right-handed."""
    mesh = mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} \n uniform token orientation = "leftHanded" }}')
    assert np.allclose(face_normals(mesh), (0, 0, -1))


def test_holes_are_left_out(tmp_path):
    """A face named in holeIndices gives no triangle."""
    mesh = mesh_of(
        tmp_path,
        """def Mesh "A" {
        int[] faceVertexCounts = [4, 3, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 2, 0, 4, 1]
        int[] holeIndices = [0, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)]
        uniform token subdivisionScheme = "none"
        }""",
    )
    assert np.array_equal(mesh.triangles, [[1, 4, 2]])


@pytest.mark.parametrize(
    ("interpolation", "values", "at_corners"),
    [
        ("constant", "(5, 6)", [[5, 5, 5], [5, 5, 5]]),
        ("uniform", "(7, 6)", [[7, 7, 7], [7, 7, 7]]),
        ("vertex", "(0, 9), (1, 9), (2, 9), (3, 9)", [[0, 1, 2], [0, 2, 3]]),
        ("varying", "(0, 9), (1, 9), (2, 9), (3, 9)", [[0, 1, 2], [0, 2, 3]]),
        ("faceVarying", "(4, 9), (5, 9), (6, 9), (7, 9)", [[4, 5, 6], [4, 6, 7]]),
    ],
)
def test_texture_coordinates_by_interpolation(tmp_path, interpolation, values, at_corners):
    """`st` reaches the triangles' corners, whatever its interpolation."""
    st = f'texCoord2f[] primvars:st = [{values}] ( interpolation = "{interpolation}" )'
    assert np.array_equal(mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} {st} }}').uvs[..., 0], at_corners)


def test_indexed_texture_coordinates(tmp_path):
    """An indexed primvar is looked up by its indices."""
    st = """texCoord2f[] primvars:st = [(0, 0), (1, 1)] ( interpolation = "faceVarying" )
    int[] primvars:st:indices = [1, 0, 0, 1]"""
    mesh = mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} {st} }}')
    assert np.array_equal(mesh.uvs[..., 1], [[1, 0, 0], [1, 0, 1]])


def test_first_pair_of_numbers_stands_in_for_st(tmp_path):
    """Without `st`, another pair is taken; colours are not; and `st` wins over it wherever it stands."""
    other = 'float2[] primvars:UVMap = [(8, 8)] ( interpolation = "constant" )'
    color = "color3f[] primvars:displayColor = [(1, 1, 1)]"
    st = 'texCoord2f[] primvars:st = [(3, 3)] ( interpolation = "constant" )'
    assert np.all(mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} {color}\n{other} }}').uvs == 8)
    assert np.all(mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} {other}\n{st} }}').uvs == 3)
    assert mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} {color} }}').uvs is None


def test_authored_normals_are_made_unit(tmp_path):
    """A long normal is normalized, a unit one keeps its bits, one of length zero becomes the face's."""
    normals = 'normal3f[] normals = [(0, 3, 0), (0, 0, 0), (0.6, 0.8, 0), (1, 0, 0)] ( interpolation = "vertex" )'
    mesh = mesh_of(tmp_path, f'def Mesh "A" {{ {QUAD} {normals} }}')
    assert np.allclose(mesh.normals[0], [[0, 1, 0], [0, 0, 1], [0.6, 0.8, 0]])
    assert np.array_equal(mesh.normals[1, 2], np.float32([1, 0, 0]))


def test_scheme_decides_between_faceted_and_smooth(tmp_path):
    """Without normals, scheme none is faceted, another (also the default) is smooth: one normal at a point."""
    roof = """
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]
        point3f[] points = [(-1, -1, 0), (0, 0, 0), (0, 0, 1), (-1, -1, 1), (1, -1, 0), (1, -1, 1)]
    """
    assert mesh_of(tmp_path, f'def Mesh "A" {{ {roof} uniform token subdivisionScheme = "none" }}').normals is None
    smooth = mesh_of(tmp_path, f'def Mesh "A" {{ {roof} }}')
    ridge = smooth.normals[smooth.triangles == 1]
    left, right = face_normals(smooth)[[0, -1]]
    assert np.all(ridge == ridge[0])
    assert ridge[0] @ left > left @ right
    assert ridge[0] @ right > left @ right


def test_moving_points_become_samples(tmp_path):
    """Points with time samples move linearly between them; the triangles stay."""
    mesh = mesh_of(
        tmp_path,
        """def Mesh "A" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 3: [(0, 0, 4), (1, 0, 4), (0, 1, 4)] }
        uniform token subdivisionScheme = "none"
        }""",
    )
    assert isinstance(mesh.points, Samples)
    assert mesh.deforms
    assert np.array_equal(mesh.points_at(2), np.float32([[0, 0, 2], [1, 0, 2], [0, 1, 2]]))


MOVING = """def Mesh "A" {
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 3: [(0, 0, 0), (1, 0, 0), (0, 0, 1)] }
    %s }"""


def test_smooth_normals_turn_with_the_points(tmp_path):
    """A smooth mesh whose triangle turns from +z to −y has the triangle's own normal at every frame on the way."""
    mesh = mesh_of(tmp_path, MOVING % "")
    for time in (1, 2, 3):
        np.testing.assert_allclose(
            mesh.normals_at(time), corner_normals(mesh.points_at(time), mesh.triangles), atol=1e-6
        )
    np.testing.assert_allclose(mesh.normals_at(2)[0, 0], [0, -np.sqrt(0.5), np.sqrt(0.5)], atol=1e-6)


def test_authored_normals_turn(tmp_path):
    """Normals with samples are unit between them too, whether the points move or not; ones that stay are one array."""
    turning = """normal3f[] normals ( interpolation = "uniform" )
        normal3f[] normals.timeSamples = { 1: [(0, 0, 1)], 3: [(0, 1, 0)] }"""
    for stage in (MOVING % turning, f'def Mesh "A" {{ {QUAD} {turning.replace("uniform", "constant")} }}'):
        mesh = mesh_of(tmp_path, stage)
        assert mesh.deforms
        np.testing.assert_allclose(mesh.normals_at(1)[0, 0], [0, 0, 1])
        np.testing.assert_allclose(mesh.normals_at(2)[0, 1], [0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-6)
    still = mesh_of(tmp_path, MOVING % 'normal3f[] normals = [(0, 0, 1)] ( interpolation = "constant" )')
    assert not isinstance(still.normals, Samples)


def test_faceted_meshes_have_no_normals_to_turn(tmp_path):
    """Scheme none without normals is faceted at every time."""
    assert mesh_of(tmp_path, MOVING % 'uniform token subdivisionScheme = "none"').normals is None


def test_changing_number_of_points_is_warned_of(tmp_path):
    """A mesh whose topology changes keeps its first shape, and says so."""
    scene = scene_of(
        tmp_path,
        """def Mesh "A" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 2: [(0, 0, 4)] }
        uniform token subdivisionScheme = "none"
        }""",
    )
    assert len(scene.surfaces[0].mesh.points) == 3
    assert scene.warnings == (
        "/World/A: the number of points changes in time, which is not supported; the first is used",
    )


@pytest.mark.parametrize(
    ("prim", "lower", "upper"),
    [
        ('def Sphere "A" { double radius = 2 }', (-2, -2, -2), (2, 2, 2)),
        ('def Cube "A" { double size = 3 }', (-1.5, -1.5, -1.5), (1.5, 1.5, 1.5)),
        ('def Cube "A" { }', (-1, -1, -1), (1, 1, 1)),
        (
            'def Cylinder "A" { double radius = 1\n double height = 6\n token axis = "X" }',
            (-3, -1, -1),
            (3, 1, 1),
        ),
        ('def Cone "A" { double radius = 2\n double height = 4 }', (-2, -2, -2), (2, 2, 2)),
        ('def Capsule "A" { double radius = 1\n double height = 2\n token axis = "Y" }', (-1, -2, -1), (1, 2, 1)),
        ('def Plane "A" { double width = 4\n double length = 6\n token axis = "X" }', (0, -3, -2), (0, 3, 2)),
        ('def Plane "A" { double width = 4\n double length = 6\n token axis = "Y" }', (-2, 0, -3), (2, 0, 3)),
        ('def Plane "A" { double width = 4\n double length = 6\n token axis = "Z" }', (-2, -3, 0), (2, 3, 0)),
    ],
)
def test_gprims_have_the_size_that_usd_gives_them(tmp_path, prim, lower, upper):
    """Bounds of each gprim's mesh are those that USD computes."""
    mesh = mesh_of(tmp_path, prim)
    # The outline is a polygon of many sides, so its bounds are met to the chord's error at worst.
    assert np.allclose(mesh.points.min(axis=0), lower, atol=1e-6)
    assert np.allclose(mesh.points.max(axis=0), upper, atol=1e-6)


@pytest.mark.parametrize("axis", "XYZ")
def test_plane_faces_its_axis(tmp_path, axis):
    """A plane's front is along its axis."""
    mesh = mesh_of(tmp_path, f'def Plane "A" {{ token axis = "{axis}" }}')
    assert np.allclose(face_normals(mesh), np.eye(3)["XYZ".index(axis)])


def test_repeated_points_are_warned_of(tmp_path):
    """Triangles without area are kept, with a warning; nothing becomes NaN."""
    scene = scene_of(
        tmp_path,
        """def Mesh "A" {
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 1, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (9, 9, 9)]
        }""",
    )
    assert np.all(np.isfinite(scene.surfaces[0].mesh.normals))
    assert scene.warnings == ("/World/A: 1 of 2 triangles have no area",)


@pytest.mark.parametrize("prim", ['def Mesh "A" { }', 'def Mesh "A" { int[] faceVertexCounts = [] }'])
def test_empty_mesh_is_left_out(tmp_path, prim):
    """A mesh without faces is named in a warning and is no surface."""
    scene = scene_of(tmp_path, prim)
    assert scene.surfaces == ()
    assert scene.warnings == ("/World/A: it has no faces; it is left out",)


@pytest.mark.parametrize(
    ("primvar", "warning"),
    [
        (
            'texCoord2f[] primvars:st = [(0, 0)] ( interpolation = "vertex" )',
            "primvars:st has 1 values, which do not fit the mesh; they are left out",
        ),
        (
            'normal3f[] normals = [(0, 0, 1)] ( interpolation = "faceVarying" )',
            "1 normals do not fit the mesh (faceVarying); they are left out",
        ),
    ],
)
def test_primvars_of_the_wrong_length_are_left_out(tmp_path, primvar, warning):
    """Too few values for the interpolation: the mesh is read without them, with a warning."""
    scene = scene_of(tmp_path, f'def Mesh "A" {{ {QUAD} {primvar} }}')
    assert scene.surfaces[0].mesh.uvs is None
    assert scene.surfaces[0].mesh.normals is None
    assert scene.warnings == (f"/World/A: {warning}",)


@pytest.mark.parametrize(
    ("prim", "message"),
    [
        (
            'def Sphere "A" { double radius = -1 }',
            "/World/A: radius is -1.0; allowed: > 0",
        ),
        (
            'def Cube "A" { double size = nan }',
            "/World/A: size is nan; allowed: a finite number",
        ),
        (
            'def Cone "A" { token axis = "W" }',
            "/World/A: axis is W; allowed: X, Y, Z",
        ),
        (
            """def Mesh "A" {
            int[] faceVertexCounts = [3]
            int[] faceVertexIndices = [0, 1, 7]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)] }""",
            "/World/A: faceVertexIndices is 0…7; allowed: 0…2, the points there are",
        ),
        (
            """def Mesh "A" {
            int[] faceVertexCounts = [3, 3]
            int[] faceVertexIndices = [0, 1, 2]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)] }""",
            "/World/A: faceVertexCounts is 6 corners in all; allowed: 3, one per index",
        ),
        (
            """def Mesh "A" {
            int[] faceVertexCounts = [3]
            int[] faceVertexIndices = [0, 1, 2]
            point3f[] points = [(0, 0, 0), (1, nan, 0), (0, 1, 0)] }""",
            "/World/A: points is [ 1. nan 0.] at index 1; allowed: finite numbers",
        ),
        (
            f"""def Mesh "A" {{ {QUAD}
            texCoord2f[] primvars:st = [(0, inf)] ( interpolation = "constant" ) }}""",
            "/World/A: primvars:st is NaN or infinity; allowed: finite numbers",
        ),
        (
            f"""def Mesh "A" {{ {QUAD}
            normal3f[] normals = [(0, nan, 0)] ( interpolation = "constant" ) }}""",
            "/World/A: normals is NaN or infinity; allowed: finite numbers",
        ),
    ],
)
def test_bad_geometry_is_named_in_one_line(tmp_path, prim, message):
    """Each bad shape raises one line with file, prim, attribute, value and what is allowed."""
    with pytest.raises(ValueError, match="allowed") as error:
        scene_of(tmp_path, prim)
    assert str(error.value) == f"{tmp_path / 'scene.usda'}: {message}"


@pytest.mark.parametrize(
    ("name", "points", "triangles", "lower", "upper"),
    [
        ("bunny", 6102, 12200, (-0.96, 0.02, -0.55), (0.66, 1.65, 0.69)),
        ("bear", 1986, 3968, (-2.45, 0, -4.9), (2.45, 5.55, 4.9)),
        ("rocks", 5437, 10870, (-18.8, -0.49, -15.2), (18.9, 11, 15.1)),
    ],
)
def test_real_meshes(name, points, triangles, lower, upper):
    """Meshes that Warp ships, rocks with polygons of up to 17 corners, are read whole: closed, within their bounds."""
    scene = Scene.open(f"{ASSETS}/{name}.usd")
    (surface,) = scene.surfaces
    mesh = surface.mesh
    assert scene.warnings == ()
    assert (len(mesh.points), len(mesh.triangles)) == (points, triangles)
    assert np.all(mesh.points >= lower)
    assert np.all(mesh.points <= upper)
    assert np.allclose(np.linalg.norm(mesh.normals, axis=2), 1, atol=1e-5)
    edges = np.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    # Rocks that touch share an edge, so that four triangles meet there.
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0)


def test_dented_polygons_keep_their_area():
    """Triangles of the rocks' polygons have the polygons' area (their vector area), so no ear was cut outside."""
    stage = Usd.Stage.Open(f"{ASSETS}/rocks.usd")
    geom = UsdGeom.Mesh(stage.GetPrimAtPath("/root/rocks"))
    points = np.asarray(geom.GetPointsAttr().Get(), np.float64)
    indices = np.asarray(geom.GetFaceVertexIndicesAttr().Get())
    faces = np.split(indices, np.cumsum(geom.GetFaceVertexCountsAttr().Get())[:-1])
    vector_area = [np.cross(points[f], np.roll(points[f], -1, axis=0)).sum(axis=0) / 2 for f in faces]
    (surface,) = read_stage(stage, "rocks").surfaces
    p = surface.mesh.points[surface.mesh.triangles].astype(np.float64)
    triangle_area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2
    # Points are single precision, so the polygons are flat to about 1e-6 of their size.
    assert np.isclose(triangle_area, np.linalg.norm(vector_area, axis=1).sum(), rtol=1e-6)
