"""Bakes against the formulas at each texel."""

import numpy as np
import pytest
from lit_floor import LAMP, ORIGIN, SIZE, SUN, floor, lamp_terms, srgb, texel_points
from PIL import Image
from scenes import at

from warp_smoke.geometry import Mesh, normalized
from warp_smoke.launch import Launcher
from warp_smoke.scene import Camera, Material, MaterialSubset, PointLight, Receiver, Texture
from warp_smoke.shading.bake import ReceiverBake


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
