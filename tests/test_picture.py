"""The ray-cast picture: the same values as bakes at the same points, known colours of smoke, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdGeom, UsdShade
from scenes import at, floor, plume, shining
from stage_text import write_stage

import warp_smoke as ws
from warp_smoke.geometry import Mesh
from warp_smoke.lattice import place_lattice
from warp_smoke.launch import Launcher
from warp_smoke.lighting import Lighting
from warp_smoke.picture import SmokeVolume, render_picture
from warp_smoke.plan import make_plan
from warp_smoke.preview import preview
from warp_smoke.shading.normal_map import encode_normals, height_normals
from warp_smoke.timing import Timings
from warp_smoke.usd.read_volume import read_volumes
from warp_smoke.vdb import Grid, write_vdb

SIZE = 64


def above(height=8.0, size=6.0):
    """A camera straight above a floor, whose square picture shows just the floor, rows towards −z first."""
    camera = {"focal_length": height, "horizontal_aperture": size, "vertical_aperture": size, "near": 0.01}
    return ws.Camera(path="/World/Camera", transform=shining((0, -1, 0)) @ at(0, height, 0), **camera)


def looking_down():
    """The same with the picture's right along x and its top towards −z."""
    matrix = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 8, 0, 1]])
    return replace(above(), transform=matrix)


def srgb(linear):
    """Codes 0…255, not rounded."""
    linear = np.clip(linear, 0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


@pytest.fixture
def relief(tmp_path):
    """A material with base, normal, height and roughness textures."""
    along = (np.arange(256) + 0.5) / 256
    u, v = np.meshgrid(along, along)
    heights = 0.5 + 0.5 * np.sin(8 * np.pi * u) * np.sin(8 * np.pi * v)
    pictures = {
        "height": np.rint(255 * heights).astype(np.uint8),
        "normal": encode_normals(height_normals(heights, 20.0, 20.0)),
        "roughness": np.rint(255 * u).astype(np.uint8),
        "diffuse": np.rint(255 * np.dstack([u, v, 0.5 + 0 * u])).astype(np.uint8),
    }
    textures = {}
    for name, codes in pictures.items():
        Image.fromarray(codes).save(tmp_path / f"{name}.png")
        scale = {"scale": (2, 2, 2, 1), "bias": (-1, -1, -1, 0)} if name == "normal" else {}
        textures[f"{name}_texture"] = ws.Texture(file=str(tmp_path / f"{name}.png"), **scale)
    return ws.Material(path="/World/Relief", fresnel_r0=(0.2, 0.3, 0.4), **textures)


def bakes_of(scene, density=None):
    """The bakes of a scene's only receiver at its first frame, with given smoke."""
    launcher = Launcher("cpu")
    plan = make_plan(scene)
    lighting = Lighting(launcher, plan, Timings(launcher))
    densities = {each.domain.path: launcher.array(density, "test") for each in plan.domains}
    made = lighting.update(scene.start, densities)
    pictures = made[0] if isinstance(made, tuple) else made
    return {bake: pixels for (_, bake), pixels in pictures.items()}


def exact_lights(scene):
    """The scene with shadows by rays, as pictures have them."""
    lights = [replace(light, shadow_filter="exact", smoke_shadow="ray_traced") for light in scene.lights]
    return replace(scene, lights=lights)


@pytest.mark.parametrize("look", ["plain", "relief", "occlusion", "energyConserving", "metal", "faces"])
def test_a_picture_has_the_values_of_the_bake(relief, look):
    """Pixel centres on texel centres: the same codes to one, for every kind of detail, with shadows of solids."""
    if look == "plain":
        material = ws.Material(path="/World/M", diffuse_color=(0.6, 0.4, 0.2), emissive_color=(0, 0.02, 0.05))
    elif look == "occlusion":
        material = replace(relief, parallax="occlusion")
    elif look == "metal":
        number, color = relief.roughness_texture, relief.diffuse_texture
        shares = {"metallic_texture": number, "occlusion_texture": number}
        material = replace(relief, emissive_texture=replace(color, scale=(0.1, 0.1, 0.1, 1)), **shares)
    else:
        material = replace(relief, reflection="energyConserving" if look == "energyConserving" else "blinnPhong")
    cube = ws.Surface(path="/World/Cube", mesh=Mesh.box(0.8), transform=at(0.4, 2.0, 0.2))
    ground = floor(texture_size=SIZE, material=material)
    if look == "faces":
        red = ws.Material(path="/World/Red", diffuse_color=(0.6, 0.1, 0.1), fresnel_r0=(0.5, 0.5, 0.5), roughness=0.8)
        half = ws.MaterialSubset(path="/World/Floor/Half", triangles=[0, 1, 2, 3], material=red)
        ground = replace(ground, mesh=Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6), 2), subsets=[half])
    scene = exact_lights(replace(plume(), domains=[], surfaces=[ground, cube]))
    scene = replace(scene, camera=looking_down(), ambient=(0.05, 0.06, 0.08))
    baked = bakes_of(scene)["lit"].astype(int)
    # The cube casts its shadow on the floor but is not in the picture's way where it is not seen.
    seen = render_picture(replace(scene, surfaces=[scene.surfaces[0], cube]), 1.0, size=(SIZE, SIZE)).astype(int)
    hidden = cube_pixels()
    difference = np.abs(seen - baked).max(axis=2)
    assert np.all(difference[~hidden] <= 1)
    assert np.count_nonzero(hidden) < 0.1 * hidden.size
    assert baked.std() > 5


def cube_pixels():
    """Where the cube of the test above covers the floor, a little widened."""
    along = (np.arange(SIZE) + 0.5) / SIZE * 6 - 3
    z, x = np.meshgrid(along, along, indexing="ij")
    near = 8 / (8 - 2.4)  # its upper face, seen from y = 8
    return (np.abs(x - 0.4 * near) < 0.45 * near) & (np.abs(z - 0.2 * near) < 0.45 * near)


def test_smoke_shadows_have_the_values_of_the_bake():
    """Under smoke that fills its box unevenly, the floor's picture has the bake's codes where no smoke is before it."""
    scene = exact_lights(replace(plume(), surfaces=[floor(texture_size=SIZE)], camera=looking_down()))
    (domain,) = scene.domains
    lattice = place_lattice(scene, domain)
    density = np.random.default_rng(3).random(lattice.shape, np.float32)
    baked = bakes_of(scene, density)["lit"].astype(int)
    volume = SmokeVolume(domain, lattice, density)
    seen = render_picture(scene, 1.0, [volume], size=(SIZE, SIZE)).astype(int)
    clear = render_picture(scene, 1.0, size=(SIZE, SIZE)).astype(int)
    along = (np.arange(SIZE) + 0.5) / SIZE * 6 - 3
    z, x = np.meshgrid(along, along, indexing="ij")
    beside = np.maximum(np.abs(x), np.abs(z)) > 1.0 * 8 / 6 + 0.1  # of the box up to y = 2
    assert np.abs(seen - baked).max(axis=2)[beside].max() <= 1
    assert np.abs(seen - clear).max(axis=2)[beside].max() > 20  # and there is a shadow there


def smoke_before(ambient, light=None, extinction=4.0, albedo=(0.8, 0.5, 0.2)):
    """A picture of a box of uniform smoke, 2 m thick, before nothing, and its linear values in the middle."""
    domain = ws.SmokeDomain(path="/World/Smoke", resolution=16, extinction=extinction, albedo=albedo)
    camera = ws.Camera(path="/World/Camera", transform=at(0, 0, 1e4), focal_length=1e5, far=1e5)
    lights = [light] if light else []
    scene = ws.Scene(domains=[domain], lights=lights, camera=camera, ambient=ambient)
    lattice = place_lattice(scene, domain)
    volume = SmokeVolume(domain, lattice, np.ones(lattice.shape, np.float32))
    return render_picture(scene, 1.0, [volume], size=(5, 5))[2, 2]


def test_smoke_in_ambient_light():
    """Before a background A: albedo A (1 − e^(−σ d)) + A e^(−σ d) with d = 2 m."""
    through = np.exp(-0.4 * 2)
    expected = 0.5 * (np.array([0.8, 0.5, 0.2]) * (1 - through) + through)
    assert np.abs(smoke_before((0.5, 0.5, 0.5), extinction=0.4) - srgb(expected)).max() <= 0.6


def test_smoke_lit_from_the_camera():
    """Light from the eye's side is dimmed on both ways: albedo B/4 ∫ σ e^(−2σ s) ds = albedo B/8 (1 − e^(−2σ d))."""
    sun = ws.DistantLight(path="/World/Sun", intensity=8 * np.pi, transform=shining((0, 0, -1)))
    expected = np.array([0.8, 0.5, 0.2]) * (1 - np.exp(-2 * 0.5 * 2))
    # Steps of half a cell see the light between the cells' centres by straight lines: 1 % of it.
    assert np.abs(smoke_before((0, 0, 0), sun, 0.5) - srgb(expected)).max() <= 2


def test_surfaces_shadow_smoke_beyond_them():
    """A plate above smoke, the only surface, shadows it under a tiny round light as it does under a point."""
    domain = ws.SmokeDomain(path="/World/Smoke", resolution=16, extinction=1.0)
    mesh = Mesh.grid((-0.5, 1.5, 0.5), (1, 0, 0), (0, 0, -1))
    plate = ws.Surface(path="/World/Plate", mesh=mesh)
    camera = replace(looking_down(), transform=at(0, 0, 8))
    pictures = []
    for surfaces, name in (([plate], "area"), ([plate], "exact"), ([], "exact")):
        round_one = {"intensity": 300.0, "radius": 1e-5, "normalize": True, "shadow_filter": name}
        light = ws.PointLight(path="/World/Lamp", transform=at(0.013, 3.1, 0.021), **round_one)
        scene = ws.Scene(domains=[domain], surfaces=surfaces, lights=[light], camera=camera)
        lattice = place_lattice(scene, domain)
        volume = SmokeVolume(domain, lattice, np.ones(lattice.shape, np.float32))
        pictures.append(render_picture(scene, 1.0, [volume], size=(24, 24)).astype(int))
    soft, sharp, unshadowed = pictures
    # Of a cell at the shadow's edge some of the 64 rays are on its other side.
    assert np.abs(soft - sharp).max() <= 5
    assert np.abs(sharp - unshadowed).max() > 20


def test_every_thread_count_gives_the_same_picture():
    """One thread and two: equal to the bit."""
    scene = replace(plume(), camera=looking_down())
    one, two = (render_picture(scene, 1.0, size=(48, 32), threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_more_samples_soften_edges_only():
    """With 3² rays a pixel the floor's inside is the same, and its edge against the sky lies between."""
    scene = ws.Scene(
        surfaces=[ws.Surface(path="/F", mesh=Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)))],
        camera=looking_down(),
        ambient=(1, 1, 1),
    )
    one, nine = (render_picture(scene, 1.0, size=(31, 31), samples=n)[..., 0].astype(int) for n in (1, 3))
    assert set(np.unique(one)) == {118, 255}  # 0.18 of the ambient light, and the sky
    assert len(np.unique(nine)) > 2
    assert one[15, 15] == nine[15, 15] == 118


def test_light_at_vertices():
    """On one triangle, Gouraud's light is the barycentric mean of its corners' and misses the highlight inside."""
    mesh = Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    lamp = ws.PointLight(path="/L", transform=at(0, 1, 0), intensity=10.0)
    scene = ws.Scene(surfaces=[ws.Surface(path="/F", mesh=mesh)], lights=[lamp], camera=looking_down())
    pixel, vertex = (render_picture(scene, 1.0, size=(SIZE, SIZE), shading=s).astype(int) for s in ("pixel", "vertex"))
    assert pixel[32, 32, 0] > vertex[32, 32, 0] + 50
    assert np.abs(pixel[0, 0] - vertex[0, 0]).max() <= 2
    fine = replace(scene.surfaces[0], mesh=Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6), divisions=128))
    fine = render_picture(replace(scene, surfaces=[fine]), 1.0, size=(SIZE, SIZE), shading="vertex").astype(int)
    assert np.abs(fine - pixel).max() <= 2  # and with fine triangles it is the same


def test_light_linking():
    """A light that is linked to another surface leaves the floor dark."""
    scene = replace(plume(), domains=[], camera=looking_down())
    lights = [replace(light, illuminates=("/World/Other",)) for light in scene.lights]
    assert not render_picture(replace(scene, lights=lights), 1.0, size=(8, 8)).any()
    assert render_picture(scene, 1.0, size=(8, 8)).any()


def test_an_empty_scene_is_its_background():
    """Nothing to hit, no light: the ambient light."""
    picture = render_picture(ws.Scene(camera=above(), ambient=(1.0, 0.0, 0.0)), 1.0, size=(3, 2))
    np.testing.assert_array_equal(picture, np.tile([255, 0, 0], (2, 3, 1)))


def test_results_of_a_run_show_its_smoke(tmp_path):
    """The picture of a folder is that of the simulated stage, to what 16-bit densities leave, in its own look."""
    scene = replace(plume(frames=3), camera=replace(looking_down(), transform=at(0, 1.5, 9)))
    scene.save(tmp_path / "plume.usda")
    ws.run(ws.Scene.open(tmp_path / "plume.usda"), tmp_path / "out")
    pictures = []
    for path in (tmp_path / "out", tmp_path / "plume.usda"):
        file = ws.render(path, tmp_path / "picture.png", frame=3, size=(64, 48), samples=1)
        pictures.append(np.asarray(Image.open(file)).astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() <= 1
    without = render_picture(ws.Scene.open(tmp_path / "plume.usda"), 3.0, size=(64, 48)).astype(int)
    assert np.abs(pictures[0] - without).max() > 10


def test_smoke_of_a_run_ends_as_softly_as_simulated_smoke(tmp_path):
    """Thick smoke cut to its box in a file, under a light with its usual shadow: half precision is all that differs."""
    settings = {"resolution": 16, "extinction": 200.0, "boundary": ("open",) * 6}
    scene = plume(frames=2)
    domain = replace(scene.domains[0], **settings)
    scene = replace(scene, domains=[domain], camera=replace(looking_down(), transform=at(0, 1.5, 9)))
    scene.save(tmp_path / "plume.usda")
    ws.run(tmp_path / "plume.usda", tmp_path / "out")
    pictures = []
    for path in (tmp_path / "out", tmp_path / "plume.usda"):
        file = ws.render(path, tmp_path / "picture.png", frame=2, size=(96, 72), samples=1)
        pictures.append(np.asarray(Image.open(file)).astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() <= 1


def test_voxels_of_other_makers_end_in_an_empty_one(tmp_path):
    """Around the voxels of a file without a domain lies one of none: there density falls to 0 over half a voxel."""
    density = np.ones((2, 3, 4), np.float32)
    write_vdb(tmp_path / "fog.vdb", [Grid("density", density, voxel_size=0.5, translation=(1.0, 2.0, 3.0))])
    volume = """def Volume "Fog" { rel field:density = </World/Fog/d>
        def OpenVDBAsset "d" { asset filePath = @./fog.vdb@
            token fieldName = "density" } }"""
    stage = Usd.Stage.Open(str(write_stage(tmp_path, volume)))
    ((domain, lattice, found),) = read_volumes(stage, ws.Scene(), 1)
    assert domain.path == "/World/Fog"
    np.testing.assert_array_equal(found, np.pad(density, 1))
    assert lattice.shape == (4, 5, 6)
    np.testing.assert_allclose(lattice.cells_to_world()[3, :3], [0.25, 1.25, 2.25])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (0, 5)}, "size is 0x5; allowed: 1x1 to 67108864 pixels"),
        ({"samples": 0}, "samples is 0; allowed: 1 to 64"),
        ({"shading": "flat"}, "shading is flat; allowed: pixel, vertex"),
    ],
)
def test_what_is_no_picture_is_refused(options, message):
    """Sizes, samples and shadings that there are not."""
    with pytest.raises(ValueError, match=message):
        render_picture(ws.Scene(camera=above()), 1.0, **options)


def test_no_camera():
    """Without a camera there is no picture."""
    with pytest.raises(ValueError, match="camera is None; allowed: a UsdGeomCamera"):
        render_picture(ws.Scene(), 1.0)


def test_faces_of_a_picture_have_their_own_materials():
    """Left and right half of a floor are seen in the colours of their subset and of their surface."""
    mesh = Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6), 2)
    red, blue = (ws.Material(path=f"/{n}", diffuse_color=c) for n, c in (("R", (1, 0, 0)), ("B", (0, 0, 1))))
    subset = ws.MaterialSubset(path="/Floor/Left", triangles=[0, 1, 2, 3], material=red)
    surface = ws.Surface(path="/Floor", mesh=mesh, material=blue, subsets=[subset])
    scene = ws.Scene(surfaces=[surface], camera=looking_down(), ambient=(1, 1, 1))
    for shading in ("pixel", "vertex"):
        seen = render_picture(scene, 1.0, size=(SIZE, SIZE), shading=shading)
        assert np.all(seen[:, : SIZE // 2] == [255, 0, 0])
        assert np.all(seen[:, SIZE // 2 :] == [0, 0, 255])


def test_faces_of_a_mesh_without_a_material(tmp_path):
    """From the stage's GeomSubsets to the picture, the bake and its look, where the mesh itself has no material."""
    mesh = Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6), 2)
    looks = [ws.Material(path=f"/World/{n}", diffuse_color=c) for n, c in (("Red", (1, 0, 0)), ("Blue", (0, 0, 1)))]
    subsets = [
        ws.MaterialSubset(path=f"/World/Floor/S{n}", triangles=range(4 * n, 4 * n + 4), material=look)
        for n, look in enumerate(looks)
    ]
    receiver = ws.Receiver(path="/World/Floor", texture_size=SIZE)
    ground = ws.Surface(path="/World/Floor", mesh=mesh, subsets=subsets, receiver=receiver)
    scene = ws.Scene(surfaces=[ground], camera=looking_down(), ambient=(1, 1, 1), start=1, end=1)
    scene.save(tmp_path / "floor.usda")
    assert ws.Scene.open(tmp_path / "floor.usda").surfaces[0].material is None
    result = ws.run(tmp_path / "floor.usda", tmp_path / "out")
    ws.render(tmp_path / "out", tmp_path / "seen.png", size=(SIZE, SIZE), samples=1)
    baked, seen = (
        np.asarray(Image.open(f)) for f in (*result.folder.glob("textures/Floor.lit*"), tmp_path / "seen.png")
    )
    for picture in (baked[..., :3], seen):
        assert np.all(picture[:, : SIZE // 2] == [255, 0, 0])
        assert np.all(picture[:, SIZE // 2 :] == [0, 0, 255])
    stage = Usd.Stage.Open(str(result.stage))
    prims = [stage.GetPrimAtPath(path) for path in ("/World/Floor", "/World/Floor/S0", "/World/Floor/S1")]
    bound = {UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].GetPath() for prim in prims}
    assert len(bound) == 1  # the baked picture, over all its faces


def test_display_colors_from_the_stage_to_the_pixels(tmp_path):
    """Without a material, faces reflect their linear display colours: in the picture, the bake and the preview."""
    mesh = Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6), 2)
    ground = ws.Surface(path="/World/Floor", mesh=mesh, receiver=ws.Receiver(path="/World/Floor", texture_size=SIZE))
    scene = ws.Scene(surfaces=[ground], camera=looking_down(), ambient=(1, 1, 1), start=1, end=1)
    scene.save(tmp_path / "floor.usda")
    stage = Usd.Stage.Open(str(tmp_path / "floor.usda"))
    colors = UsdGeom.Mesh.Get(stage, "/World/Floor").CreateDisplayColorPrimvar(UsdGeom.Tokens.uniform)
    left, right = (0.2, 0.5, 0.0), (0.0, 0.1, 0.8)
    colors.Set([left] * 4 + [right] * 4)
    stage.Save()
    result = ws.run(tmp_path / "floor.usda", tmp_path / "out")
    ws.render(tmp_path / "out", tmp_path / "seen.png", size=(SIZE, SIZE), samples=1)
    preview(tmp_path / "floor.usda", screenshot=tmp_path / "preview.png", size=(SIZE, SIZE))
    files = (*result.folder.glob("textures/Floor.lit*"), tmp_path / "seen.png", tmp_path / "preview.png")
    for picture in (np.asarray(Image.open(file))[..., :3] for file in files):
        for color, half in ((left, picture[4:-4, 4:28]), (right, picture[4:-4, 36:-4])):
            assert np.abs(half - srgb(color)).max() <= 1  # codes are rounded, once more between VTK's and the file's


def test_what_cannot_be_shown_is_told(tmp_path):
    """A picture is made all the same, and lines say which textures have no coordinates, and what the reader noticed."""
    Image.fromarray(np.full((2, 2, 3), 200, np.uint8)).save(tmp_path / "grey.png")
    material = ws.Material(path="/World/M", diffuse_texture=ws.Texture(file=str(tmp_path / "grey.png")), opacity=0.5)
    mesh = Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    ground = ws.Surface(path="/World/Floor", mesh=Mesh(mesh.points, mesh.triangles), material=material)
    ws.Scene(surfaces=[ground], camera=looking_down(), start=1, end=1).save(tmp_path / "floor.usda")
    told = []
    ws.render(tmp_path / "floor.usda", tmp_path / "seen.png", size=(4, 4), on_warning=told.append)
    assert (tmp_path / "seen.png").exists()
    assert told[-1] == "/World/Floor: the textures of /World/M have no coordinates; its colours are used"
    assert any("inputs:opacity: its shadow is that of an opaque surface" in line for line in told)


def test_holes_are_seen_through(tmp_path):
    """Through two layers of a fence whose opacity is cut off, the floor is seen where the picture is below it."""
    codes = np.where(np.arange(8) % 2, 200, 100).astype(np.uint8)
    Image.fromarray(np.broadcast_to(codes, (2, 8))).save(tmp_path / "fence.png")
    texture = ws.Texture(file=str(tmp_path / "fence.png"), channel="r", uv_translation=(0.0, 0.5))
    # Nearest texels are wanted: a threshold between the two codes falls in the middle between two texels' centres.
    fence = ws.Material(path="/Fence", diffuse_color=(1, 0, 0), opacity_texture=texture, opacity_threshold=150 / 255)
    floor_of = Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    surfaces = [ws.Surface(path="/Floor", mesh=floor_of, material=ws.Material(path="/B", diffuse_color=(0, 0, 1)))]
    # Each as large as it is seen to be, one above the other.
    for height in (1.0, 2.0):
        half = 3 * (8 - height) / 8
        mesh = Mesh.grid((-half, height, half), (2 * half, 0, 0), (0, 0, -2 * half))
        surfaces.append(ws.Surface(path=f"/Fence{height:g}", mesh=mesh, material=fence))
    scene = ws.Scene(surfaces=surfaces, camera=looking_down(), ambient=(1, 1, 1))
    seen = render_picture(scene, 1.0, size=(SIZE, SIZE))
    # Eight bands, of eight pixels each; the pixels beside a border are left out.
    for band in range(8):
        expected = [255, 0, 0] if band % 2 else [0, 0, 255]
        assert np.all(seen[:, 8 * band + 1 : 8 * band + 7] == expected)
