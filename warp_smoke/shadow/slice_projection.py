"""Sums of the smoke's slices on a light buffer: each is added with a shift, with a shift and a scale, or by splats.

After the shear-warp of Lacroute and Levoy (1994). Rows that hold smoke are found first; empty rows cost nothing.
"""

import warp as wp

from warp_smoke.launch import Launcher, Rows, bits, dense_store
from warp_smoke.shadow.light_buffer import LINE
from warp_smoke.shadow.slice_rows import Slices, flags_from, integers, row_from, row_store

wp.set_module_options({"enable_backward": False})

# Elements of a row that are read at a time while searching for smoke.
_PEEK = wp.constant(64)
_LINE = wp.constant(LINE)


@wp.kernel
def _find_smoke(rows: Rows, density: wp.array3d[float], slices: Slices, smoky_out: wp.array2d[int]):
    """smoky[z, s] = whether the row has any density; reading stops soon after the first smoke.

    Rows are read in the order in which they lie in memory.
    """
    outer, inner, c = wp.tid()
    outer += rows.first
    along_slices = wp.abs(slices.z_step) < slices.s_step
    s = wp.where(along_slices, outer, inner)
    z = wp.where(along_slices, inner, outer)
    if slices.z_step < 0:
        z = smoky_out.shape[0] - 1 - z
    first = wp.max(c * rows.run, 0)
    row = row_from(density, slices.first + s * slices.s_step + z * slices.z_step + first)
    size = wp.min(rows.run, slices.size - first)
    found = wp.int32(0)
    begin = wp.int32(0)
    while begin < size and found == 0:
        t = wp.max(begin, 0)
        begin = wp.min(begin + _PEEK, size)
        while t < begin:
            found = found | bits(row[t])
            t += 1
    if found != 0:  # on CUDA a row has many threads, which all write the same
        smoky_out[z, s] = 1


@wp.kernel
def _turn_slices(
    rows: Rows,
    density: wp.array3d[float],
    smoky_inout: wp.array3d[int],
    slices_out: wp.array3d[float],
    smoky_out: wp.array2d[int],
):
    """slices[i, k, j] = density[i, j, k], so that slices across the fastest axis have contiguous rows.

    smoky[k, i] = whether row i of slice k has any density. Each block has as many j as fill a cache line, so that a
    line is written at once; a block without smoke now (bit 0 of smoky[i, block, k]) and before (bit 1) is skipped.
    """
    i, _, c = wp.tid()
    i += rows.first
    step = density.shape[2]
    begin = wp.max(c * rows.run, 0)
    count = wp.min(rows.run, density.shape[2] - begin)
    for block in range(smoky_inout.shape[1]):
        first = block * _LINE
        size = wp.min(_LINE, density.shape[1] - first)
        flags = flags_from(smoky_inout, i, block, begin)
        k = wp.int32(0)
        while k < count:
            flags[k] = (flags[k] & 1) << 1
            k += 1
        above = (i * density.shape[1] + first) * step + begin
        # Four rows per pass: the flags are read and written less often.
        for j in range(0, size, 4):
            row = row_from(density, above + j * step)
            row1 = row_from(density, above + wp.min(j + 1, size - 1) * step)
            row2 = row_from(density, above + wp.min(j + 2, size - 1) * step)
            row3 = row_from(density, above + wp.min(j + 3, size - 1) * step)
            k = wp.int32(0)
            while k < count:
                found = bits(row[k]) | bits(row1[k]) | bits(row2[k]) | bits(row3[k])
                flags[k] = flags[k] | wp.where(found != 0, 1, 0)
                k += 1
        src = row_from(density, above)
        k = wp.int32(0)
        while k < count:
            if flags[k] != 0:
                dst = row_store(slices_out, i, begin + k, first)
                j = wp.int32(0)
                while j < size:
                    dst[j] = bits(src[j * step + k])
                    j += 1
            k += 1
    k = wp.int32(0)
    while k < count:
        found = wp.int32(0)
        for block in range(smoky_inout.shape[1]):
            found = found | smoky_inout[i, block, begin + k]
        smoky_out[begin + k, i] = found & 1
        k += 1


@wp.func
def _begin_layer(sums: wp.array3d[wp.int32], n: int, p: int, first: int, end: int):
    """Initializes row p of layer n with that of the layer before it."""
    q = first
    if n == 0:
        while q < end:
            sums[n, p, q] = 0
            q += 1
    else:
        while q < end:
            sums[n, p, q] = sums[n - 1, p, q]
            q += 1


@wp.func
def _row_has_smoke(slices: Slices, z: int, i: int):
    return i >= 0 and i < slices.smoky.shape[1] and slices.smoky[z, wp.clamp(i, 0, slices.smoky.shape[1] - 1)] > 0


@wp.func
def _rows_around(slices: Slices, z: int, s: float):
    """Where the rows before and after s begin, and their weights, which are 0 for rows without smoke."""
    i = int(wp.floor(s))
    f = s - float(i)
    has_near = _row_has_smoke(slices, z, i)
    has_far = _row_has_smoke(slices, z, i + 1)
    # A row outside the slice, or without smoke, has no weight; the other stands in for it.
    i0 = wp.where(has_near, i, i + 1)
    i1 = wp.where(has_far, i + 1, i)
    k0 = slices.first + z * slices.z_step + i0 * slices.s_step
    k1 = slices.first + z * slices.z_step + i1 * slices.s_step
    return k0, k1, wp.where(has_near, 1.0 - f, 0.0), wp.where(has_far, f, 0.0)


@wp.kernel
def _shear_slices(
    rows: Rows,
    density: wp.array3d[float],
    slices: Slices,
    places: wp.array[wp.vec3],
    layer: int,
    summed_out: wp.array3d[float],
):
    """As `_march_slices` for a = 1: each slice is shifted, with the same weights for all its texels."""
    p, _, c = wp.tid()
    p += rows.first
    # The sums are read back as integers too: a float load might alias the store, which would stop vectorisation.
    sums = dense_store(summed_out)
    first = wp.max(c * rows.run, 0)
    end = wp.min(first + rows.run, summed_out.shape[2])
    for n in range(summed_out.shape[0]):
        _begin_layer(sums, n, p, first, end)
        for z in range(n * layer, wp.min(n * layer + layer, slices.smoky.shape[0])):
            shift = int(wp.floor(places[z][2]))
            g = places[z][2] - float(shift)
            k0, k1, w0, w1 = _rows_around(slices, z, float(p) + places[z][1])
            if w0 + w1 > 0.0:
                near = row_from(density, k0)
                far = row_from(density, k1)
                last = slices.size - 1
                # The texels whose rays pass outside the centres of the first and the last cell.
                q = -1 - shift
                if first <= q and q < end:
                    sums[n, p, q] = bits(wp.cast(sums[n, p, q], float) + g * (w0 * near[0] + w1 * far[0]))
                q = last - shift
                if first <= q and q < end:
                    edge = (1.0 - g) * (w0 * near[last] + w1 * far[last])
                    sums[n, p, q] = bits(wp.cast(sums[n, p, q], float) + edge)
                begin = wp.max(first, -shift)
                count = wp.min(end, last - shift) - begin
                near_row = row_from(density, k0 + begin + shift)
                far_row = row_from(density, k1 + begin + shift)
                row = row_store(summed_out, n, p, begin)
                w00 = (1.0 - g) * w0
                w01 = g * w0
                w10 = (1.0 - g) * w1
                w11 = g * w1
                m = wp.int32(0)
                while m < count:
                    added = (w00 * near_row[m] + w01 * near_row[m + 1]) + (w10 * far_row[m] + w11 * far_row[m + 1])
                    row[m] = bits(wp.cast(row[m], float) + added)
                    m += 1


@wp.kernel
def _march_slices(
    rows: Rows,
    density: wp.array3d[float],
    slices: Slices,
    places: wp.array[wp.vec3],
    layer: int,
    summed_out: wp.array3d[float],
):
    """summed[l, p, q] = summed[l−1, p, q] + Σ_z ρ(a_z p + b_z, a_z q + c_z, z), bilinear, over the layer's z."""
    p, _, c = wp.tid()
    p += rows.first
    sums = dense_store(summed_out)
    first = wp.max(c * rows.run, 0)
    end = wp.min(first + rows.run, summed_out.shape[2])
    nt = slices.size
    for n in range(summed_out.shape[0]):
        _begin_layer(sums, n, p, first, end)
        for z in range(n * layer, wp.min(n * layer + layer, slices.smoky.shape[0])):
            place = places[z]
            k0, k1, w0, w1 = _rows_around(slices, z, place[0] * float(p) + place[1])
            if w0 + w1 > 0.0:
                # Texels whose rays pass between the centres one cell before the first and one cell after the last.
                q = wp.max(first, int(wp.ceil((-1.0 - place[2]) / place[0])))
                stop = wp.min(end, int(wp.ceil((float(nt) - place[2]) / place[0])))
                wide = wp.where(nt > 1, 1.0, 0.0)
                near_row = row_from(density, k0)
                far_row = row_from(density, k1)
                row = row_store(summed_out, n, p, 0)
                while q < stop:
                    t = place[0] * float(q) + place[2]
                    j = wp.clamp(int(t), 0, wp.max(nt - 2, 0))
                    j1 = wp.min(j + 1, nt - 1)
                    g0 = wp.max(1.0 - wp.abs(t - float(j)), 0.0)
                    g1 = wide * wp.max(1.0 - wp.abs(t - float(j + 1)), 0.0)
                    near = g0 * near_row[j] + g1 * near_row[j1]
                    far = g0 * far_row[j] + g1 * far_row[j1]
                    row[q] = bits(wp.cast(row[q], float) + (w0 * near + w1 * far))
                    q += 1


@wp.kernel
def _gather_splats(
    rows: Rows,
    density: wp.array3d[float],
    slices: Slices,
    s_first: wp.array2d[int],
    s_weight: wp.array3d[float],
    t_first: wp.array2d[int],
    t_weight: wp.array3d[float],
    layer: int,
    summed_out: wp.array3d[float],
):
    """summed[l, p, q] = summed[l−1, p, q] + Σ_m Σ_ij w_m(p, i) w_m(q, j) ρ(i, j, z_m), over the layer's samples m."""
    p, _, c = wp.tid()
    p += rows.first
    src = row_from(density, 0)
    sums = dense_store(summed_out)
    first = wp.max(c * rows.run, 0)
    end = wp.min(first + rows.run, summed_out.shape[2])
    samples = s_first.shape[0] // slices.smoky.shape[0]
    step = layer * samples
    for n in range(summed_out.shape[0]):
        _begin_layer(sums, n, p, first, end)
        for m in range(n * step, wp.min(n * step + step, s_first.shape[0])):
            z = m // samples
            for a in range(s_weight.shape[2]):
                i = s_first[m, p] + a
                weight = s_weight[m, p, a]
                if weight > 0.0 and slices.smoky[z, i] > 0:
                    row = slices.first + z * slices.z_step + i * slices.s_step
                    firsts = integers(t_first, m)
                    added = row_store(summed_out, n, p, 0)
                    for b in range(t_weight.shape[1]):
                        weights = row_from(t_weight, (m * t_weight.shape[1] + b) * t_weight.shape[2])
                        q = first
                        while q < end:
                            value = weight * weights[q] * src[row + firsts[q] + b]
                            added[q] = bits(wp.cast(added[q], float) + value)
                            q += 1


def find_smoke(launcher: Launcher, density: wp.array, slices: Slices) -> None:
    """Finds which rows of the slices hold smoke, and sets `slices.smoky`."""
    slices.smoky.zero_()
    depth, count = slices.smoky.shape
    in_memory = (count, depth) if abs(slices.z_step) < slices.s_step else (depth, count)
    launcher.launch(_find_smoke, (*in_memory, slices.size), density, slices, slices.smoky)


def blocks_along(cells: int) -> int:
    """Returns the number of blocks in which `turn_slices` transposes rows of this many cells."""
    return -(-cells // _LINE)


def turn_slices(
    launcher: Launcher, density: wp.array, blocks_inout: wp.array, slices_out: wp.array, smoky_out: wp.array
) -> None:
    """Transposes slices across the fastest axis, and finds which of their rows hold smoke.

    Args:
        launcher: launches the kernels.
        density: [nx, ny, nz].
        blocks_inout: which blocks held smoke at the last call, [nx, blocks_along(ny), nz]; initially zeros.
        slices_out: [nx, nz, ny]; initially zeros.
        smoky_out: of `Slices`, [nz, nx].
    """
    nx, _, nz = blocks_inout.shape
    launcher.launch(_turn_slices, (nx, 1, nz), density, blocks_inout, slices_out, smoky_out)


def project_slices(
    launcher: Launcher, density: wp.array, slices: Slices, places: wp.array, layer: int, shifts: bool, summed: wp.array
) -> None:
    """Adds up slices on the buffers at the end of each layer.

    Args:
        launcher: launches the kernel.
        density: the smoke, laid out in memory as `slices` says.
        slices: the layout, and which rows hold smoke.
        places: where texels sample each slice, cell centres at integers (`Shear.slice_places`), [slices] vec3.
        layer: slices in each layer.
        shifts: whether texels are as wide as cells in all slices.
        summed: Σ ρ to the end of each layer, [layers, S, T].
    """
    kernel = _shear_slices if shifts else _march_slices
    _, s, t = summed.shape
    launcher.launch(kernel, (s, 1, t), density, slices, places, layer, summed)


def splat_slices(
    launcher: Launcher, density: wp.array, slices: Slices, tables: list[wp.array], layer: int, summed: wp.array
) -> None:
    """Does what `project_slices` does, by a splat's tables: first cells and weights along s and t (`splats.Taps`)."""
    _, s, t = summed.shape
    launcher.launch(_gather_splats, (s, 1, t), density, slices, *tables, layer, summed)
