"""Look-ups in a distant light's orthographic depth map (after LearnOpenGL, *Shadow Mapping*)."""

import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.shadow.bias import Bias, fixed_bias, plane_normal, tangent
from warp_smoke.shadow.caster_mask import CasterMask, may_be_shadowed
from warp_smoke.shadow.filters import Taps
from warp_smoke.shadow.umbra import deepest_within

wp.set_module_options({"enable_backward": False})

_FARTHEST_TAP = wp.constant(3.0**0.5)  # of the offsets of fixed filters, in half-widths


@wp.struct
class DirectionalMap:
    """An orthographic depth map; set space · (s_axis, t_axis, direction) gives (s, t, depth) [stage units].

    Attributes:
        depth: (depth of the nearest surface − near) / (far − near) at texel centres, 1 where there is none,
            [1, size, size].
        deepest: largest `depth` in each tile, [1, rows, columns]; 1 where nothing was traced.
        s_axis, t_axis, direction: unit vectors: to the right and down in the map, and the direction of the light.
        s, t: of the map's upper left corner.
        texel: side of a texel.
        near, far: depth range.
        bias: how much deeper than the stored depth a point must lie to be in shadow.
    """

    depth: wp.array3d[float]
    deepest: wp.array3d[float]
    s_axis: wp.vec3
    t_axis: wp.vec3
    direction: wp.vec3
    s: float
    t: float
    texel: float
    near: float
    far: float
    bias: Bias


@wp.func
def stored_depth(m: DirectionalMap, point: wp.vec3):
    """The depth beyond `near` stored where a point falls; 1e30 outside the map and where nothing was hit."""
    s = (wp.dot(point, m.s_axis) - m.s) / m.texel
    t = (wp.dot(point, m.t_axis) - m.t) / m.texel
    stored = wp.float32(1.0)
    if s >= 0.0 and t >= 0.0 and s < float(m.depth.shape[2]) and t < float(m.depth.shape[1]):
        stored = m.depth[0, int(t), int(s)]
    return wp.where(stored < 1.0, stored * (m.far - m.near), 1.0e30)


@wp.func
def nearest_of_texel(m: DirectionalMap, point: wp.vec3, normal: wp.vec3, cosine: float, offset: wp.vec3):
    """The least depth beyond `near`, less the bias, of the plane through a point within the texel at an offset.

    The bias is spread · tan θ, spread being half a texel's diagonal. A light's own bias is subtracted from the point's
    depth.
    """
    d = wp.dot(point, m.direction) - m.near - fixed_bias(m.bias, cosine)
    if m.bias.spread > 0.0:
        along = wp.dot(offset, m.s_axis) * wp.dot(normal, m.s_axis)
        along += wp.dot(offset, m.t_axis) * wp.dot(normal, m.t_axis)
        d += along / wp.max(cosine, 1.0e-6) - m.bias.spread * tangent(cosine)
    return d


@wp.func
def in_umbra(m: DirectionalMap, point: wp.vec3, normal: wp.vec3, cosine: float, reach: float):
    """Whether everything within `reach` of a point lies deeper than the stored depths there; false if uncertain."""
    s = (wp.dot(point, m.s_axis) - m.s) / m.texel
    t = (wp.dot(point, m.t_axis) - m.t) / m.texel
    deepest = deepest_within(m.deepest, m.depth.shape[1], 0, s, t, reach / m.texel)
    found = wp.bool(False)
    if deepest < 1.0:
        least = nearest_of_texel(m, point, normal, cosine, wp.vec3())
        if m.bias.spread > 0.0:
            least -= reach * tangent(cosine)
        found = least > deepest * (m.far - m.near)
    return found


@wp.func
def share_of_taps(m: DirectionalMap, taps: Taps, point: wp.vec3, normal: wp.vec3, cosine: float, reach: float):
    """The share of lit taps of a filter that is 2 · reach wide."""
    lit = wp.float32(0.0)
    for k in range(taps.offsets.shape[0]):
        o = reach * taps.offsets[k]
        if nearest_of_texel(m, point, normal, cosine, o) <= stored_depth(m, point + o):
            lit += 1.0
    return lit / float(taps.offsets.shape[0])


@wp.kernel
def _filter_taps(
    rows: Rows,
    m: DirectionalMap,
    mask: CasterMask,
    taps: Taps,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    facets: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """visibility[n] = share of taps that are lit."""
    n = rows.first + wp.tid()
    p = points[n]
    visible = wp.float32(0.0)
    if wp.dot(m.direction, normals[n]) < 0.0:
        visible = wp.float32(1.0)
        normal = plane_normal(normals[n], facets[n], m.direction)
        cosine = -wp.dot(m.direction, normal)
        if wp.dot(p, m.direction) <= m.far and may_be_shadowed(mask, p):
            reach = taps.radius * (1.0 + taps.growth * wp.length(p - taps.eye)) + taps.texels * m.texel
            if in_umbra(m, p, normal, cosine, _FARTHEST_TAP * reach):
                visible = wp.float32(0.0)
            else:
                visible = share_of_taps(m, taps, p, normal, cosine, reach)
    visibility_out[n] = visible


@wp.kernel
def _filter_penumbra(
    rows: Rows,
    m: DirectionalMap,
    mask: CasterMask,
    taps: Taps,
    spread: float,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    facets: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """Percentage-closer soft shadows (Fernando, 2005): blockers at mean depth b widen the filter to spread (d − b)."""
    n = rows.first + wp.tid()
    p = points[n]
    visible = wp.float32(0.0)
    if wp.dot(m.direction, normals[n]) < 0.0:
        visible = wp.float32(1.0)
        normal = plane_normal(normals[n], facets[n], m.direction)
        cosine = -wp.dot(m.direction, normal)
        d = wp.dot(p, m.direction) - m.near
        if d <= m.far - m.near and may_be_shadowed(mask, p):
            smallest = taps.texels * m.texel
            reach = wp.max(spread * d, smallest)
            total = wp.float32(0.0)
            blockers = wp.float32(0.0)
            if in_umbra(m, p, normal, cosine, reach):
                visible = wp.float32(0.0)
            else:
                for k in range(taps.offsets.shape[0]):
                    o = reach * taps.offsets[k]
                    stored = stored_depth(m, p + o)
                    if nearest_of_texel(m, p, normal, cosine, o) > stored:
                        blockers += 1.0
                        total += stored
            if blockers > 0.0:
                reach = wp.max(spread * (d - total / blockers), smallest)
                visible = share_of_taps(m, taps, p, normal, cosine, reach)
    visibility_out[n] = visible


def filter_map(launcher: Launcher, m: DirectionalMap, mask: CasterMask, taps: Taps, *look: wp.array) -> None:
    """Computes visibility by a fixed filter; `look` is points, normals, facet normals and visibility_out, [n] each."""
    launcher.launch_each(_filter_taps, len(look[0]), m, mask, taps, *look)


def filter_penumbra(
    launcher: Launcher, m: DirectionalMap, mask: CasterMask, taps: Taps, spread: float, *look: wp.array
) -> None:
    """Computes visibility of a light whose angular radius has the tangent `spread`; `look` as in `filter_map`."""
    launcher.launch_each(_filter_penumbra, len(look[0]), m, mask, taps, spread, *look)
