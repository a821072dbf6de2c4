"""Shading: highlights by vertex and by pixel, normal maps, parallax, and the reflected share of the light.

Each is measured on points, against formulas in double precision.
"""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np
import warp as wp
from PIL import Image

from warp_smoke.geometry import Mesh, normalized
from warp_smoke.launch import Launcher
from warp_smoke.material import Material, Texture
from warp_smoke.scene import DistantLight, PointLight
from warp_smoke.shading.normal_map import decode_normals, encode_normals, height_normals
from warp_smoke.shading.primary_rays import Hits, interpolate_corners
from warp_smoke.study.case import Case, Measured, Row, fit_orders, time_repeats
from warp_smoke.study.light_answers import (
    blinn_phong,
    blinn_phong_albedo,
    difference,
    wave_heights,
    wave_normals,
)
from warp_smoke.study.shaded_points import on_square, place_points, source_of
from warp_smoke.study.shadow_scenes import shine
from warp_smoke.study.smoke_plume import at
from warp_smoke.study.words import percent

SUITE = "shading"
TITLE = "Shading"
MAIN_ERROR = "relative_l2"
ERROR_MEANS = "relative error of the reflected share"

HIGHLIGHT, NORMALS, PARALLAX, ALBEDO = "highlight on a ball", "normal map of waves", "parallax of waves", "albedo"
PANEL_ERRORS = {
    HIGHLIGHT: (MAIN_ERROR, "relative L2 error of the light"),
    NORMALS: (MAIN_ERROR, "error of directions [rad] (root mean square)"),
    PARALLAX: (MAIN_ERROR, "error as a share of the shift (root mean square)"),
}
_POINTS = 40_000
# Of the ball: exponent 64, a light and an eye three radii away.
_ROUGHNESS, _DIFFUSE, _R0 = 0.75, (0.2, 0.3, 0.4), (0.04, 0.04, 0.04)
_LAMP, _EYE = np.array([2.0, 2.0, 1.0]), np.array([-0.5, 1.0, 2.8])
_AMPLITUDE = 0.05
_RAW = {"color_space": "raw"}
_DIRECTIONS = _RAW | {"scale": (2.0, 2.0, 2.0, 1.0), "bias": (-1.0, -1.0, -1.0, 0.0)}
# Of the relief: depth, texels of its heights, and the eye's directions from the normal.
_DEPTH, _HEIGHT_TEXELS, _DEGREES = 0.06, 256, (20, 40, 60, 75)
_EXPONENTS = (16, 64)
_REFLECTIONS = ("blinnPhong", "energyConserving")


def cases(full: bool) -> list[Case]:
    """Balls of 8 to 128 segments (`full`: 256), maps of 32² to 256² texels (1024²), 25 to 400 angles."""
    found = []

    def add(problem: str, method: str, parameters: dict, resolution: int, measure: Callable) -> None:
        found.append(Case(SUITE, problem, method, parameters, resolution, None, measure))

    for segments in (8, 16, 32, 64, 128, *[256] * full):
        add(HIGHLIGHT, "each vertex", {}, segments, partial(_measure_vertices, segments))
        add(HIGHLIGHT, "each pixel", {}, segments, partial(_measure_pixels, segments))
    for texels in (32, 64, 128, 256, *[512, 1024] * full):
        add(NORMALS, "from heights", {}, texels, partial(_measure_heights, texels))
        add(NORMALS, "stored in 8 bits", {}, texels, partial(_measure_stored, texels))
        add(NORMALS, "looked up between texels", {}, texels, partial(_measure_looked_up, texels))
    for parallax in ("none", "offset", "occlusion"):
        for degrees in _DEGREES:
            measure = partial(_measure_parallax, parallax, degrees)
            add(PARALLAX, parallax, {"degrees": degrees}, _HEIGHT_TEXELS, measure)
    for exponent in _EXPONENTS:
        for reflection in _REFLECTIONS:
            for angles in (25, 50, 100, 200, 400):
                measure = partial(_measure_albedo, exponent, reflection, angles)
                add(f"{ALBEDO}, exponent {exponent}", reflection, {}, angles, measure)
    return found


def _ball(segments: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A ball's triangles [m, 3, 3], and points seen from the eye: triangle, weights of corners, and truth."""
    mesh = Mesh.sphere(1.0, segments)
    corners = mesh.points_at(1.0).astype(np.float64)[mesh.triangles]
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangle = rng.choice(len(area), _POINTS, p=area / area.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), _POINTS)
    place = normalized(np.sum(weights[:, :, None] * corners[triangle], axis=1))
    seen = np.sum((_EYE - place) * place, axis=1) > 0.0
    place = place[seen]
    to_light, distance = normalized(_LAMP - place), np.linalg.norm(_LAMP - place, axis=1)
    colors = 1.0 / distance[:, None] ** 2, np.array(_DIFFUSE), np.array(_R0)
    truth = blinn_phong(to_light, normalized(_EYE - place), place, *colors, 256.0 * (1.0 - _ROUGHNESS))
    return corners, triangle[seen], weights[seen], truth


def _gloss() -> tuple[Material, PointLight]:
    """The ball's material and its light, of B = 1/d²."""
    lamp = PointLight(path="/Lamp", transform=at(*_LAMP), intensity=4.0 * np.pi)
    return Material(diffuse_color=_DIFFUSE, fresnel_r0=_R0, roughness=_ROUGHNESS), lamp


def _measure_pixels(segments: int, launcher: Launcher, repeats: int) -> Measured:
    corners, triangle, weights, truth = _ball(segments)
    material, lamp = _gloss()
    positions, normals = (np.sum(weights[:, :, None] * a[triangle], axis=1) for a in (corners, normalized(corners)))
    arrays = {"positions": positions, "normals": normalized(normals)}
    points, source = place_points(launcher, material, _EYE, arrays), source_of(lamp)

    def shade() -> None:
        points.look_up()
        points.shade(source)

    seconds = time_repeats(launcher, shade, repeats)
    return Measured(difference(points.radiance.numpy(), truth), seconds, points.count)


def _measure_vertices(segments: int, launcher: Launcher, repeats: int) -> Measured:
    corners, triangle, weights, truth = _ball(segments)
    material, lamp = _gloss()
    arrays = {"positions": corners.reshape(-1, 3), "normals": normalized(corners.reshape(-1, 3))}
    points, source = place_points(launcher, material, _EYE, arrays), source_of(lamp)
    hits, count = Hits(), len(triangle)
    hits.triangle = launcher.array(triangle.astype(np.int32), "study")
    hits.weights = launcher.array(weights[:, 1:].astype(np.float32), "study", dtype=wp.vec2)
    hits.distance = launcher.zeros(count, "study")
    radiance = launcher.zeros(count, "study", dtype=wp.vec3)

    def shade() -> None:
        points.look_up()
        points.shade(source)
        interpolate_corners(launcher, count, hits, points.radiance, wp.vec3(0.0, 0.0, 0.0), radiance)

    seconds = time_repeats(launcher, shade, repeats)
    return Measured(difference(radiance.numpy(), truth), seconds, count)


def _waves(texels: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights at the centres of texels, first row at the top, and their exact normals."""
    along = (np.arange(texels) + 0.5) / texels
    x, y = np.meshgrid(along, along[::-1])
    return wave_heights(x, y, _AMPLITUDE), wave_normals(x, y, _AMPLITUDE)


def _measure_heights(texels: int, launcher: Launcher, repeats: int) -> Measured:
    heights, truth = _waves(texels)
    seconds = time_repeats(launcher, lambda: height_normals(heights, 1.0, 1.0), repeats)
    return Measured(difference(height_normals(heights, 1.0, 1.0), truth, 1.0), seconds, texels**2)


def _measure_stored(texels: int, launcher: Launcher, repeats: int) -> Measured:
    heights, truth = _waves(texels)

    def store() -> np.ndarray:
        return decode_normals(encode_normals(height_normals(heights, 1.0, 1.0)))

    return Measured(difference(store(), truth, 1.0), time_repeats(launcher, store, repeats), texels**2)


def _measure_looked_up(texels: int, launcher: Launcher, repeats: int) -> Measured:
    uvs = np.random.default_rng(0).random((_POINTS, 2)).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "normals.png")
        Image.fromarray(encode_normals(height_normals(_waves(texels)[0], 1.0, 1.0))).save(file)
        material = Material(normal_texture=Texture(file=str(file), **_DIRECTIONS))
        points = place_points(launcher, material, np.array([0.5, 10.0, -0.5]), on_square(uvs))
    seconds = time_repeats(launcher, points.look_up, repeats)
    x, y, z = points.detail.normals.numpy().T  # the map's z is the square's y, and its y −z
    truth = wave_normals(*uvs.T.astype(np.float64), _AMPLITUDE)
    return Measured(difference(np.stack([x, -z, y], axis=1), truth, 1.0), seconds, _POINTS)


def _relief_height(uv: np.ndarray) -> np.ndarray:
    """Of the relief, 0 to 1, at texture coordinates [n, 2]."""
    return 0.5 + wave_heights(2.0 * uv[:, 0], 2.0 * uv[:, 1], 0.5)


@cache
def _relief_uvs(degrees: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Direction to the eye, texture coordinates, and those at which the line of sight meets the relief first."""
    angle, turn = np.radians(degrees), np.radians(30.0)
    to_eye = np.array([np.sin(angle) * np.cos(turn), np.cos(angle), -np.sin(angle) * np.sin(turn)])
    slope = np.tan(angle) * np.array([np.cos(turn), np.sin(turn)])
    uv = np.random.default_rng(0).uniform(0.3, 0.7, (_POINTS // 4, 2))

    def gap(z: np.ndarray) -> np.ndarray:
        return z - _DEPTH * (_relief_height(uv + z[:, None] * slope) - 1.0)

    above, below = np.zeros(len(uv)), np.full(len(uv), -_DEPTH)
    met = np.zeros(len(uv), bool)
    for z in np.linspace(0.0, -_DEPTH, 500):
        here = np.full(len(uv), z)
        under = gap(here) <= 0.0
        below = np.where(under & ~met, z, below)
        met |= under
        above = np.where(met, above, z)
    for _ in range(40):
        middle = 0.5 * (above + below)
        free = gap(middle) > 0.0
        above, below = np.where(free, middle, above), np.where(free, below, middle)
    return to_eye, uv, uv + below[:, None] * slope


def _measure_parallax(parallax: str, degrees: int, launcher: Launcher, repeats: int) -> Measured:
    to_eye, uv, truth = _relief_uvs(degrees)
    along = (np.arange(_HEIGHT_TEXELS) + 0.5) / _HEIGHT_TEXELS
    u, v = np.meshgrid(along, along[::-1])
    heights = _relief_height(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(u.shape)
    # 256 codes in 256 texels: between them the picture says the texture coordinates exactly.
    ramp = np.dstack([np.rint(256.0 * a - 0.5) for a in (u, v, 0.5 / 256.0 + 0.0 * u)]).astype(np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        Image.fromarray(np.rint(65535.0 * heights).astype(np.uint16)).save(Path(folder, "heights.png"))
        Image.fromarray(ramp).save(Path(folder, "ramp.png"))
        material = Material(
            diffuse_texture=Texture(file=str(Path(folder, "ramp.png")), wrap_s="clamp", wrap_t="clamp", **_RAW),
            height_texture=Texture(file=str(Path(folder, "heights.png")), **_RAW),
            parallax=parallax,
            parallax_scale=_DEPTH,
            parallax_bias=-_DEPTH,
        )
        points = place_points(launcher, material, 1e4 * to_eye, on_square(uv))
    seconds = time_repeats(launcher, points.look_up, repeats)
    found = (255.0 * points.detail.diffuse.numpy()[:, :2] + 0.5) / 256.0
    shift = float(np.sqrt(np.mean((truth - uv) ** 2)))
    return Measured(difference(found, truth, shift), seconds, points.count)


def _measure_albedo(exponent: int, reflection: str, angles: int, launcher: Launcher, repeats: int) -> Measured:
    """The midpoint rule over the eye's angle: the light is along the normal, and a mirror reflects all colours."""
    angle = (np.arange(angles) + 0.5) * (0.5 * np.pi / angles)
    to_eye = np.stack([np.sin(angle), np.cos(angle), np.zeros(angles)], axis=1)
    material = Material(
        diffuse_color=(0.0,) * 3, fresnel_r0=(1.0,) * 3, roughness=1.0 - exponent / 256.0, reflection=reflection
    )
    sun = DistantLight(path="/Sun", transform=shine((0.0, -1.0, 0.0)), intensity=np.pi)
    arrays = {"positions": -to_eye, "normals": np.tile([0.0, 1.0, 0.0], (angles, 1))}
    points, source = place_points(launcher, material, np.zeros(3), arrays), source_of(sun)

    def shade() -> None:
        points.look_up()
        points.shade(source)

    seconds = time_repeats(launcher, shade, repeats)
    # B = 1 is an irradiance of π; radiance goes out through 2π sin θ cos θ dθ.
    share = np.sum(points.radiance.numpy()[:, 0] * np.sin(2.0 * angle)) * (0.5 * np.pi / angles)
    truth = blinn_phong_albedo(exponent) if reflection == "blinnPhong" else 1.0
    return Measured(difference(np.array([share]), np.array([truth])), seconds, angles)


def order(rows: Sequence[Row]) -> Mapping[tuple[str, str], float]:
    """Orders in the size of triangles, texels and angles; storing in 8 bits ends them."""
    fitted = fit_orders(rows, MAIN_ERROR)
    return {line: slope for line, slope in fitted.items() if line[1] in _ORDERS}


# Light interpolated from corners is of second order once triangles are smaller than the highlight, where its slope is
# steeper; the quadrature is measured down to where float32 ends it.
_ORDERS = {
    "each vertex": (1.2, 2.4),
    "each pixel": (1.8, 2.4),
    "from heights": (1.9, 2.1),
    "blinnPhong": (1.8, 2.2),
    "energyConserving": (1.8, 2.2),
}
# 127.5 (n + 1) rounded is off by half a code in each of three components.
_HALF_A_CODE = 3.0**0.5 / 255.0


def unexpected(rows: Sequence[Row]) -> list[str]:
    """What formulas say and the rows do not show."""
    found = []
    for (problem, method), slope in order(rows).items():
        low, high = _ORDERS[method]
        if not low <= slope <= high:
            found.append(f"{problem}, {method}: order {slope:.2f}; it is 2")
    good = [row for row in rows if row.failure is None]
    errors = {(row.problem, row.method, row.resolution, str(row.parameters)): row.errors for row in good}
    for row in good:
        place = f"{row.problem}, {row.method}, {row.resolution}"
        if row.method == "each pixel":
            vertex = errors.get((row.problem, "each vertex", row.resolution, str(row.parameters)))
            if vertex is not None and row.errors[MAIN_ERROR] >= vertex[MAIN_ERROR]:
                found.append(f"{place}: no nearer than light at each vertex")
        if row.method == "stored in 8 bits":
            exact = errors.get((row.problem, "from heights", row.resolution, str(row.parameters)))
            if exact is not None and row.errors["linf"] > exact["linf"] + _HALF_A_CODE:
                found.append(f"{place}: {row.errors['linf']:.4f} off; codes add {_HALF_A_CODE:.4f} at most")
        if row.problem == PARALLAX and row.method == "none" and abs(row.errors[MAIN_ERROR] - 1.0) > 1e-3:
            found.append(f"{place}: {row.errors[MAIN_ERROR]:.3f} of the shift; without parallax it is all of it")
        if row.problem == PARALLAX and row.method == "occlusion" and row.errors[MAIN_ERROR] > 0.1:
            found.append(f"{place}: {row.errors[MAIN_ERROR]:.3f} of the shift; marched heights are within a tenth")
    return found


def explain(rows: Sequence[Row]) -> str:
    """How to read the diagram, and what it says."""
    text = (
        "Each line is a way to shade, and each point a number of triangles, texels or angles: lower is nearer to the "
        "formula in double precision, further left is faster."
    )
    good = [row for row in rows if row.failure is None]
    said = []
    coarse = {row.method: row for row in good if row.problem == HIGHLIGHT and row.resolution == 16}
    if len(coarse) == 2:
        vertex, pixel = (coarse[name].errors[MAIN_ERROR] for name in ("each vertex", "each pixel"))
        said.append(
            f"on a ball of 16 segments light at each vertex is {percent(vertex)} off and at each pixel {percent(pixel)}"
        )
    steep = [row for row in good if row.problem == PARALLAX and row.parameters["degrees"] == 60]
    if steep:
        by = {row.method: row.errors[MAIN_ERROR] for row in steep}
        said.append(
            "60° from the normal "
            + " and ".join(f"{name} misses {percent(by[name])} of the shift" for name in ("offset", "occlusion"))
        )
    return text + (f" Here {'; '.join(said)}." if said else "")
