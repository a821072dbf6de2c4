"""Shading: highlights per vertex and per pixel, normal maps, parallax, and the reflected share of the light.

Each is measured on points, against formulas in double precision.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from warp_smoke.study.case import Case, Row, fit_orders
from warp_smoke.study.reflection import measure_albedo, measure_pixels, measure_vertices
from warp_smoke.study.relief import (
    HEIGHT_TEXELS,
    measure_heights,
    measure_looked_up,
    measure_parallax,
    measure_stored,
)
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
_DEGREES = (20, 40, 60, 75)  # of the eye from the normal
_EXPONENTS = (16, 64)
_REFLECTIONS = ("blinnPhong", "energyConserving")


def cases(full: bool) -> list[Case]:
    """Balls of 8 to 128 segments (`full`: 256), maps of 32² to 256² texels (1024²), 25 to 400 angles."""
    found = []

    def add(problem: str, method: str, parameters: dict, resolution: int, measure: Callable) -> None:
        found.append(Case(SUITE, problem, method, parameters, resolution, None, measure))

    for segments in (8, 16, 32, 64, 128, *[256] * full):
        add(HIGHLIGHT, "each vertex", {}, segments, partial(measure_vertices, segments))
        add(HIGHLIGHT, "each pixel", {}, segments, partial(measure_pixels, segments))
    for texels in (32, 64, 128, 256, *[512, 1024] * full):
        add(NORMALS, "from heights", {}, texels, partial(measure_heights, texels))
        add(NORMALS, "stored in 8 bits", {}, texels, partial(measure_stored, texels))
        add(NORMALS, "looked up between texels", {}, texels, partial(measure_looked_up, texels))
    for parallax in ("none", "offset", "occlusion"):
        for degrees in _DEGREES:
            measure = partial(measure_parallax, parallax, degrees)
            add(PARALLAX, parallax, {"degrees": degrees}, HEIGHT_TEXELS, measure)
    for exponent in _EXPONENTS:
        for reflection in _REFLECTIONS:
            for angles in (25, 50, 100, 200, 400):
                measure = partial(measure_albedo, exponent, reflection, angles)
                add(f"{ALBEDO}, exponent {exponent}", reflection, {}, angles, measure)
    return found


def order(rows: Sequence[Row]) -> Mapping[tuple[str, str], float]:
    """Returns the orders in the size of triangles, texels and angles; storage in 8 bits has none."""
    fitted = fit_orders(rows, MAIN_ERROR)
    return {line: slope for line, slope in fitted.items() if line[1] in _ORDERS}


# Light interpolated from corners is of second order once triangles are smaller than the highlight, and steeper where
# they begin to be; the quadrature is measured down to the limit of float32.
_ORDERS = {
    "each vertex": (1.2, 2.4),
    "each pixel": (1.8, 2.4),
    "from heights": (1.9, 2.1),
    "blinnPhong": (1.8, 2.2),
    "energyConserving": (1.8, 2.2),
}
# Rounding 127.5 (n + 1) is off by at most half a code in each of three components.
_HALF_A_CODE = 3.0**0.5 / 255.0


def unexpected(rows: Sequence[Row]) -> list[str]:
    """Returns a line for each formula that the rows contradict."""
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
    """Explains how to read the diagram, and what it shows."""
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
