"""Look-ups in depth maps around a point: six faces of a cube, or one over a spot light's cone."""

import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.shadow.bias import Bias, fixed_bias, plane_normal
from warp_smoke.shadow.caster_mask import CasterMask, face_towards, may_be_shadowed
from warp_smoke.shadow.filters import Taps, square_to
from warp_smoke.shadow.umbra import deepest_within

wp.set_module_options({"enable_backward": False})

_FARTHEST_TAP = wp.constant(3.0**0.5)  # of the offsets of fixed filters, in half-widths


@wp.struct
class PointMap:
    """A depth map.

    Attributes:
        depth: distance / far, [faces, size, size] by face, row and column.
        deepest: largest `depth` in each tile, [faces, rows, columns]; 1 where nothing was traced.
        frames: axes s, t and viewing direction of each face, one per row, [faces].
        slope: tangent of the angle between a face's viewing direction and the middle of its side: 1 for a cube.
        position: the light in set space.
        far: [stage units]; points beyond are lit.
        bias: how much deeper than the stored depth a point must lie to be in shadow.
    """

    depth: wp.array3d[float]
    deepest: wp.array3d[float]
    frames: wp.array[wp.mat33]
    slope: float
    position: wp.vec3
    far: float
    bias: Bias


@wp.func
def map_coordinates(m: PointMap, r: wp.vec3):
    """(face, s, t) of a direction in texels and its depth along the face's axis, as a vec4 in that order."""
    face = 0
    if m.depth.shape[0] == 6:
        face = face_towards(r)
    v = m.frames[face] * r
    half = 0.5 * float(m.depth.shape[1])
    scale = half / (m.slope * wp.max(v[2], 1.0e-30))
    return wp.vec4(float(face), half + scale * v[0], half + scale * v[1], v[2])


@wp.func
def stored_depth(m: PointMap, face: int, u: wp.vec3):
    """The depth of the texel that a direction, given along a face's axes, falls in; 1 outside the map."""
    size = m.depth.shape[1]
    limit = float(size)
    scale = 0.5 * limit / (m.slope * wp.max(u[2], 1.0e-30))
    s = 0.5 * limit + scale * u[0]
    t = 0.5 * limit + scale * u[1]
    depth = wp.float32(1.0)
    if u[2] > 0.0 and s >= 0.0 and t >= 0.0 and s <= limit and t <= limit:
        depth = m.depth[face, wp.min(int(t), size - 1), wp.min(int(s), size - 1)]
    elif m.depth.shape[0] == 6:
        c = map_coordinates(m, wp.transpose(m.frames[face]) * u)
        depth = m.depth[int(c[0]), wp.clamp(int(c[2]), 0, size - 1), wp.clamp(int(c[1]), 0, size - 1)]
    return depth


@wp.func
def look_up(m: PointMap, face: int, r: wp.vec3, normal: wp.vec3, u: wp.vec3):
    """(1, lit, stored distance of what shadows it or 0) of the texel around u, for the point r on a plane n·r < 0.

    All vectors are along the axes of the face that r points to.

    Along u the plane lies at e = |u| (n·r) / (n·u), limited to |r|, which removes a third of the acne in a rough mesh's
    hollows. With x = spread · tan θ the plane is nowhere in the texel nearer than e / (1 + x): so a texel with depth s
    is lit if e ≤ (s + c) (1 + x), the least bias without acne on planes, for any θ. Both sides are multiplied by n·u.
    A light's own bias is subtracted from |r|. Where u passes above the plane's horizon, all three are 0.
    """
    stored = stored_depth(m, face, u)
    s = stored * m.far
    d = wp.length(r)
    facing = -wp.dot(r, normal)
    counts = wp.float32(1.0)
    lit = stored >= 1.0
    if m.bias.spread == 0.0:
        lit = lit or d - fixed_bias(m.bias, facing / wp.max(d, 1.0e-30)) <= s
    else:
        along = -wp.dot(u, normal)
        if along <= 0.0:
            counts = wp.float32(0.0)
        elif not lit:
            square = wp.dot(u, u)
            across = wp.sqrt(wp.max(square - along * along, 0.0))
            nearest = wp.min(wp.sqrt(square) * facing, d * along)
            lit = nearest <= (s + m.bias.constant) * (along + m.bias.spread * across)
    passed = wp.where(lit, counts, 0.0)
    return wp.vec3(counts, passed, (counts - passed) * s)


@wp.func
def in_umbra(m: PointMap, c: wp.vec4, r: wp.vec3, normal: wp.vec3, reach: float):
    """Whether `look_up` finds shadow everywhere within `reach` of r, at map coordinates c; false if uncertain."""
    d = wp.length(r)
    size = m.depth.shape[1]
    found = wp.bool(False)
    if c[3] > reach:
        # With r = (s, t, 1) z on a face, a step of `reach` moves s and t by no more than reach · (d / z) / (z − reach).
        texels = 0.5 * float(size) / m.slope * reach * d / (c[3] * (c[3] - reach))
        deepest = deepest_within(m.deepest, size, int(c[0]), c[1], c[2], texels)
        facing = -wp.dot(r, normal)
        if deepest < 1.0 and m.bias.spread == 0.0:
            found = d - fixed_bias(m.bias, facing / wp.max(d, 1.0e-30)) > deepest * m.far
        elif deepest < 1.0:
            # The least left and greatest right side of the comparison in `look_up`.
            most = (deepest * m.far + m.bias.constant) * (facing + reach + m.bias.spread * (d + reach))
            found = d * (facing - reach) > most
    return found


@wp.func
def sum_of_taps(
    m: PointMap, taps: Taps, face: int, r: wp.vec3, normal: wp.vec3, right: wp.vec3, up: wp.vec3, reach: float
):
    """The sum of `look_up` over the taps on a disk around r, spanned by right and up, 2 · reach wide."""
    total = wp.vec3(0.0, 0.0, 0.0)
    for k in range(taps.offsets.shape[0]):
        o = reach * taps.offsets[k]
        total += look_up(m, face, r, normal, r + o[0] * right + o[1] * up)
    return total


@wp.kernel
def _filter_taps(
    rows: Rows,
    m: PointMap,
    mask: CasterMask,
    taps: Taps,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    facets: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """visibility[n] = share of taps that are lit, among those below the horizon of the point's plane."""
    n = rows.first + wp.tid()
    r = points[n] - m.position
    visible = wp.float32(0.0)
    if wp.dot(r, normals[n]) < 0.0:
        visible = wp.float32(1.0)
        normal = plane_normal(normals[n], facets[n], r)
        if wp.length(r) <= m.far and may_be_shadowed(mask, points[n]):
            c = map_coordinates(m, r)
            face = int(c[0])
            frame = m.frames[face]
            texel = 2.0 * m.slope * c[3] / float(m.depth.shape[1])
            reach = taps.radius * (1.0 + taps.growth * wp.length(points[n] - taps.eye)) + taps.texels * texel
            if in_umbra(m, c, r, normal, _FARTHEST_TAP * reach):
                visible = wp.float32(0.0)
            else:
                total = wp.vec3(0.0, 0.0, 0.0)
                for k in range(taps.offsets.shape[0]):
                    u = frame * (r + reach * taps.offsets[k])
                    total += look_up(m, face, frame * r, frame * normal, u)
                visible = total[1] / wp.max(total[0], 1.0)
    visibility_out[n] = visible


@wp.kernel
def _filter_penumbra(
    rows: Rows,
    m: PointMap,
    mask: CasterMask,
    taps: Taps,
    light: float,
    closest: float,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    facets: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """Percentage-closer soft shadows (Fernando, 2005): blockers at mean distance b widen the filter to R (d − b) / b.

    Blockers are searched for within R (d − b₀) / b₀, b₀ being the distance of the closest caster.
    """
    n = rows.first + wp.tid()
    r = points[n] - m.position
    visible = wp.float32(0.0)
    if wp.dot(r, normals[n]) < 0.0:
        visible = wp.float32(1.0)
        normal = plane_normal(normals[n], facets[n], r)
        d = wp.length(r)
        if d <= m.far and may_be_shadowed(mask, points[n]):
            c = map_coordinates(m, r)
            face = int(c[0])
            texel = 2.0 * m.slope * c[3] / float(m.depth.shape[1])
            r = m.frames[face] * r
            normal = m.frames[face] * normal
            toward = r / wp.max(d, 1.0e-30)
            right = square_to(toward)
            up = wp.cross(toward, right)
            smallest = taps.texels * texel
            reach = wp.clamp(light * (d - closest) / closest, smallest, d)
            if in_umbra(m, c, r, normal, reach):
                visible = wp.float32(0.0)
            else:
                found = sum_of_taps(m, taps, face, r, normal, right, up, reach)
                if found[1] < found[0]:
                    b = found[2] / (found[0] - found[1])
                    width = wp.clamp(light * (d - b) / wp.max(b, 1.0e-30), smallest, d)
                    filtered = sum_of_taps(m, taps, face, r, normal, right, up, width)
                    visible = filtered[1] / wp.max(filtered[0], 1.0)
    visibility_out[n] = visible


def filter_map(launcher: Launcher, m: PointMap, mask: CasterMask, taps: Taps, *look: wp.array) -> None:
    """Computes visibility by a fixed filter; `look` is points, normals, facet normals and visibility_out, [n] each."""
    launcher.launch_each(_filter_taps, len(look[0]), m, mask, taps, *look)


def filter_penumbra(
    launcher: Launcher, m: PointMap, mask: CasterMask, taps: Taps, light: float, closest: float, *look: wp.array
) -> None:
    """Computes visibility of a light of radius `light`, with its closest caster at `closest`; `look` as above."""
    launcher.launch_each(_filter_penumbra, len(look[0]), m, mask, taps, light, closest, *look)
