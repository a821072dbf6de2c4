"""Texel maps: points and normals of a surface at its texels, seams, and pictures made of values there."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import Receiver, Surface
from warp_smoke.shading.texel_picture import spread_texels
from warp_smoke.shading.texels import TexelMap

ORIGIN = np.zeros(3)


def receiver(mesh, size=16, **fields):
    """A surface to bake."""
    return Surface(path="/S", mesh=mesh, receiver=Receiver(path="/S", texture_size=size), **fields)


def at(*position):
    """A transform that moves the origin."""
    matrix = np.eye(4)
    matrix[3, :3] = position
    return matrix


def centre_uvs(size):
    """Texture coordinates of texel centres, first row at the top, [size², 2]."""
    row, column = np.divmod(np.arange(size * size), size)
    return np.stack([(column + 0.5) / size, 1 - (row + 0.5) / size], axis=1)


def test_positions_on_a_patch(launcher):
    """Each texel of a patch lies at corner + u·edge + v·edge of its centre; a flat one is flat to the last bit."""
    mesh = Mesh.grid((1, 0.1, 2), (3, 0, 0), (0, 0, -5), divisions=3)
    texels = TexelMap(launcher, receiver(mesh), ORIGIN)
    assert texels.update(1.0)
    uv = centre_uvs(16)
    points = texels.points.numpy()
    expected = np.array([1, 0.1, 2]) + uv[:, :1] * (3, 0, 0) + uv[:, 1:] * (0, 0, -5)
    np.testing.assert_allclose(points, expected, atol=2e-6)
    np.testing.assert_array_equal(points[:, 1], np.float32(0.1))
    np.testing.assert_allclose(texels.normals.numpy(), np.broadcast_to([0, 1, 0], (256, 3)), atol=1e-7)
    np.testing.assert_allclose(texels.uvs, uv, atol=1e-6)


def test_positions_do_not_depend_on_the_triangles(launcher):
    """Texel points of a patch are the same for 2 triangles and for 128, to round-off."""
    answers = []
    for divisions in (1, 8):
        mesh = Mesh.grid((0, 0, 0), (2, 1, 0), (0, 1, -2), divisions)
        texels = TexelMap(launcher, receiver(mesh, 20), ORIGIN)
        texels.update(1.0)
        answers.append(texels.points.numpy())
    np.testing.assert_allclose(*answers, atol=1e-6)


def test_normals_are_interpolated_or_flat(launcher):
    """A sphere's texels have the normals of its points; without normals each texel has its triangle's own."""
    sphere = Mesh.sphere(2.0)
    texels = TexelMap(launcher, receiver(sphere, 32), ORIGIN)
    texels.update(1.0)
    points, normals = texels.points.numpy(), texels.normals.numpy()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    # Chords of a 64-gon leave the sphere by 1.2e-3 of its radius, and interpolated normals turn with them.
    np.testing.assert_allclose(normals, points / np.linalg.norm(points, axis=1)[:, None], atol=4e-3)

    flat = TexelMap(launcher, receiver(Mesh(sphere.points, sphere.triangles, uvs=sphere.uvs), 32), ORIGIN)
    flat.update(1.0)
    assert len(np.unique(flat.normals.numpy().round(5), axis=0)) <= len(sphere.triangles)
    assert np.sum(flat.normals.numpy() * normals, axis=1).min() > 0.99


def test_transform(launcher):
    """Points go through the transform, normals through its inverse transpose, also mirrored and stretched."""
    mesh = Mesh.grid((0, 0, 0), (1, 1, 0), (0, 0, -1))
    matrix = np.diag([-2.0, 1.0, 1.0, 1.0]) @ at(5, 0, 0)
    texels = TexelMap(launcher, receiver(mesh, transform=matrix), ORIGIN)
    texels.update(1.0)
    uv = centre_uvs(16)
    expected = np.stack([5 - 2 * uv[:, 0], uv[:, 0], -uv[:, 1]], axis=1)
    np.testing.assert_allclose(texels.points.numpy(), expected, atol=2e-6)
    normal = np.array([1, 2, 0]) / np.sqrt(5)  # of the slope (−2, 1), on the side of the mirrored (−1, 1)
    np.testing.assert_allclose(texels.normals.numpy(), np.broadcast_to(normal, (256, 3)), atol=1e-6)


def test_far_from_the_origin(launcher):
    """A million units away the texels lie where they lie near the origin, to the bit."""
    mesh = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 0, -1))
    near, far = np.zeros(3), np.array([1e6, -2e6, 3e6])
    answers = []
    for place in (near, far):
        texels = TexelMap(launcher, receiver(mesh, transform=at(*place)), place)
        texels.update(1.0)
        answers.append(texels.points.numpy())
    np.testing.assert_array_equal(*answers)


def test_moves_only_with_the_surface(device):
    """Points are placed again when transform or points change, and only then."""
    patch = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 0, -1))
    bent = Samples([1, 2, 3], np.stack([patch.points, patch.points, patch.points + np.float32([0, 1, 0])]))
    still = receiver(patch)
    moved = receiver(patch, transform=Samples([1, 2, 3], np.stack([at(0, 0, 0), at(0, 0, 0), at(0, 1, 0)])))
    deformed = receiver(Mesh(bent, patch.triangles, patch.normals, patch.uvs))
    for surface, expected in ((still, [True, False, False]), (moved, [True, False, True]), (deformed,) * 2):
        expected = [True, False, True] if expected is surface else expected
        launcher = Launcher(device)
        texels = TexelMap(launcher, surface, ORIGIN)
        assert [texels.update(time) for time in (1.0, 2.0, 3.0)] == expected
        assert launcher.launches["_place_texels"] == sum(expected)
        np.testing.assert_allclose(texels.points.numpy()[:, 1], 0.0 if surface is still else 1.0)


def test_color_picture(launcher):
    """Values land in their texels, encoded as sRGB, the first row at v = 1; the nearest go on from there."""
    mesh = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 1, 0))
    uvs = mesh.uvs * 0.25 + np.float32([0.0, 0.75])  # the upper left quarter of each side
    texels = TexelMap(launcher, receiver(Mesh(mesh.points, mesh.triangles, uvs=uvs), 32), ORIGIN)
    texels.update(1.0)
    colors = np.zeros((texels.count, 3), np.float32)
    colors[:, 1] = texels.points.numpy()[:, 1]  # green is the height
    colors[:, 2] = 2.0
    picture = texels.color_picture("lit", launcher.array(colors, "test", dtype=wp.vec3))
    assert (picture.shape, picture.dtype) == ((32, 32, 3), np.uint8)
    heights = 1 - (np.arange(8) + 0.5) / 8
    encoded = np.round(255 * (1.055 * heights ** (1 / 2.4) - 0.055))
    np.testing.assert_array_equal(picture[:8, :8, 1], np.repeat(encoded[:, None], 8, axis=1))
    assert np.all(picture[..., 2] == 255)
    np.testing.assert_array_equal(picture[8:, :8, 1], picture[7, 0, 1])
    np.testing.assert_array_equal(picture[:8, 8:, 1], np.repeat(picture[:8, 7:8, 1], 24, axis=1))


def test_share_picture(launcher):
    """Shares become round(255 x), clipped; NaN is 0."""
    mesh = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 1, 0))
    texels = TexelMap(launcher, receiver(mesh, 3), ORIGIN)
    shares = np.array([0, 1, 0.5, 0.49 / 255, 0.51 / 255, -1, 2, np.nan, 254.51 / 255], np.float32)
    picture = texels.share_picture("visibility", launcher.array(shares, "test"))
    np.testing.assert_array_equal(picture, [[0, 255, 128], [0, 1, 0], [255, 0, 255]])


def test_pictures_are_not_overwritten(launcher):
    """A picture stays as it was when the next one is made."""
    texels = TexelMap(launcher, receiver(Mesh.grid((0, 0, 0), (1, 0, 0), (0, 1, 0)), 4), ORIGIN)
    black, white = (launcher.array(np.full(16, v, np.float32), "test") for v in (0.0, 1.0))
    first = texels.share_picture("visibility", black)
    texels.share_picture("visibility", white)
    assert not first.any()


def test_charts_grow_all_over_the_picture():
    """No place keeps the background, which coarser levels of a texture would mix in; each side continues its texel."""
    alone = spread_texels(np.array([10 * 21 + 10]), 21)
    np.testing.assert_array_equal(alone, 0)
    block = (np.arange(8, 12)[:, None] * 20 + np.arange(8, 12)).ravel()
    grown = spread_texels(block, 20).reshape(20, 20)
    np.testing.assert_array_equal(grown[8:12, 8:12].ravel(), np.arange(16))
    np.testing.assert_array_equal(grown[9, :8], grown[9, 8])
    np.testing.assert_array_equal(grown[12:, 10], grown[11, 10])
    np.testing.assert_array_equal(grown[:8, :8], grown[8, 8])


@given(st.integers(1, 9), st.data())
def test_places_show_the_nearest_texel(size, data):
    """None of the texels is nearer to a place than the one that it shows."""
    texel = np.array(sorted(data.draw(st.sets(st.integers(0, size**2 - 1), min_size=1))))
    row, column = np.divmod(np.arange(size**2), size)
    distances = np.hypot(row[:, None] - row[texel], column[:, None] - column[texel])
    shown = spread_texels(texel, size)
    np.testing.assert_array_equal(distances[np.arange(size**2), shown], distances.min(axis=1))


def test_seams_meet_in_the_middle():
    """Between two charts each place takes the nearer one; charts themselves are never overwritten."""
    columns = np.array([2, 9])
    row = spread_texels((np.arange(3)[:, None] * 12 + columns).ravel(), 12).reshape(12, 12)[1]
    np.testing.assert_array_equal(row, [2] * 6 + [3] * 6)


def test_full_picture_needs_no_seams():
    """Where every place has a texel, each shows its own; without any texel none shows one."""
    np.testing.assert_array_equal(spread_texels(np.arange(16), 4), np.arange(16))
    np.testing.assert_array_equal(spread_texels(np.arange(0), 4), -1)


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_same_bits_for_any_number_of_threads(threads):
    """Points, normals and pictures do not depend on the threads."""
    answers = []
    for count in (1, threads):
        launcher = Launcher("cpu", count)
        texels = TexelMap(launcher, receiver(Mesh.sphere(), 128), ORIGIN)
        texels.update(1.0)
        picture = texels.color_picture("lit", texels.normals)
        answers.append((texels.points.numpy().copy(), texels.normals.numpy().copy(), picture))
    for one, other in zip(*answers, strict=True):
        np.testing.assert_array_equal(one.view(np.uint8), other.view(np.uint8))


def test_normals_that_turn(launcher):
    """Texels of a patch whose normals turn alone take the turned ones, and are placed again for it."""
    patch = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 0, -1))
    turned = np.broadcast_to(np.float32([0, 0, 1]), patch.normals.shape)
    mesh = Mesh(patch.points, patch.triangles, Samples([1, 3], np.stack([patch.normals, turned])), patch.uvs)
    texels = TexelMap(launcher, receiver(mesh), np.zeros(3))
    half = np.sqrt(0.5)
    for time, expected in ((1, [0, 1, 0]), (2, [0, half, half]), (3, [0, 0, 1])):
        assert texels.update(time)
        np.testing.assert_allclose(texels.normals.numpy(), np.broadcast_to(expected, (texels.count, 3)), atol=1e-6)
    assert not texels.update(3)
