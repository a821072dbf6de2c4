"""The picture is the one that the stage's camera takes: against USD's own camera, and as drawn."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv
from pxr import Gf
from scenes import at

import warp_smoke as ws
from warp_smoke.preview.camera import camera_view, framed_view
from warp_smoke.preview.view import look_from
from warp_smoke.record import Samples
from warp_smoke.shading.view import camera_view as ray_view

SIZES = [(160, 120), (200, 80), (80, 160)]
POINTS = np.array([(0.0, 0.0, 0.0), (0.7, 0.4, 0.2), (-0.8, 0.3, -0.5), (0.5, -0.6, 0.6), (-0.4, -0.5, 0.1)])


def _posed():
    """A camera that is turned about all three axes, rolled, scaled and off-centre."""
    matrix = Gf.Matrix4d().SetScale(2.0) * Gf.Matrix4d().SetRotate(Gf.Rotation((0, 0, 1), 20))
    matrix *= Gf.Matrix4d().SetRotate(Gf.Rotation((1, 0, 0), -25)) * Gf.Matrix4d().SetRotate(Gf.Rotation((0, 1, 0), 35))
    matrix *= Gf.Matrix4d().SetTranslate((2.9, 2.4, 4.1))
    return ws.Camera(
        path="/Eye",
        transform=np.array(matrix),
        focal_length=35.0,
        horizontal_aperture=24.0,
        vertical_aperture=18.0,
        horizontal_offset=1.5,
        vertical_offset=-1.0,
    )


def _project(camera, points, width, height):
    """Pixels (column, row) of world points through USD's camera with its aperture fitted into the picture."""
    lens = Gf.Camera()
    lens.transform = Gf.Matrix4d(camera.transform_at(1.0).tolist()).GetOrthonormalized()
    lens.focalLength = camera.focal_length
    lens.verticalAperture = max(camera.vertical_aperture, camera.horizontal_aperture * height / width)
    lens.horizontalAperture = lens.verticalAperture * width / height
    lens.horizontalApertureOffset, lens.verticalApertureOffset = camera.horizontal_offset, camera.vertical_offset
    frustum = lens.frustum
    matrix = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    clip = np.array([matrix.Transform(Gf.Vec3d(*map(float, point))) for point in points])
    return (clip[:, :2] * (1, -1) + 1) / 2 * (width, height)


@pytest.mark.parametrize("size", SIZES)
def test_marks_appear_where_usd_projects_them(open_plotter, size):
    """Small balls at known points are drawn within a pixel of where USD's camera sees them, for any aspect."""
    plotter = open_plotter(size)
    camera = _posed()
    colors = np.eye(5, 3, dtype=int) * 255 + (np.arange(5) > 2)[:, None] * np.array([[255, 255, 0]])
    colors[4] = 0, 255, 255
    for point, color in zip(POINTS, colors, strict=True):
        plotter.add_mesh(pv.Sphere(radius=0.06, center=point), color=color.tolist(), lighting=False)
    look_from(plotter, camera_view(camera, 1.0, size[0] / size[1], 5.0))
    plotter.reset_camera_clipping_range()
    picture = plotter.screenshot(None, return_img=True)
    for point, color, expected in zip(POINTS, colors, _project(camera, POINTS, *size), strict=True):
        rows, columns = np.nonzero((np.abs(picture.astype(int) - color) < 40).all(axis=2))
        assert len(rows), f"the mark at {point} is not in the picture"
        seen = columns.mean() + 0.5, rows.mean() + 0.5
        np.testing.assert_allclose(seen, expected, atol=1.0)


@pytest.mark.parametrize("up", np.eye(3))
@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.5])
def test_framed_view_holds_the_whole_box(up, aspect):
    """Without a camera the box just fits into the picture, whose up is the stage's, seen from above."""
    lower, upper = np.array([9.0, -2.0, 4.0]), np.array([12.0, 3.0, 5.0])
    view = framed_view(lower, upper, up, aspect)
    forward = view.target - view.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, view.up)
    right /= np.linalg.norm(right)
    corners = np.array([[x, y, z] for x in (9, 12) for y in (-2, 3) for z in (4, 5)]) - view.position
    depth = corners @ forward
    height = np.tan(np.radians(view.angle / 2))
    across = np.abs(corners @ right / depth) / (height * aspect)
    upright = np.abs(corners @ np.cross(right, forward) / depth) / height
    assert max(across.max(), upright.max()) == pytest.approx(1.0)
    assert view.up @ up == 1.0
    assert forward @ up < 0


def test_level_camera_looks_ahead():
    """A camera at rest looks along −Z with +Y up; its target lies ahead at the distance asked for."""
    view = camera_view(ws.Camera(path="/Eye", transform=at(1, 2, 3)), 1.0, 1.0, 4.0)
    np.testing.assert_allclose(view.position, [1, 2, 3])
    np.testing.assert_allclose(view.target, [1, 2, -1])
    np.testing.assert_allclose(view.up, [0, 1, 0])


def test_a_zoom_is_seen_in_both_pictures():
    """With numbers of the lens that change, preview and picture see at each time what a still camera sees."""
    zoom = replace(
        _posed(),
        focal_length=Samples([1, 3], [20.0, 50.0]),
        horizontal_aperture=Samples([1, 3], [30.0, 18.0]),
        vertical_offset=Samples([1, 3], [-2.0, 0.0]),
    )
    still = replace(_posed(), focal_length=35.0, horizontal_aperture=24.0, vertical_offset=-1.0)
    seen, expected = (camera_view(camera, 2.0, 1.5, 5.0) for camera in (zoom, still))
    assert (seen.angle, seen.shift) == (expected.angle, expected.shift)
    cast, rays = (ray_view(camera, np.zeros(3), 2.0, 30, 20) for camera in (zoom, still))
    assert all(getattr(cast, name) == getattr(rays, name) for name in ("start", "across", "down"))
