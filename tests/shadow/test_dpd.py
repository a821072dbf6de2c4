"""Direct projection and diffusion: each of the paper's four steps against its formula in NumPy."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import PointLight
from warp_smoke.shadow.diffusion import Diffusion
from warp_smoke.shadow.dpd import DpdSmokeShadow

ORIGIN = np.zeros(3)


def _shadow(launcher, lattice, light, density, extinction=1.0, **options):
    shadow = DpdSmokeShadow(launcher, lattice, light, ORIGIN, extinction, **options)
    shadow.update(wp.array(np.asarray(density, np.float32), device=launcher.device), 1.0)
    return shadow


def _plane(lattice, light):
    """S, T and the light's way as columns' unit vectors, the box's centre, half sizes and depth, in world space."""
    centre = 0.5 * np.array(lattice.shape) @ lattice.cells_to_world()[:3, :3] + lattice.to_world[3, :3]
    if isinstance(light, PointLight):
        away = centre - light.position_at(1.0)
    else:
        away = light.direction_at(1.0)
    away = away / np.linalg.norm(away)
    s = np.cross(away, (0, 1, 0))
    s /= np.linalg.norm(s)
    t = np.cross(s, away)
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * 0.5 * lattice.voxel_size
    corners = (corners * lattice.shape) @ lattice.axes
    half = np.abs(corners @ np.column_stack([s, t, away])).max(axis=0)
    return s, t, away, centre, half


def _lights(point_light, distant_light):
    return [
        point_light((7, 11, -4)),
        point_light((-9, -2, 5.5)),
        distant_light((0.4, -1, 0.3)),
        distant_light((1, 0.1, 0.05)),
    ]


@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("texels", [(64, 48), (9, 13)])
def test_projection_adds_every_voxel_to_the_nearest_texel(
    launcher, lattice_at, point_light, distant_light, number, texels
):
    """buf[s][t] += D_W by parallel rays along light → centre, on the plane's rectangle: np.add.at in float64."""
    lattice = lattice_at((8, 8, 12), voxel_size=0.7)
    density = np.random.default_rng(0).random(lattice.shape).astype(np.float32)
    light = _lights(point_light, distant_light)[number]
    s, t, _, centre, half = _plane(lattice, light)
    index = np.stack(np.meshgrid(*map(np.arange, lattice.shape), indexing="ij"), axis=-1) + 0.5
    offset = index @ lattice.cells_to_world()[:3, :3] + lattice.to_world[3, :3] - centre
    p = (offset @ s / half[0] + 1) / 2 * texels[0]
    q = (offset @ t / half[1] + 1) / 2 * texels[1]
    # Voxels on a border between texels may fall on either: they get no density.
    border = np.minimum(np.abs(p - np.round(p)), np.abs(q - np.round(q))) < 1e-4
    density[border] = 0.0
    assert border.mean() < 0.2
    expected = np.zeros(texels)
    np.add.at(expected, (p.astype(int).ravel(), q.astype(int).ravel()), density.ravel().astype(float))
    shadow = _shadow(launcher, lattice, light, density, texels=texels)
    np.testing.assert_allclose(shadow.buffer(), expected, rtol=1e-6, atol=1e-6)


def _sweep(u, r):
    """Equation (3) with the edges mirrored."""
    padded = np.pad(u, 1, mode="edge")
    around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    return (u + r * around) / (1 + 4 * r)


def _diffused(launcher, u, r):
    u = launcher.array(np.asarray(u, np.float32)[None], "test")
    return Diffusion(launcher, u.shape, r, "paper", None).spread(u).numpy()[0]


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    r=st.floats(0, 100),
)
def test_sweep_is_equation_3(launcher, seed, shape, r):
    """One sweep equals the formula to round-off, keeps the sum, and stays within the range of what it spreads."""
    u = np.random.default_rng(seed).random(shape).astype(np.float32)
    out = _diffused(launcher, u, r)
    np.testing.assert_allclose(out, _sweep(u.astype(float), r), rtol=1e-6)
    assert out.sum(dtype=float) == pytest.approx(u.sum(dtype=float), rel=1e-6)
    assert out.max() <= u.max() * (1 + 1e-6)
    assert out.min() >= u.min() * (1 - 1e-6)


@pytest.mark.parametrize("r", [0.05, 0.25, 1.0, 10.0])
def test_sweep_adds_less_variance_than_diffusion(launcher, r):
    """One sweep adds 2 r / (1 + 4 r) texels² of variance along each axis, where diffusion would add 2 r."""
    u = np.zeros((21, 21))
    u[10, 10] = 1.0
    out = _diffused(launcher, u, r).astype(float)
    x = np.arange(21) - 10
    assert np.sum(out * x[:, None] ** 2) == pytest.approx(2 * r / (1 + 4 * r), rel=1e-6)
    assert np.sum(out * x[None, :] ** 2) == pytest.approx(2 * r / (1 + 4 * r), rel=1e-6)


def test_light_sets_the_diffusion(launcher, lattice_at, point_light):
    """`smoke_diffusion` is r of the sweep that follows the projection; 0 leaves the projection as it is."""
    lattice = lattice_at((8, 8, 8))
    density = np.random.default_rng(0).random(lattice.shape)
    light = point_light((3, 20, 1))
    plain = _shadow(launcher, lattice, light, density, texels=(12, 10)).buffer()
    spread = _shadow(launcher, lattice, replace(light, smoke_diffusion=0.7), density, texels=(12, 10)).buffer()
    np.testing.assert_allclose(spread, _sweep(plain.astype(float), 0.7), rtol=1e-5)


def _texture_coordinates(lattice, light, points):
    """(s, t, r, q) = B · P · V · M · (x, y, z, 1) with OpenGL's matrices for column vectors; M = identity."""
    s, t, away, centre, half = _plane(lattice, light)
    if isinstance(light, PointLight):
        eye = light.position_at(1.0)
        far = np.linalg.norm(centre - eye) + half[2]
        near = far - 2 * half[2]
        right, top = half[:2] * near / far
        p = np.array(
            [
                [near / right, 0, 0, 0],
                [0, near / top, 0, 0],
                [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
                [0, 0, -1, 0],
            ]
        )
    else:
        eye = centre - half[2] * away
        far = 2 * half[2]
        p = np.array([[1 / half[0], 0, 0, 0], [0, 1 / half[1], 0, 0], [0, 0, -2 / far, -1], [0, 0, 0, 1]])
    v = np.eye(4)
    v[:3, :3] = s, t, -away
    v[:3, 3] = -v[:3, :3] @ eye
    b = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
    return np.column_stack([points, np.ones(len(points))]) @ (b @ p @ v).T


@pytest.mark.parametrize("number", range(4))
def test_texture_matrix(launcher, lattice_at, point_light, distant_light, number):
    """The texture's matrix is B · P · V · M up to a factor, and depth r/q runs from 0 to 1 through the box."""
    lattice = lattice_at((8, 8, 12), voxel_size=0.7)
    light = _lights(point_light, distant_light)[number]
    points = np.random.default_rng(0).uniform(-6, 6, (200, 3))
    matrix = np.array(_shadow(launcher, lattice, light, np.zeros(lattice.shape)).texture.matrix).reshape(4, 4)
    actual = np.column_stack([points, np.ones(len(points))]) @ matrix.T.astype(float)
    expected = _texture_coordinates(lattice, light, points)
    np.testing.assert_array_equal(actual[:, 3] > 0, expected[:, 3] > 0)
    scale = np.linalg.norm(actual, axis=1, keepdims=True) / np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(actual, scale * expected, rtol=1e-4, atol=2e-5)


@pytest.mark.parametrize("number", range(4))
def test_look_up(launcher, lattice_at, point_light, distant_light, transmittance, number):
    """Transmittance is 1 − min(1, σ h Σ D / A) at (s/q, t/q), bilinear; 1 behind the light and beside the texture."""
    lattice = lattice_at((8, 8, 12), voxel_size=0.7)
    density = np.random.default_rng(0).random(lattice.shape)
    light = _lights(point_light, distant_light)[number]
    texels = (16, 12)
    shadow = _shadow(launcher, lattice, light, density, 0.35, texels=texels)
    points = np.random.default_rng(1).uniform(-25, 25, (6000, 3)).astype(np.float32)
    s, t, _, q = _texture_coordinates(lattice, light, points).T
    with np.errstate(divide="ignore"):
        s, t = s / q, t / q
    inside = (q > 0) & (np.minimum(s, t) >= 0) & (np.maximum(s, t) <= 1)
    x, y = (np.clip(np.clip(a, 0, 1) * n - 0.5, 0, n - 1) for a, n in ((s, texels[0]), (t, texels[1])))
    i, j = np.minimum(x.astype(int), texels[0] - 2), np.minimum(y.astype(int), texels[1] - 2)
    f, g = x - i, y - j
    buffer = shadow.buffer().astype(float)
    value = (1 - f) * ((1 - g) * buffer[i, j] + g * buffer[i, j + 1])
    value += f * ((1 - g) * buffer[i + 1, j] + g * buffer[i + 1, j + 1])
    area = 4 * np.prod(_plane(lattice, light)[4][:2]) / np.prod(texels) / lattice.voxel_size**2
    alpha = np.where(inside, np.minimum(1, 0.35 * lattice.h * value / area), 0)
    edge = np.abs(np.stack([s, t, 1 - s, 1 - t])).min(axis=0) < 1e-5
    lit = transmittance(shadow, points=points)
    np.testing.assert_allclose(lit[~edge], 1 - alpha[~edge], atol=2e-4)
    np.testing.assert_array_equal(lit[~edge & ~inside], 1.0)
    assert alpha.max() > 0.3


def test_compositing(launcher, lattice_at, point_light, transmittance):
    """C = α C_shadow + (1 − α) C_surface; a black shadow scales by the transmittance."""
    lattice = lattice_at((8, 8, 8))
    light = point_light((0, 20, 1))
    shadow = _shadow(launcher, lattice, light, np.random.default_rng(0).random(lattice.shape), 0.1)
    points = np.random.default_rng(1).uniform((-6, -8, -6), (6, -5, 6), (300, 3))
    alpha = 1 - transmittance(shadow, points=points)
    surface = np.random.default_rng(2).random((300, 3)).astype(np.float32)
    for color in ((0, 0, 0), (0.2, 0.1, 0.4)):
        colors = launcher.array(surface, "test", dtype=wp.vec3)
        shadow.composite(launcher.array(points.astype(np.float32), "test", dtype=wp.vec3), color, colors)
        expected = alpha[:, None] * np.array(color) + (1 - alpha[:, None]) * surface
        np.testing.assert_allclose(colors.numpy(), expected, atol=1e-6)
    assert 0.1 < alpha.max() < 1


def test_opacity_of_a_uniform_box(launcher, lattice_at, distant_light, transmittance):
    """Straight behind a uniform box α = σ ρ · thickness, linear until it is opaque."""
    lattice = lattice_at((8, 6, 8), voxel_size=0.5)
    points = np.random.default_rng(0).uniform((-1.5, -4, -1.5), (1.5, -2, 1.5), (200, 3))
    for extinction, alpha in ((0.1, 0.1 * 0.7 * 3), (1.0, 1.0)):
        shadow = _shadow(launcher, lattice, distant_light((0, -1, 0)), np.full(lattice.shape, 0.7), extinction)
        np.testing.assert_allclose(transmittance(shadow, points=points), 1 - alpha, atol=1e-6)


def test_mass_is_kept_by_projection_and_diffusion(launcher, lattice_at, point_light):
    """Σ D on the buffer is Σ D of the volume, whatever the light, the texture and the diffusion."""
    lattice = lattice_at((7, 12, 9))
    density = np.random.default_rng(0).random(lattice.shape)
    for r in (0.0, 5.0):
        light = replace(point_light((14, 3, -5)), smoke_diffusion=r)
        shadow = _shadow(launcher, lattice, light, density, texels=(20, 11))
        assert shadow.buffer().sum(dtype=float) == pytest.approx(density.sum(), rel=1e-5)


def test_no_smoke_lets_all_light_through(launcher, lattice_at, point_light, transmittance):
    """An empty volume gives exactly 1 everywhere."""
    lattice = lattice_at((8, 8, 8))
    shadow = _shadow(launcher, lattice, point_light((0, 20, 1)), np.zeros(lattice.shape))
    points = np.random.default_rng(0).uniform(-10, 10, (1000, 3))
    np.testing.assert_array_equal(transmittance(shadow, points=points), 1.0)


def test_size_of_the_texture(launcher, lattice_at, point_light):
    """A square as wide as the domain's longest side has cells, or `smoke_shadow_size`, or what the caller says."""
    lattice, light = lattice_at((4, 6, 12)), point_light((0, 20, 1))
    density = np.zeros(lattice.shape)
    assert _shadow(launcher, lattice, light, density).buffer().shape == (12, 12)
    assert _shadow(launcher, lattice, replace(light, smoke_shadow_size=5), density).buffer().shape == (5, 5)
    assert _shadow(launcher, lattice, light, density, texels=(64, 48)).buffer().shape == (64, 48)


def test_moving_light(launcher, lattice_at, placed, point_light, transmittance):
    """A light that moves has at each time the shadow of a light that stands there."""
    path = [(0.3, 20, 0.2), (20, 0.5, 0.1)]
    light = PointLight(path="/light", transform=Samples([1, 2], [placed(p) for p in path]))
    lattice = lattice_at((6, 8, 7))
    density = np.random.default_rng(0).random(lattice.shape).astype(np.float32)
    points = np.random.default_rng(1).uniform(-10, 10, (1000, 3))
    shadow = DpdSmokeShadow(launcher, lattice, light, ORIGIN, 0.1)
    for time in (1, 2, 1):
        shadow.update(wp.array(density, device=launcher.device), time)
        still = _shadow(launcher, lattice, point_light(path[time - 1]), density, 0.1)
        np.testing.assert_array_equal(transmittance(shadow, points=points), transmittance(still, points=points))


def _blob_lit(lattice, light, points):
    """A Gaussian blob in the lattice, and exp(−τ) behind it in closed form, σ = 3."""
    centre, width = np.array([0.2, 0.1, -0.1]), 0.2
    index = np.stack(np.indices(lattice.shape), axis=-1) + 0.5
    offset = index @ lattice.cells_to_world()[:3, :3] + lattice.to_world[3, :3] - centre
    density = np.exp(-0.5 * np.sum(offset**2, axis=-1) / width**2)
    away = points - light.position_at(1.0)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    offset = centre - points
    b = np.linalg.norm(offset - np.sum(offset * away, axis=1)[:, None] * away, axis=1)
    return density, np.exp(-3 * width * np.sqrt(2 * np.pi) * np.exp(-0.5 * (b / width) ** 2))


def test_true_rays_and_transmittance_are_right(launcher, lattice_at, point_light, transmittance):
    """With a point light near by, true rays and e^(−τ) tend to the closed form; parallel rays and opacity do not."""
    light = point_light((0.6, 2.5, -0.4))
    points = np.random.default_rng(0).uniform((-1.5, -3, -1.5), (1, -2.5, 1.5), (4000, 3))
    errors = {}
    for cells in (32, 64, 128):
        lattice = lattice_at((cells,) * 3, voxel_size=2 / cells)
        density, expected = _blob_lit(lattice, light, points)
        for projection, compositing in (("rays", "transmittance"), ("parallel", "transmittance"), ("rays", "opacity")):
            chosen = replace(light, smoke_projection=projection, smoke_compositing=compositing)
            size = cells // 2  # texels wider than voxels, so that none is missed
            shadow = _shadow(launcher, lattice, chosen, density, 3.0, texels=(size, size))
            error = np.abs(transmittance(shadow, points=points) - expected).mean()
            errors.setdefault((projection, compositing), []).append(error)
    right = errors.pop(("rays", "transmittance"))
    assert -np.polyfit(np.log([32, 64, 128]), np.log(right), 1)[0] > 0.8
    assert right[-1] < 4e-3
    for wrong in errors.values():
        assert wrong[-1] > 5 * right[-1]


def test_true_rays_need_a_light_in_front_of_the_box(launcher, lattice_at, point_light, distant_light):
    """Beside the box rays cannot be projected on one plane: one line; a distant light's rays are parallel anyway."""
    lattice = lattice_at((8, 8, 8))
    beside = replace(point_light((4.5, 3.5, 3.5)), smoke_projection="rays")
    with pytest.raises(ValueError, match=r"/light: position is at .*too near to it.*ray_traced"):
        DpdSmokeShadow(launcher, lattice, beside, ORIGIN, 1.0)
    density = np.random.default_rng(0).random(lattice.shape)
    sun = distant_light((0.3, -1, 0.2))
    rays = _shadow(launcher, lattice, replace(sun, smoke_projection="rays"), density).buffer()
    np.testing.assert_array_equal(rays, _shadow(launcher, lattice, sun, density).buffer())


def test_light_inside_is_refused(launcher, lattice_at, point_light):
    """A light inside the domain, at its centre, on a side or a corner raises one line that names it and what to do."""
    lattice = lattice_at((8, 8, 8))
    for position in ((0, 0, 0), (1, 2, 3), (4, 0, 0), (4, 4, 4)):
        with pytest.raises(ValueError, match=r"/light: position is at .*ray_traced"):
            DpdSmokeShadow(launcher, lattice, point_light(position), ORIGIN, 1.0)


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads(lattice_at, point_light):
    """1, 2 and 7 threads fill bit-equal buffers."""
    lattice = lattice_at((33, 20, 24))
    density = np.random.default_rng(0).random(lattice.shape)
    light = replace(point_light((5, 90, 3)), smoke_diffusion=0.3)
    buffers = [_shadow(Launcher("cpu", n), lattice, light, density).buffer().copy() for n in (1, 2, 7)]
    np.testing.assert_array_equal(buffers[1], buffers[0])
    np.testing.assert_array_equal(buffers[2], buffers[0])
