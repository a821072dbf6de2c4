"""Smoke in pictures: singly scattered light, ray-marched towards the eye (Beer and Lambert).

dL/ds = −σ ρ L + σ ρ S, with the light S that the smoke scatters (`volume`); light scattered twice is left out.
"""

import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.shading.view import View, pixel_ray

wp.set_module_options({"enable_backward": False})

# Transmittance below which a march ends.
_DARK = wp.constant(1.0e-3)


@wp.struct
class ScatteringSmoke:
    """Smoke in the form that the march takes.

    Attributes:
        density: at cell centres, [nx, ny, nz]; zero outside.
        light: S there, linear RGB [nx · ny · nz].
        from_set: set space to cell coordinates, for column vectors.
        extinction: optical depth of one cell's length at density 1, RGB.
        step: largest distance between samples [cells].
    """

    density: wp.array3d[float]
    light: wp.array[wp.vec3]
    from_set: wp.mat44
    extinction: wp.vec3
    step: float


def march_smoke(
    launcher: Launcher,
    count: int,
    smoke: ScatteringSmoke,
    view: View,
    place: tuple[float, float],
    passed: wp.array,
    distance: wp.array,
    color: wp.array,
) -> None:
    """Composites smoke in front of what each pixel shows.

    Args:
        launcher: where to compute.
        count: number of pixels.
        smoke: the smoke.
        view: the camera.
        place: of the ray in the pixel, (x, y).
        passed: distance at which each ray begins, negative for the eye, [n].
        distance: distance at which it ends, [n].
        color: linear RGB of what lies behind, [n] vec3; the smoke is composited over it.
    """
    launcher.launch_each(_march_smoke, count, smoke, view, *place, passed, distance, color)


@wp.func
def _part_inside(smoke: ScatteringSmoke, start: wp.vec3, ray: wp.vec3, near: float, far: float):
    """The part of a ray in the box, between two distances along it [cells]; none if its end is not beyond its entry."""
    entry = near
    end = far
    for axis in range(3):
        # A ray along a side of the box must not become 0 · ∞.
        inverse = 1.0 / wp.where(wp.abs(ray[axis]) < 1.0e-12, 1.0e-12, ray[axis])
        low = -start[axis] * inverse
        high = (float(smoke.density.shape[axis]) - start[axis]) * inverse
        entry = wp.max(entry, wp.min(low, high))
        end = wp.min(end, wp.max(low, high))
    return entry, end


@wp.func
def _smoke_at(smoke: ScatteringSmoke, at: wp.vec3):
    """Density ρ, and light times density ρ S, at a position in cells: trilinear between cell centres."""
    ni = smoke.density.shape[0]
    nj = smoke.density.shape[1]
    nk = smoke.density.shape[2]
    u = wp.clamp(at[0] - 0.5, 0.0, float(ni - 1))
    v = wp.clamp(at[1] - 0.5, 0.0, float(nj - 1))
    w = wp.clamp(at[2] - 0.5, 0.0, float(nk - 1))
    i = wp.min(int(u), wp.max(ni - 2, 0))
    j = wp.min(int(v), wp.max(nj - 2, 0))
    k = wp.min(int(w), wp.max(nk - 2, 0))
    f = u - float(i)
    g = v - float(j)
    h = w - float(k)
    density = wp.float32(0.0)
    light = wp.vec3(0.0)
    for corner in range(8):
        a = corner // 4
        b = (corner // 2) % 2
        c = corner % 2
        weight = wp.where(a == 1, f, 1.0 - f) * wp.where(b == 1, g, 1.0 - g) * wp.where(c == 1, h, 1.0 - h)
        if weight > 0.0:
            ca = wp.min(i + a, ni - 1)
            cb = wp.min(j + b, nj - 1)
            cc = wp.min(k + c, nk - 1)
            rho = smoke.density[ca, cb, cc]
            density += weight * rho
            light += weight * rho * smoke.light[(ca * nj + cb) * nk + cc]
    return density, light


@wp.kernel
def _march_smoke(
    rows: Rows,
    smoke: ScatteringSmoke,
    view: View,
    x: float,
    y: float,
    passed: wp.array[float],
    distance: wp.array[float],
    color_inout: wp.array[wp.vec3],
):
    """L = Σ_m T_m (1 − e^(−σ ρ_m Δ)) S_m + T_end L_behind, samples in the middle of steps Δ ≤ step."""
    p = rows.first + wp.tid()
    direction = pixel_ray(view, p, x, y)
    start = wp.transform_point(smoke.from_set, view.eye)
    ray = wp.transform_vector(smoke.from_set, direction)
    lengthening = wp.length(ray)  # cells for each unit of distance
    ray /= lengthening
    entry, end = _part_inside(smoke, start, ray, wp.max(passed[p], 0.0) * lengthening, distance[p] * lengthening)
    if end > entry:
        steps = int(wp.ceil((end - entry) / smoke.step))
        length = (end - entry) / float(steps)
        through = wp.vec3(1.0)
        scattered = wp.vec3(0.0)
        for m in range(steps):
            density, light = _smoke_at(smoke, start + (entry + (float(m) + 0.5) * length) * ray)
            if density > 0.0:
                tau = density * length * smoke.extinction
                left = wp.vec3(wp.exp(-tau[0]), wp.exp(-tau[1]), wp.exp(-tau[2]))
                # Light is weighted by density, so that it is the smoke's and not that of empty cells beside it.
                scattered += wp.cw_mul(through, wp.cw_mul(wp.vec3(1.0) - left, light / density))
                through = wp.cw_mul(through, left)
                if wp.max(through) < _DARK:
                    through = wp.vec3(0.0)
                    break
        color_inout[p] = scattered + wp.cw_mul(through, color_inout[p])
