"""Sums of each light's radiance, times the shares of it that surfaces and smoke let through."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})

_LUMINANCE = wp.constant(wp.vec3(0.2126, 0.7152, 0.0722))  # of linear Rec. 709 RGB


@wp.struct
class Shares:
    """Shares of lights that are let through, at n points.

    Attributes:
        values: [rows, n].
        row: rows of each light for red, green and blue; −1 where all of it is let through.
    """

    values: wp.array2d[float]
    row: wp.array[wp.vec3i]


def make_shares(launcher: Launcher, channels: Sequence[int], count: int) -> tuple[Shares, list[wp.array | None]]:
    """Makes shares of 1 for each light and point, and a view of each light's rows.

    Args:
        launcher: where to allocate.
        channels: rows of each light: 0 without shadows, 1, or 3 for red, green and blue.
        count: number of points.
    """
    first = np.cumsum(channels) - channels
    rows = [f + np.arange(3) % c if c else np.full(3, -1) for f, c in zip(first, channels, strict=True)]
    shares = Shares()
    shares.values = launcher.array(np.ones((sum(channels), max(count, 1)), np.float32), "bake")
    shares.row = launcher.array(np.array(rows, np.int32).reshape(-1, 3), "bake", dtype=wp.vec3i)
    views = [shares.values[int(f) : int(f) + c] if c else None for f, c in zip(first, channels, strict=True)]
    return shares, views


def add_lights(
    launcher: Launcher,
    points: wp.array,
    flags: wp.array,
    unlit: wp.array,
    radiance: wp.array,
    visibility: Shares,
    transmittance: Shares,
    lit_out: wp.array,
) -> None:
    """Writes the light at some points, linear RGB [k] vec3.

    Args:
        launcher: where to compute.
        points: which of the n points, [k].
        flags: 0 for those of them that are left as they are, [k] uint8.
        unlit: light without any of the lights, [n] vec3.
        radiance: of each light, [lights, n] vec3.
        visibility: at all n points.
        transmittance: at those k points.
        lit_out: [k] vec3, or longer.
    """
    launcher.launch_each(_add_lights, len(points), points, flags, unlit, radiance, visibility, transmittance, lit_out)


def average_visibility(launcher: Launcher, weights: wp.array, visibility: Shares, shares_out: wp.array) -> None:
    """Writes the mean share that surfaces let through, [n]; `weights` of the lights are [lights, n]."""
    launcher.launch_each(_average_visibility, len(shares_out), weights, visibility, shares_out)


def average_transmittance(
    launcher: Launcher,
    points: wp.array,
    flags: wp.array,
    weights: wp.array,
    visibility: Shares,
    transmittance: Shares,
    shares_out: wp.array,
) -> None:
    """Writes the mean share that smoke lets through at some points; see `add_lights` for the arguments."""
    args = (points, flags, weights, visibility, transmittance, shares_out)
    launcher.launch_each(_average_transmittance, len(points), *args)


def find_changes(launcher: Launcher, now: Shares, before_inout: Shares, flags_out: wp.array) -> None:
    """Flags the points at which any share has changed, [k] uint8, and updates `before`."""
    launcher.launch_each(_find_changes, len(flags_out), now.values, before_inout.values, flags_out)


@wp.func
def share_at(shares: Shares, light: int, s: int):
    """The share of a light that is let through, as red, green and blue."""
    row = shares.row[light]
    if row[0] < 0:
        return wp.vec3(1.0, 1.0, 1.0)
    return wp.vec3(shares.values[row[0], s], shares.values[row[1], s], shares.values[row[2], s])


@wp.kernel
def _add_lights(
    rows: Rows,
    points: wp.array[int],
    flags: wp.array[wp.uint8],
    unlit: wp.array[wp.vec3],
    radiance: wp.array2d[wp.vec3],
    visibility: Shares,
    transmittance: Shares,
    lit_out: wp.array[wp.vec3],
):
    """lit[q] = unlit[s] + Σ V[s] ⊗ T[q] ⊗ radiance[s] with s = points[q]."""
    q = rows.first + wp.tid()
    if flags[q] == wp.uint8(0):
        return
    s = points[q]
    lit = unlit[s]
    for light in range(radiance.shape[0]):
        passed = wp.cw_mul(share_at(visibility, light, s), share_at(transmittance, light, q))
        lit += wp.cw_mul(passed, radiance[light, s])
    lit_out[q] = lit


@wp.kernel
def _average_visibility(rows: Rows, weights: wp.array2d[float], visibility: Shares, shares_out: wp.array[float]):
    """shares[s] = Σ w V / Σ w, or 1."""
    s = rows.first + wp.tid()
    total = wp.float32(0.0)  # a literal could not change in the loop
    passed = wp.float32(0.0)
    for light in range(weights.shape[0]):
        w = weights[light, s]
        total += w
        passed += w * share_at(visibility, light, s)[0]
    shares_out[s] = wp.where(total > 0.0, passed / total, 1.0)


@wp.kernel
def _average_transmittance(
    rows: Rows,
    points: wp.array[int],
    flags: wp.array[wp.uint8],
    weights: wp.array2d[float],
    visibility: Shares,
    transmittance: Shares,
    shares_out: wp.array[float],
):
    """shares[q] = Σ w V T / Σ w V, or 1, with w and V at s = points[q], T at q."""
    q = rows.first + wp.tid()
    if flags[q] == wp.uint8(0):
        return
    s = points[q]
    total = wp.float32(0.0)  # a literal could not change in the loop
    passed = wp.float32(0.0)
    for light in range(weights.shape[0]):
        w = weights[light, s] * share_at(visibility, light, s)[0]
        total += w
        passed += w * wp.dot(_LUMINANCE, share_at(transmittance, light, q))
    shares_out[q] = wp.where(total > 0.0, passed / total, 1.0)


@wp.kernel
def _find_changes(rows: Rows, now: wp.array2d[float], before_inout: wp.array2d[float], flags_out: wp.array[wp.uint8]):
    """flags[q] = any share(q) ≠ before(q), then before = now."""
    q = rows.first + wp.tid()
    changed = wp.uint8(0)
    for row in range(now.shape[0]):
        if now[row, q] != before_inout[row, q]:
            changed = wp.uint8(1)
            before_inout[row, q] = now[row, q]
    flags_out[q] = changed
