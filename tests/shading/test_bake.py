"""Bakes against the formulas at each texel, what is computed again and when, and what stands in for what is missing."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from warp_smoke.geometry import Mesh, normalized
from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import Camera, DistantLight, Material, MaterialSubset, PointLight, Receiver, Surface, Texture
from warp_smoke.shading.bake import ReceiverBake
from warp_smoke.shading.texels import TexelMap
from warp_smoke.shading.vertices import VertexMap

ORIGIN = np.zeros(3)
SIZE = 32


def at(*position):
    """A transform that moves the origin."""
    matrix = np.eye(4)
    matrix[3, :3] = position
    return matrix


def downwards():
    """A transform whose −Z axis points down."""
    return np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def floor(**fields):
    """A floor of 4 × 4 units in y = 0 around the origin, v towards −z."""
    mesh = Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    return Surface(**{"path": "/Floor", "mesh": mesh, "receiver": Receiver(path="/Floor", texture_size=SIZE)} | fields)


def texel_points():
    """Where the floor's texel centres lie, [SIZE, SIZE, 3] from the top row."""
    along = (np.arange(SIZE) + 0.5) / SIZE * 4 - 2
    z, x = np.meshgrid(along, along, indexing="ij")
    return np.stack([x, np.zeros_like(x), z], axis=2)


def srgb(linear):
    """Codes 0…255 in float64, not rounded."""
    linear = np.clip(linear, 0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


LAMP = PointLight(path="/Lamp", transform=at(0.5, 1.0, -0.25), intensity=12.0, color=(1.0, 0.7, 0.4))
SUN = DistantLight(path="/Sun", transform=downwards(), intensity=1.5, color=(0.3, 0.5, 1.0))


def lamp_terms(points):
    """Unit vectors to the lamp, and B max(l·n, 0) of the floor, [..., 3] each."""
    offset = np.array([0.5, 1.0, -0.25]) - points
    d2 = np.sum(offset**2, axis=-1, keepdims=True)
    to_light = offset / np.sqrt(d2)
    return to_light, 12.0 / (4 * np.pi * d2) * np.array([1.0, 0.7, 0.4]) * to_light[..., 1:2]


def test_matte_floor(launcher):
    """Under one lamp each texel is m_d I color cos θ/(4π d²) of its centre, to half a code of sRGB."""
    material = Material(path="/M", diffuse_color=(0.8, 0.5, 0.2))
    bake = ReceiverBake(launcher, floor(material=material), [LAMP], ORIGIN, bakes=["lit"])
    bake.update(1.0)
    expected = srgb(lamp_terms(texel_points())[1] * (0.8, 0.5, 0.2))
    # 0.01: float32 radiance is good to about 1e-6 of 255 codes, where two codes meet.
    assert np.abs(bake.picture("lit") - expected).max() <= 0.51


def test_highlights_emission_and_ambient(launcher):
    """With a camera: emissive + ambient ⊗ m_d + Σ B ⊗ (m_d + F (m + 8)/8 (n·h)ᵐ) cos θ, to half a code."""
    r0, diffuse, ambient, emissive = np.array([0.04, 0.1, 0.3]), (0.2, 0.1, 0.3), (0.1, 0.0, 0.2), (0.0, 0.05, 0.0)
    material = Material(path="/M", diffuse_color=diffuse, fresnel_r0=tuple(r0), roughness=0.75, emissive_color=emissive)
    eye = np.array([-1.0, 1.5, 3.0])
    camera = Camera(path="/Camera", transform=at(*eye))
    bake = ReceiverBake(
        launcher, floor(material=material), [LAMP, SUN], ORIGIN, bakes=["lit"], ambient=ambient, camera=camera
    )
    bake.update(1.0)
    points = texel_points()
    to_eye = normalized(eye - points)
    expected = np.array(emissive) + np.multiply(ambient, diffuse)
    to_lamp, lamp = lamp_terms(points)
    up = np.broadcast_to([0.0, 1.0, 0.0], points.shape)
    for to_light, arriving in ((to_lamp, lamp), (up, 1.5 / np.pi * np.array([0.3, 0.5, 1.0]))):
        h = normalized(to_light + to_eye)
        fresnel = r0 + (1 - r0) * (1 - np.sum(h * to_light, axis=-1, keepdims=True)) ** 5
        expected = expected + arriving * (diffuse + fresnel * 72 / 8 * h[..., 1:2] ** 64)
    assert np.abs(bake.picture("lit") - srgb(expected)).max() <= 0.51
    assert not bake.warnings


def test_irradiance_and_normals(launcher, tmp_path):
    """Linear codes of ambient + Σ V B cos θ, whatever the material; and normals along the stage's axes as codes."""
    direction = np.array([0.6, 0.0, 0.8])
    codes = np.rint(127.5 * (direction + 1)).astype(np.uint8)
    Image.fromarray(np.broadcast_to(codes, (2, 2, 3))).save(tmp_path / "n.png")
    texture = Texture(file=str(tmp_path / "n.png"), scale=(2, 2, 2, 1), bias=(-1, -1, -1, 0))
    ambient, visibility = (0.05, 0.02, 0.01), 0.25
    for material, normal in ((Material(diffuse_color=(0, 0, 0)), (0, 1, 0)), (Material(normal_texture=texture), None)):
        surface = floor(material=material)
        options = {"bakes": ["irradiance", "normal"], "ambient": ambient, "shadowed": ["/Lamp"]}
        bake = ReceiverBake(launcher, surface, [LAMP], ORIGIN, **options)
        bake.update(1.0)
        bake.visibility["/Lamp"].fill_(visibility)
        if normal is None:  # u along x, v along −z, and codes that are a little off
            x, y, z = normalized(2.0 * codes / 255.0 - 1.0)
            normal = (x, z, -y)
        to_lamp, arriving = lamp_terms(texel_points())
        cosine = np.sum(to_lamp * normal, axis=-1, keepdims=True)
        light = np.array(ambient) + visibility * arriving / to_lamp[..., 1:2] * np.maximum(cosine, 0)
        irradiance = bake.picture("irradiance")
        assert irradiance.dtype == np.uint16
        # Float32 radiance is good to 1e-6 of 65535 codes, and half a code is rounding.
        assert np.abs(irradiance - 65535 * np.clip(light, 0, 1)).max() <= 1.0
        assert np.abs(bake.picture("normal") - 127.5 * (np.array(normal) + 1)).max() <= 0.51


def test_shadows_multiply_their_light(launcher):
    """lit, visibility and smokeShadow of two lights with given shadows follow their definitions."""
    bake = ReceiverBake(
        launcher,
        floor(),
        [LAMP, SUN],
        ORIGIN,
        bakes=["lit", "visibility", "smokeShadow"],
        shadowed=["/Lamp"],
        smoke_shadowed=["/Lamp", "/Sun"],
    )
    bake.update(1.0)
    rng = np.random.default_rng(5)
    v, t_lamp, t_sun = rng.random((3, SIZE, SIZE)).astype(np.float32)
    v[:4] = 0.0  # the lamp is hidden: its smoke does not count there
    bake.visibility["/Lamp"].assign(v.ravel())
    bake.transmittance["/Lamp"].assign(t_lamp.reshape(1, -1))
    bake.transmittance["/Sun"].assign(t_sun.reshape(1, -1))
    assert set(bake.visibility) == {"/Lamp"}

    lamp = lamp_terms(texel_points())[1]
    sun = np.broadcast_to(1.5 / np.pi * np.array([0.3, 0.5, 1.0]), lamp.shape)
    lit = 0.18 * (lamp * (v * t_lamp)[..., None] + sun * t_sun[..., None])
    assert np.abs(bake.picture("lit") - srgb(lit)).max() <= 0.51
    y_lamp, y_sun = (light @ (0.2126, 0.7152, 0.0722) for light in (lamp, sun))
    seen = (y_lamp * v + y_sun) / (y_lamp + y_sun)
    assert np.abs(bake.picture("visibility") - 255 * seen).max() <= 0.51
    through = (y_lamp * v * t_lamp + y_sun * t_sun) / (y_lamp * v + y_sun)
    assert np.abs(bake.picture("smokeShadow") - 255 * through).max() <= 0.51


@pytest.mark.parametrize("bits", [8, 16])
def test_texels_out_of_the_smokes_reach_are_kept(launcher, bits):
    """Limited to some texels, every picture has the bytes of one that is not, frame after frame, alpha too."""
    bakes = ["lit", "irradiance", "smokeShadow"]
    receiver = Receiver(path="/Floor", texture_size=SIZE, texture_bits=bits)
    surface = floor(receiver=receiver, material=Material(opacity=0.5))
    options = {"bakes": bakes, "smoke_shadowed": ["/Lamp", "/Sun"], "color_shadowed": ["/Sun"]}
    limited, whole = (ReceiverBake(launcher, surface, [LAMP, SUN], ORIGIN, **options) for _ in range(2))
    rng = np.random.default_rng(4)
    reached = np.flatnonzero(rng.random(SIZE * SIZE) < 0.3)
    for bake in (limited, whole):
        bake.update(1.0)
    limited.limit_smoke(reached)
    assert len(limited.smoke_points) == len(reached)
    shares = {"/Lamp": np.ones((1, SIZE * SIZE), np.float32), "/Sun": np.ones((3, SIZE * SIZE), np.float32)}
    for _ in range(3):
        for path, share in shares.items():
            some = rng.choice(reached, len(reached) // 2)
            share[:, some] = rng.random((len(share), len(some)), np.float32)
            whole.transmittance[path].assign(share)
            limited.transmittance[path].assign(share[:, reached])
        found, expected = limited.pictures(bakes), whole.pictures(bakes)
        for name in bakes:
            np.testing.assert_array_equal(found[name], expected[name])


def test_only_texels_whose_shadow_changes_are_put_together_anew(launcher):
    """Of the texels in the smoke's reach, those alone turn black when light is taken away without saying so."""
    bake = ReceiverBake(launcher, floor(), [SUN], ORIGIN, bakes=["lit"], shadowed=["/Sun"], smoke_shadowed=["/Sun"])
    bake.update(1.0)
    bake.limit_smoke(np.arange(100, 300))
    before = bake.pictures(["lit"])["lit"].reshape(-1, 3)
    assert before.min() > 0
    bake.visibility["/Sun"].fill_(0.0)
    share = np.ones((1, 200), np.float32)
    share[0, 50:90] = 0.5
    bake.transmittance["/Sun"].assign(share)
    after = bake.pictures(["lit"])["lit"].reshape(-1, 3)
    np.testing.assert_array_equal(np.flatnonzero(np.all(after == 0, axis=1)), np.arange(150, 190))
    np.testing.assert_array_equal(np.delete(after, np.s_[150:190], axis=0), np.delete(before, np.s_[150:190], axis=0))


def test_smoke_out_of_reach_of_everything(launcher):
    """Where smoke reaches no texel at all, the picture is that without smoke."""
    bake = ReceiverBake(launcher, floor(), [SUN], ORIGIN, bakes=["lit"], smoke_shadowed=["/Sun"])
    bake.update(1.0)
    whole = bake.picture("lit")
    bake.limit_smoke(np.zeros(0, int))
    np.testing.assert_array_equal(bake.pictures(["lit"])["lit"], whole)


def test_no_light_is_no_shadow(launcher):
    """Where no light arrives, or there is none, visibility and smokeShadow are 1 and lit is what the surface emits."""
    below = PointLight(path="/Below", transform=at(0, -1, 0))
    surface = floor(material=Material(path="/M", emissive_color=(1.0, 0.0, 0.0)))
    for lights in ([], [below]):
        bake = ReceiverBake(launcher, surface, lights, ORIGIN, bakes=["lit", "visibility", "smokeShadow"])
        bake.update(1.0)
        assert np.all(bake.picture("visibility") == 255)
        assert np.all(bake.picture("smokeShadow") == 255)
        assert np.all(bake.picture("lit") == [255, 0, 0])


def test_only_what_changed_is_computed(device):
    """Still lights are shaded once; a moving one, the camera or the receiver makes only its own light new."""
    flicker = PointLight(path="/Flicker", transform=at(0, 1, 0), intensity=Samples([1, 2, 3], [1.0, 1.0, 2.0]))
    camera = Camera(path="/C", transform=Samples([3, 4], np.stack([at(0, 1, 3), at(0, 2, 3)])))
    surface = floor(transform=Samples([4, 5], np.stack([at(0, 0, 0), at(0, 0.1, 0)])))
    launcher = Launcher(device)
    bake = ReceiverBake(launcher, surface, [LAMP, SUN, flicker], ORIGIN, bakes=["lit", "visibility"], camera=camera)
    counts = []
    for time in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0):
        before = launcher.launches.copy()
        bake.update(time)
        made = launcher.launches - before
        counts.append((made["_shade_light"], made["_weigh_light"], made["_place_texels"]))
    assert counts == [
        (3, 3, 1),
        (0, 0, 0),
        (1, 1, 0),  # the flickering lamp alone
        (3, 0, 0),  # highlights follow the camera
        (3, 3, 1),
        (0, 0, 0),
    ]


def test_moving_pictures_are_those_of_each_time(launcher):
    """Updating from frame to frame gives the bytes that a fresh bake of that frame gives."""
    light = PointLight(path="/L", transform=Samples([1, 3], np.stack([at(-1, 1, 0), at(1, 1, 0)])), intensity=9.0)
    camera = Camera(path="/C", transform=at(0, 1, 3))

    def fresh():
        return ReceiverBake(launcher, floor(), [light, SUN], ORIGIN, bakes=["lit"], camera=camera)

    bake = fresh()
    pictures = []
    for time in (1.0, 2.0, 3.0):
        bake.update(time)
        pictures.append(bake.picture("lit"))
        other = fresh()
        other.update(time)
        np.testing.assert_array_equal(pictures[-1], other.picture("lit"))
    assert np.any(pictures[0] != pictures[1])


def test_nothing_is_made_that_is_not_asked_for(device):
    """A bake of shadows alone keeps no colours, a lit one no weights, and no shadow means no shares."""
    sizes = {}
    for name, bakes, shadowed in (
        ("lit", ["lit"], []),
        ("shadowed", ["lit"], ["/Lamp"]),
        ("visibility", ["visibility"], []),
    ):
        launcher = Launcher(device)
        bake = ReceiverBake(launcher, floor(), [LAMP], ORIGIN, bakes=bakes, shadowed=shadowed)
        bake.update(1.0)
        bake.picture(bakes[0])
        sizes[name] = launcher.allocated["bake"]
        assert (launcher.launches["_weigh_light"] == 0) == (bakes == ["lit"])
        assert (launcher.launches["_shade_light"] == 0) == (bakes == ["visibility"])
    n = SIZE * SIZE
    assert sizes["shadowed"] - sizes["lit"] == 4 * n
    assert sizes["lit"] - sizes["visibility"] == 2 * 12 * n - 2 * 4 * n + 2 * n  # radiance, lit; weights, shares; codes


def test_no_camera(launcher):
    """Without a camera highlights are left out, with a note, even for a mirror."""
    shiny = Material(path="/M", diffuse_color=(0.5, 0.5, 0.5), fresnel_r0=(1, 1, 1), roughness=0.5)
    bake = ReceiverBake(launcher, floor(material=shiny), [SUN], ORIGIN, bakes=["lit"])
    bake.update(1.0)
    np.testing.assert_array_equal(bake.picture("lit")[0, 0], np.round(srgb(0.75 / np.pi * np.array([0.3, 0.5, 1.0]))))
    assert bake.warnings == ("/Floor: no camera to see highlights from; the bake has diffuse light only",)


def test_default_material(launcher):
    """A surface without a material reflects 18 %."""
    bake = ReceiverBake(launcher, floor(), [], ORIGIN, bakes=["lit"], ambient=(1, 1, 1))
    bake.update(1.0)
    np.testing.assert_array_equal(bake.picture("lit"), 118)


def test_texture(launcher, tmp_path):
    """A picture on the floor comes back from a bake under white ambient light, code for code."""
    codes = np.random.default_rng(2).integers(0, 256, (SIZE, SIZE, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "noise.png")
    material = Material(path="/M", diffuse_texture=Texture(file=str(tmp_path / "noise.png")))
    bake = ReceiverBake(launcher, floor(material=material), [], ORIGIN, bakes=["lit"], ambient=(1, 1, 1))
    bake.update(1.0)
    np.testing.assert_array_equal(bake.picture("lit"), codes)


def test_faces_have_their_own_materials(launcher):
    """Each texel shows the material of its triangle; faces in no subset show the surface's own."""
    mesh = Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4), 2)  # triangles 0…3 are u < ½
    red, blue = (Material(path=f"/{n}", diffuse_color=c) for n, c in (("R", (1, 0, 0)), ("B", (0, 0, 1))))
    subset = MaterialSubset(path="/Floor/Left", triangles=[0, 1, 2, 3], material=red)
    surface = floor(mesh=mesh, material=blue, subsets=[subset])
    bake = ReceiverBake(launcher, surface, [], ORIGIN, bakes=["lit"], ambient=(1, 1, 1))
    bake.update(1.0)
    picture = bake.picture("lit")
    np.testing.assert_array_equal(picture[:, : SIZE // 2], np.broadcast_to([255, 0, 0], (SIZE, SIZE // 2, 3)))
    np.testing.assert_array_equal(picture[:, SIZE // 2 :], np.broadcast_to([0, 0, 255], (SIZE, SIZE // 2, 3)))


def test_sixteen_bits(launcher):
    """All bakes hold what they do with 8 bits, to half a code of 16: lit as sRGB, with alpha, the others raw."""
    material = Material(diffuse_color=(0.8, 0.5, 0.2), opacity=0.3)
    receiver = Receiver(path="/Floor", texture_size=SIZE, texture_bits=16)
    bakes = ["lit", "irradiance", "visibility", "smokeShadow", "normal"]
    surface = floor(material=material, receiver=receiver, transform=turned(0.3))
    options = {"bakes": bakes, "shadowed": ["/Sun"], "smoke_shadowed": ["/Sun"]}
    bake = ReceiverBake(launcher, surface, [SUN], ORIGIN, **options)
    bake.update(1.0)
    bake.visibility["/Sun"].fill_(0.375)
    bake.transmittance["/Sun"].fill_(0.6)
    light = 1.5 / np.pi * np.array([0.3, 0.5, 1.0]) * np.cos(0.3) * 0.375 * 0.6
    expected = {
        "lit": 65535 * np.array([*srgb(light * (0.8, 0.5, 0.2)) / 255, 0.3]),
        "irradiance": 65535 * light,
        "visibility": 65535 * np.array([0.375]),
        "smokeShadow": 65535 * np.array([0.6]),
        "normal": 32767.5 * (np.array([np.sin(0.3), np.cos(0.3), 0.0]) + 1),
    }
    for name in bakes:
        picture = bake.picture(name)
        assert picture.dtype == np.uint16
        # A tenth more than half a code: float32's pow is good to about 1e-6 of 65535 codes.
        assert np.abs(picture.reshape(SIZE, SIZE, -1) - expected[name]).max() <= 0.6, name


def turned(angle):
    """A transform that leans the upward direction towards x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1]])


def test_opacity_is_the_alpha_of_what_is_lit(launcher):
    """A see-through material makes lit RGBA; the other bakes stay as they are."""
    surface = floor(material=Material(diffuse_color=(1, 1, 1), opacity=0.4))
    bake = ReceiverBake(launcher, surface, [], ORIGIN, bakes=["lit", "irradiance"], ambient=(1, 1, 1))
    bake.update(1.0)
    np.testing.assert_array_equal(bake.picture("lit"), np.broadcast_to([255, 255, 255, 102], (SIZE, SIZE, 4)))
    assert bake.picture("irradiance").shape == (SIZE, SIZE, 3)


PLAIN = Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4), 4)


@pytest.mark.parametrize(
    ("uvs", "message"),
    [
        (None, "/Floor: no texture coordinates; colours at its points are baked instead of a texture"),
        (
            PLAIN.uvs % 0.75 * 8,
            "/Floor: texture coordinates reach over 0…4 and overlap in 1024 of 1024 texels; "
            "colours at its points are baked instead of a texture",
        ),
        (PLAIN.uvs * np.float32(np.nan), "/Floor: texture coordinates are not finite"),
        (PLAIN.uvs * 0, "/Floor: texture coordinates cover no area"),
    ],
)
def test_points_instead_of_texels(launcher, uvs, message):
    """Without texture coordinates that can hold a picture, linear colours at the points, and a warning."""
    surface = floor(mesh=Mesh(PLAIN.points, PLAIN.triangles, uvs=uvs))
    bake = ReceiverBake(launcher, surface, [LAMP], ORIGIN, bakes=["lit", "smokeShadow"], smoke_shadowed=["/Lamp"])
    assert isinstance(bake.map, VertexMap)
    assert bake.warnings[0].startswith(message)
    bake.update(1.0)
    bake.transmittance["/Lamp"].fill_(0.25)
    np.testing.assert_allclose(bake.picture("lit"), 0.25 * 0.18 * lamp_terms(PLAIN.points)[1], rtol=1e-5)
    np.testing.assert_allclose(bake.picture("smokeShadow"), 0.25)


def test_texture_without_coordinates(launcher):
    """A textured material on a mesh without texture coordinates shows its plain colour, and says so."""
    material = Material(path="/M", diffuse_color=(0.5, 0.25, 1.0), diffuse_texture=Texture(file="/nowhere.png"))
    surface = floor(mesh=Mesh(PLAIN.points, PLAIN.triangles), material=material)
    bake = ReceiverBake(launcher, surface, [], ORIGIN, bakes=["lit"], ambient=(1, 1, 1))
    bake.update(1.0)
    np.testing.assert_allclose(bake.picture("lit"), np.tile([0.5, 0.25, 1.0], (25, 1)))
    assert "/Floor: the textures of /M have no coordinates; its colours are used" in bake.warnings


@pytest.mark.parametrize(("scale", "moved"), [((8, 8), (0, 0)), ((3, 1), (-1, 0)), ((1, 1), (4, 2)), ((-2, 2), (1, 0))])
def test_coordinates_outside_the_unit_square(launcher, tmp_path, scale, moved):
    """Repeated, tiled, moved or mirrored coordinates give the picture of those in the square; textures keep theirs."""
    codes = np.random.default_rng(2).integers(0, 256, (8, 8, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "noise.png")
    texture = Texture(file=str(tmp_path / "noise.png"))
    uvs = (PLAIN.uvs * scale + moved).astype(np.float32)
    pictures = []
    for mesh, look in (
        (Mesh(PLAIN.points, PLAIN.triangles, uvs=uvs), texture),
        (PLAIN, replace(texture, uv_scale=scale, uv_translation=moved)),
    ):
        bake = ReceiverBake(
            launcher, floor(mesh=mesh, material=Material(diffuse_texture=look)), [LAMP], ORIGIN, bakes=["lit"]
        )
        assert isinstance(bake.map, TexelMap)
        bake.update(1.0)
        pictures.append(bake.picture("lit").astype(int))
        assert any("primvars:st_bake" in warning for warning in bake.warnings) == (mesh is not PLAIN)
    mirrored = np.flip(pictures[1], axis=1) if scale[0] < 0 else pictures[1]
    # Float32 coordinates far from the origin move samples of a noisy texture by 1e-5 of a texel.
    assert np.abs(pictures[0] - mirrored).max() <= 1


def test_round_off_outside_the_unit_square(launcher):
    """Coordinates that miss [0, 1] by less than half a texel are baked all the same."""
    grid = Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    surface = floor(mesh=Mesh(grid.points, grid.triangles, uvs=grid.uvs * np.float32(1.004) - np.float32(0.002)))
    bake = ReceiverBake(launcher, surface, [SUN], ORIGIN, bakes=["lit"])
    assert isinstance(bake.map, TexelMap)
    assert bake.map.count == SIZE * SIZE


def test_overlap_is_reported(launcher):
    """A box whose six sides share one square is baked, with a warning that counts the texels."""
    bake = ReceiverBake(launcher, floor(mesh=Mesh.box()), [SUN], ORIGIN, bakes=["lit"])
    assert bake.warnings[0] == (
        "/Floor: texture coordinates overlap in 1024 of 1024 texels; these show only the first of the triangles there"
    )


def test_mesh_without_triangles(launcher):
    """A mesh of nothing gives no colours and no failure."""
    surface = floor(mesh=Mesh(np.zeros((0, 3)), np.zeros((0, 3)), uvs=np.zeros((0, 3, 2))))
    bake = ReceiverBake(launcher, surface, [SUN], ORIGIN, bakes=["lit", "visibility"])
    bake.update(1.0)
    assert bake.picture("lit").shape == (0, 3)
    assert bake.picture("visibility").shape == (0,)


@pytest.mark.parametrize("threads", [2, 7])
def test_same_bits_for_any_number_of_threads(threads):
    """All three pictures are the same for one thread and for many."""
    pictures = []
    for count in (1, threads):
        bake = ReceiverBake(
            Launcher("cpu", count),
            floor(receiver=Receiver(path="/Floor", texture_size=128)),
            [LAMP, SUN],
            ORIGIN,
            bakes=["lit", "visibility", "smokeShadow"],
            camera=Camera(path="/C", transform=at(0, 1, 3)),
            shadowed=["/Lamp"],
            smoke_shadowed=["/Sun"],
        )
        bake.update(1.0)
        shares = np.random.default_rng(9).random((2, 128 * 128)).astype(np.float32)
        bake.visibility["/Lamp"].assign(shares[0])
        bake.transmittance["/Sun"].assign(shares[1].reshape(1, -1))
        pictures.append([bake.picture(name) for name in ("lit", "visibility", "smokeShadow")])
    for one, many in zip(*pictures, strict=True):
        np.testing.assert_array_equal(one, many)


@pytest.mark.parametrize("distance", [1e6, 9e8])
def test_far_from_the_origin(launcher, distance):
    """Moving the whole scene far away changes no code of the picture."""
    place = np.array([distance, -distance, 0.5 * distance])
    pictures = []
    for origin in (np.zeros(3), place):
        lamp = PointLight(path="/L", transform=at(0.5, 1.0, -0.25) @ at(*origin), intensity=12.0)
        camera = Camera(path="/C", transform=at(0, 1, 3) @ at(*origin))
        bake = ReceiverBake(launcher, floor(transform=at(*origin)), [lamp], origin, bakes=["lit"], camera=camera)
        bake.update(1.0)
        pictures.append(bake.picture("lit"))
    np.testing.assert_array_equal(*pictures)
