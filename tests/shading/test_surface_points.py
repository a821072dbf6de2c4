"""Detail of surface points: the combined model in its order, parallax, gloss, and light in either space."""

import numpy as np
import pytest
import warp as wp
from PIL import Image

from warp_smoke.geometry import normalized
from warp_smoke.launch import Rows
from warp_smoke.material import Material, Texture
from warp_smoke.scene import DistantLight
from warp_smoke.shading.light_source import light_source
from warp_smoke.shading.looks import make_looks
from warp_smoke.shading.normal_map import encode_normals
from warp_smoke.shading.radiance import shade_light
from warp_smoke.shading.relief import tangent_frame, to_tangent, to_world
from warp_smoke.shading.surface_points import SurfacePoints, allocate_detail, look_up_detail

wp.set_module_options({"enable_backward": False})

RAW = {"color_space": "raw", "wrap_s": "clamp", "wrap_t": "clamp"}
DIRECTIONS = RAW | {"scale": (2, 2, 2, 1), "bias": (-1, -1, -1, 0)}


def save(path, codes):
    """Writes a picture file of codes."""
    Image.fromarray(np.asarray(codes, np.uint8)).save(path)
    return str(path)


def points_at(launcher, positions, normals, tangents, uvs):
    """Surface points of material 0."""
    points = SurfacePoints()
    for name, values, kind in (
        ("positions", positions, wp.vec3),
        ("normals", normals, wp.vec3),
        ("tangents", tangents, wp.vec4),
        ("uvs", uvs, wp.vec2),
    ):
        setattr(points, name, launcher.array(np.ascontiguousarray(values, np.float32), "test", dtype=kind))
    points.material = launcher.zeros(len(positions), "test", dtype=int)
    return points


def on_floor(launcher, uvs):
    """Points of the unit square in y = 0, u along x, v along −z."""
    uvs = np.atleast_2d(np.asarray(uvs, float))
    ones = np.ones(len(uvs))
    positions = np.stack([uvs[:, 0], 0 * ones, -uvs[:, 1]], axis=1)
    return points_at(launcher, positions, np.tile([0, 1, 0], (len(uvs), 1)), np.tile([1, 0, 0, 1], (len(uvs), 1)), uvs)


def detail_of(launcher, material, points, eye=None, ambient=(0.0, 0.0, 0.0)):
    """The points' detail, seen from an eye."""
    count = len(points.positions)
    looks = make_looks(launcher, [material])
    detail = allocate_detail(launcher, count, "test", [material])
    eye = wp.vec4(0.0, 0.0, 0.0, 0.0) if eye is None else wp.vec4(*map(float, eye), 1.0)
    look_up_detail(launcher, count, looks, points, eye, wp.vec3(*ambient), detail)
    return looks, detail


def ramp(tmp_path, size=256):
    """A picture whose red is u, and green v, as far as codes go."""
    u, v = np.meshgrid(np.arange(size) / (size - 1), np.arange(size)[::-1] / (size - 1))
    return save(tmp_path / "ramp.png", np.rint(255 * np.dstack([u, v, 0 * u])))


def test_mapped_normals(launcher, tmp_path):
    """A map's x leans the normal along u, its y along v: (0.6, 0, 0.8) and (0, 0.6, 0.8) on a floor."""
    for direction, expected in (((0.6, 0, 0.8), (0.6, 0.8, 0)), ((0, 0.6, 0.8), (0, 0.8, -0.6))):
        file = save(tmp_path / "n.png", np.broadcast_to(encode_normals(np.array(direction)), (2, 2, 3)))
        material = Material(normal_texture=Texture(file=file, **DIRECTIONS))
        _, detail = detail_of(launcher, material, on_floor(launcher, (0.5, 0.5)))
        np.testing.assert_allclose(detail.normals.numpy()[0], expected, atol=0.006)  # a code and a half


@pytest.mark.parametrize("case", ["no direction", "no tangent"])
def test_where_there_is_no_mapped_normal_the_surface_has_its_own(launcher, tmp_path, case):
    """A direction of length zero (grey 127.5), or a point without a tangent, keeps the surface's normal."""
    codes = [[[128, 128, 128]], [[127, 127, 127]]] if case == "no direction" else [[[255, 128, 128]]] * 2
    material = Material(normal_texture=Texture(file=save(tmp_path / "n.png", codes), **DIRECTIONS))
    points = on_floor(launcher, (0.5, 0.5))
    if case == "no tangent":
        points.tangents.zero_()
    _, detail = detail_of(launcher, material, points)
    np.testing.assert_array_equal(detail.normals.numpy(), [[0, 1, 0]])


def test_offset_parallax(launcher, tmp_path):
    """T_n = T_o + (h s + b) V_xy: h = 1, eye 45° towards +u: u grows by (0.04 − 0.02)/√2; h = 0: it shrinks."""
    file = ramp(tmp_path)
    for code, height in ((255, 1.0), (0, 0.0)):
        heights = Texture(file=save(tmp_path / "h.png", [[code]]), **RAW)
        material = Material(diffuse_texture=Texture(file=file, **RAW), height_texture=heights)
        points = on_floor(launcher, (0.5, 0.5))
        _, detail = detail_of(launcher, material, points, eye=(10.5, 10, -0.5))
        expected = 0.5 + (0.04 * height - 0.02) / np.sqrt(2)
        # The ramp's texels run from 0 to 1 over 255/256 of the picture.
        found = 0.5 + (detail.diffuse.numpy()[0, 0] - 0.5) * 255 / 256
        assert found == pytest.approx(expected, abs=2e-4)


def test_parallax_comes_before_everything_else(launcher, tmp_path):
    """Normal, base and gloss are looked up at the shifted coordinates: all three see the picture's other half."""
    halves = np.zeros((4, 64, 3))
    halves[:, 32:] = 255
    directions = np.where(halves > 0, encode_normals(np.array([0.6, 0, 0.8])), encode_normals(np.array([0, 0, 1.0])))
    material = Material(
        diffuse_texture=Texture(file=save(tmp_path / "b.png", halves), **RAW),
        normal_texture=Texture(file=save(tmp_path / "n.png", directions), **DIRECTIONS),
        roughness_texture=Texture(file=save(tmp_path / "r.png", halves[..., 0]), **RAW),
        height_texture=Texture(file=save(tmp_path / "h.png", [[255]]), **RAW),
        parallax_scale=0.2,
        parallax_bias=0.0,
    )
    points = on_floor(launcher, (0.45, 0.5))
    _, flat = detail_of(launcher, material, points)
    _, shifted = detail_of(launcher, material, points, eye=(100.45, 100, -0.5))
    for detail, side in ((flat, 0), (shifted, 1)):
        np.testing.assert_allclose(detail.diffuse.numpy()[0], side, atol=1e-6)
        np.testing.assert_allclose(detail.normals.numpy()[0], ((0, 1, 0), (0.6, 0.8, 0))[side], atol=0.006)
        assert detail.gloss.numpy()[0, 1] == pytest.approx(256 * (1 - side), abs=1e-3)


def test_marched_relief_meets_a_slope(launcher, tmp_path):
    """Heights z = 0.2 u, eye 45° towards +u through u₀: the line u = u₀ + z meets them at z = u₀/4."""
    material = Material(
        height_texture=Texture(file=ramp(tmp_path), **RAW), parallax="occlusion", parallax_scale=0.2, parallax_bias=0.0
    )
    u = np.linspace(0.1, 0.7, 7)
    points = on_floor(launcher, np.stack([u, 0 * u + 0.5], axis=1))
    _, detail = detail_of(launcher, material, points, eye=(1e4, 1e4, -0.5))
    relief = detail.relief.numpy()
    # The ramp is exact to half a texel and half a code, of which the slope leaves a quarter.
    np.testing.assert_allclose(relief[:, 2], 0.25 * u, atol=0.25 * 0.2 / 128)
    np.testing.assert_allclose(relief[:, 0], u + relief[:, 2], atol=1e-4)


def test_relief_shadows_itself(launcher, tmp_path):
    """Behind a wall of height 0.1 in the direction of the light at 45°, 0.1 of the texture is dark, and no more."""
    codes = np.zeros((4, 200))
    codes[:, 100:104] = 255
    heights = Texture(file=save(tmp_path / "h.png", codes), **RAW)
    material = Material(height_texture=heights, parallax="occlusion", parallax_scale=0.1, parallax_bias=0.0)
    u = np.array([0.25, 0.35, 0.42, 0.44, 0.47, 0.49, 0.56, 0.7])
    points = on_floor(launcher, np.stack([u, 0 * u + 0.5], axis=1))
    eye = (0.5, 1e5, -0.5)
    looks, detail = detail_of(launcher, material, points, eye)
    sun = DistantLight(path="/Sun", intensity=np.pi, transform=shining((-1, -1, 0)))
    out = launcher.zeros(len(u), "test", dtype=wp.vec3)
    args = (light_source(sun, np.zeros(3), 1.0), looks, points, detail, wp.vec4(*map(float, eye), 1.0), out)
    shade_light(launcher, len(u), *args)
    assert (out.numpy()[:, 0] > 0).tolist() == [True, True, False, False, False, False, True, True]


def shining(direction):
    """A transform whose −Z axis points along a direction."""
    z = -np.asarray(direction, float) / np.linalg.norm(direction)
    x = normalized(np.cross([0.0, 1.0, 0.3], z))
    matrix = np.eye(4)
    matrix[:3, :3] = x, np.cross(z, x), z
    return matrix


@pytest.mark.parametrize(("gloss", "expected"), [("exponent", (1.0, 64.0)), ("factor", (0.25, 192.0))])
def test_gloss(launcher, tmp_path, gloss, expected):
    """Roughness ¾ from a texture is the exponent 64, or a quarter of the highlight whose roughness is ¼."""
    file = save(tmp_path / "r.png", [[191]])
    texture = Texture(file=file, **RAW | {"scale": (255 / 191 * 0.75,) * 4})
    material = Material(roughness=0.25, roughness_texture=texture, gloss=gloss)
    _, detail = detail_of(launcher, material, on_floor(launcher, (0.5, 0.5)))
    np.testing.assert_allclose(detail.gloss.numpy()[0], expected, rtol=1e-5)


def test_classic_exponent(launcher):
    """The classic model's exponent is 64, whatever the roughness."""
    _, detail = detail_of(launcher, Material(reflection="classic", roughness=0.1), on_floor(launcher, (0, 0)))
    np.testing.assert_array_equal(detail.gloss.numpy()[0], [1, 64])


def test_metal_reflects_its_base_colour_as_a_mirror(launcher, tmp_path):
    """With a share of metal k from a texture: m_d = (1 − k) c and r₀ = (1 − k) r₀ + k c; with k = 1 none is matte."""
    texture = Texture(file=save(tmp_path / "m.png", [[51, 255]]), channel="r", **RAW)
    base = np.array([0.8, 0.4, 0.2])
    material = Material(diffuse_color=tuple(base), fresnel_r0=(0.04, 0.04, 0.04), metallic_texture=texture)
    _, detail = detail_of(launcher, material, on_floor(launcher, [(0.25, 0.5), (0.75, 0.5)]))
    np.testing.assert_allclose(detail.diffuse.numpy(), [0.8 * base, 0 * base], atol=1e-6)
    np.testing.assert_allclose(detail.r0.numpy(), [0.8 * 0.04 + 0.2 * base, base], atol=1e-6)


def test_specular_texture(launcher, tmp_path):
    """Reflectance comes from the picture, whose colours are sRGB as those of all colours: code 188 is 0.5029."""
    texture = Texture(file=save(tmp_path / "s.png", [[[188, 0, 255]]]), wrap_s="clamp", wrap_t="clamp")
    _, detail = detail_of(launcher, Material(specular_texture=texture), on_floor(launcher, (0.5, 0.5)))
    np.testing.assert_allclose(detail.r0.numpy(), [[0.5029, 0, 1]], atol=1e-4)


def test_light_without_lights(launcher, tmp_path):
    """Without a light: emissive + occlusion · ambient ⊗ base colour, each from its texture."""
    glow = Texture(file=save(tmp_path / "e.png", [[[51, 102, 0]]]), **RAW)
    hidden = Texture(file=save(tmp_path / "o.png", [[[0, 204, 0]]]), channel="g", **RAW)
    material = Material(diffuse_color=(0.5, 0.5, 1.0), emissive_texture=glow, occlusion_texture=hidden)
    _, detail = detail_of(launcher, material, on_floor(launcher, (0.5, 0.5)), ambient=(0.1, 0.2, 0.3))
    np.testing.assert_allclose(detail.unlit.numpy(), [[0.2 + 0.04, 0.4 + 0.08, 0.24]], atol=1e-6)


@pytest.mark.parametrize("metallic", [0.0, 0.3, 1.0])
def test_light_from_everywhere_on_metal(launcher, metallic):
    """What is the same all around looks the same in a mirror: ambient light has the base colour, matte or metal."""
    material = Material(diffuse_color=(0.8, 0.4, 0.2), metallic=metallic)
    _, detail = detail_of(launcher, material, on_floor(launcher, (0.5, 0.5)), ambient=(0.5, 0.25, 1.0))
    np.testing.assert_allclose(detail.unlit.numpy(), [[0.4, 0.1, 0.2]], atol=1e-6)


@pytest.mark.parametrize(("threshold", "expected"), [(0.0, [0.2, 0.8]), (0.5, [0, 1]), (0.9, [0, 0])])
def test_opacity(launcher, tmp_path, threshold, expected):
    """Opacity is the texture's number, or 0 and 1 below and from the threshold on."""
    texture = Texture(file=save(tmp_path / "a.png", [[51, 204]]), channel="r", **RAW)
    material = Material(opacity_texture=texture, opacity_threshold=threshold)
    _, detail = detail_of(launcher, material, on_floor(launcher, [(0.25, 0.5), (0.75, 0.5)]))
    np.testing.assert_allclose(detail.opacity.numpy(), expected, atol=1e-6)


@wp.kernel
def _both_spaces(
    rows: Rows,
    normals: wp.array[wp.vec3],
    tangents: wp.array[wp.vec4],
    mapped: wp.array[wp.vec3],
    to_light: wp.array[wp.vec3],
    world_out: wp.array[float],
    tangent_out: wp.array[float],
):
    s = rows.first + wp.tid()
    frame = tangent_frame(normals[s], tangents[s])
    world_out[s] = wp.dot(wp.normalize(to_world(frame, mapped[s])), to_light[s])
    tangent_out[s] = wp.dot(wp.normalize(mapped[s]), to_tangent(frame, to_light[s]))


def test_light_is_the_same_in_tangent_and_in_world_space(launcher):
    """Of a mapped normal brought to the world, and of the light brought to the frame, n · l is equal to rounding."""
    rng = np.random.default_rng(6)
    normals, along, mapped, to_light = (normalized(rng.standard_normal((1000, 3))) for _ in range(4))
    tangents = np.concatenate([along, rng.choice((-1.0, 1.0), (1000, 1))], axis=1)
    arrays = [
        launcher.array(a.astype(np.float32), "test", dtype=kind)
        for a, kind in ((normals, wp.vec3), (tangents, wp.vec4), (mapped, wp.vec3), (to_light, wp.vec3))
    ]
    world, tangent = launcher.zeros(1000, "test"), launcher.zeros(1000, "test")
    launcher.launch_each(_both_spaces, 1000, *arrays, world, tangent)
    np.testing.assert_allclose(world.numpy(), tangent.numpy(), atol=2e-6)
