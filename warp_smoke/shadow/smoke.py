"""Shadow of smoke by a light buffer of optical depth, gathered along the light's true rays.

After the shear-warp of Lacroute and Levoy (1994); transmittance by Beer and Lambert, T = exp(−σ ∫ ρ ds). Voxels are
sampled along each texel's ray (`march`) or spread over texels (`splats`). The buffer is layered, so that a receiver
inside the smoke has only the smoke between it and the light before it.
"""

import math

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows, bits, dense_store
from warp_smoke.record import FieldError
from warp_smoke.scene import Light
from warp_smoke.shadow.diffusion import Diffusion
from warp_smoke.shadow.light_buffer import Shear, fit_shear, light_in_cells, light_times, set_to_cells
from warp_smoke.shadow.splats import SPLATS, splat_taps

wp.set_module_options({"enable_backward": False})

# Elements that are looked at before a row is known to hold smoke.
_PEEK = wp.constant(64)
# Floats in a line of cache.
_LINE = wp.constant(16)
# Rows are looped over as views that begin at their first element: LLVM then vectorises them. Views want a length.
_LONG = wp.constant(2**31 - 1)


@wp.struct
class LightBuffer:
    """Smoke as seen from a light; (s, t, z) are shear coordinates (see `light_buffer`).

    Attributes:
        summed: Σ ρ over the slices from the light to the end of each layer, [layers, S, T].
        from_set: set space to shear coordinates, for column vectors.
        light: the light in shear coordinates.
        corner: (s, t) of the buffer's texel (0, 0).
        texel: side of a texel.
        box: the smoke's cells along s, t and z.
        slices: number of slices.
        layer: slices in each layer (the last may have fewer).
        extinction: optical depth of one cell's length at density 1.
    """

    summed: wp.array3d[float]
    from_set: wp.mat44
    light: wp.vec4
    corner: wp.vec2
    texel: float
    box: wp.vec3
    slices: int
    layer: int
    extinction: float


@wp.func
def smoke_optical_depth(b: LightBuffer, point: wp.vec3):
    """τ = σ h Σ ρ · |ray| / |ray_z| between the light and a point; 0 before the smoke and beside it."""
    q = wp.transform_point(b.from_set, point)
    ray = b.light[3] * q - wp.vec3(b.light[0], b.light[1], b.light[2])
    depth = 0.0
    if q[2] > 0.0 and ray[2] > 0.0:
        # Where the ray passes the buffer, on the box's near side.
        slope = wp.vec2(ray[0] / ray[2], ray[1] / ray[2])
        near = wp.vec2(q[0] - slope[0] * q[2], q[1] - slope[1] * q[2])
        s = (near[0] - b.corner[0]) / b.texel - 0.5
        t = (near[1] - b.corner[1]) / b.texel - 0.5
        rows = b.summed.shape[1]
        columns = b.summed.shape[2]
        z = _depth_in_box(b.box, near, slope, q[2])
        # The outermost texels hold no smoke, so nothing lies beyond them.
        if z > 0.0 and s > 0.0 and t > 0.0 and s < float(rows - 1) and t < float(columns - 1):
            i = wp.min(int(s), rows - 2)
            j = wp.min(int(t), columns - 2)
            f = s - float(i)
            g = t - float(j)
            layer = wp.min(int(z) // b.layer, b.summed.shape[0] - 1)
            first = layer * b.layer
            thickness = wp.min(b.layer, b.slices - first)
            share = (z - float(first)) / float(thickness)
            below = share * _layer_sum(b.summed, layer, i, j, f, g)
            if layer > 0 and share < 1.0:
                below += (1.0 - share) * _layer_sum(b.summed, layer - 1, i, j, f, g)
            depth = b.extinction * wp.length(ray) / ray[2] * below
    return depth


@wp.func
def _depth_in_box(box: wp.vec3, near: wp.vec2, slope: wp.vec2, z: float):
    """Depth up to which a ray's smoke lies before a point at depth z: none before the box, all of it behind the box.

    So a receiver outside the box has the whole ray's smoke or none, however few the layers.
    """
    enters = wp.float32(0.0)
    leaves = wp.float32(box[2])
    for axis in range(2):
        # A ray along a side must not become 0 · ∞.
        inverse = 1.0 / wp.where(wp.abs(slope[axis]) < 1.0e-12, 1.0e-12, slope[axis])
        low = -near[axis] * inverse
        high = (box[axis] - near[axis]) * inverse
        enters = wp.max(enters, wp.min(low, high))
        leaves = wp.min(leaves, wp.max(low, high))
    if z >= leaves:
        return box[2]
    if z <= enters:
        return 0.0
    return z


@wp.func
def _layer_sum(summed: wp.array3d[float], layer: int, i: int, j: int, f: float, g: float):
    near = (1.0 - g) * summed[layer, i, j] + g * summed[layer, i, j + 1]
    far = (1.0 - g) * summed[layer, i + 1, j] + g * summed[layer, i + 1, j + 1]
    return (1.0 - f) * near + f * far


@wp.struct
class Slices:
    """Where density's elements (z, s, t) lie in memory: at first + z · z_step + s · s_step + t.

    Attributes:
        smoky: whether row (z, s) has any smoke.
        size: number of cells along t.
    """

    smoky: wp.array2d[int]
    first: int
    z_step: int
    s_step: int
    size: int


@wp.func
def _row(a: wp.array3d[float], first: int):
    """The elements of a contiguous array from one on."""
    return wp.array(ptr=a.ptr + wp.uint64(4) * wp.uint64(first), shape=(_LONG,), dtype=float)


@wp.func
def _row_store(a: wp.array3d[float], n: int, p: int, first: int):
    """The elements of row (n, p) of a contiguous array from one on, as integers: see `dense_store`."""
    offset = (n * a.shape[1] + p) * a.shape[2] + first
    return wp.array(ptr=a.ptr + wp.uint64(4) * wp.uint64(offset), shape=(_LONG,), dtype=wp.int32)


@wp.kernel
def _find_smoke(rows: Rows, density: wp.array3d[float], slices: Slices, smoky_out: wp.array2d[int]):
    """smoky[z, s] = whether the row has any density; rows with smoke at their beginning are not read to the end."""
    s, z, c = wp.tid()
    s += rows.first
    first = wp.max(c * rows.run, 0)
    row = _row(density, slices.first + s * slices.s_step + z * slices.z_step + first)
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
def _turn_slices(rows: Rows, density: wp.array3d[float], slices_out: wp.array3d[float]):
    """slices[k, i, j] = density[i, j, k], so that slices across the fastest axis have contiguous rows.

    As many j at a time as fill a line of cache, so that each line is written at once.
    """
    i, block, c = wp.tid()
    i += rows.first
    first = block * _LINE
    size = wp.min(_LINE, density.shape[1] - first)
    step = density.shape[2]
    src = _row(density, (i * density.shape[1] + first) * step)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, density.shape[2])
    while k < end:
        dst = _row_store(slices_out, k, i, first)
        j = wp.int32(0)
        while j < size:
            dst[j] = bits(src[j * step + k])
            j += 1
        k += 1


@wp.func
def _begin_layer(sums: wp.array3d[wp.int32], n: int, p: int, first: int, end: int):
    """Row p of layer n starts as that of the layer before it."""
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


@wp.kernel
def _shear_slices(
    rows: Rows,
    density: wp.array3d[float],
    slices: Slices,
    places: wp.array[wp.vec3],
    layer: int,
    summed_out: wp.array3d[float],
):
    """As `_march_slices` for a = 1: each slice lands shifted, with weights that are the same for all its texels."""
    p, _, c = wp.tid()
    p += rows.first
    # The sums are read back as integers too: a float load might alias the store, which would stop vectorisation.
    sums = dense_store(summed_out)
    first = wp.max(c * rows.run, 0)
    end = wp.min(first + rows.run, summed_out.shape[2])
    for n in range(summed_out.shape[0]):
        _begin_layer(sums, n, p, first, end)
        for z in range(n * layer, wp.min(n * layer + layer, slices.smoky.shape[0])):
            s = float(p) + places[z][1]
            i = int(wp.floor(s))
            shift = int(wp.floor(places[z][2]))
            f = s - float(i)
            g = places[z][2] - float(shift)
            has_near = _row_has_smoke(slices, z, i)
            has_far = _row_has_smoke(slices, z, i + 1)
            if has_near or has_far:
                # A row outside the slice, or without smoke, has no weight; the other stands in for it.
                i0 = wp.where(has_near, i, i + 1)
                i1 = wp.where(has_far, i + 1, i)
                w0 = wp.where(has_near, 1.0 - f, 0.0)
                w1 = wp.where(has_far, f, 0.0)
                k0 = slices.first + z * slices.z_step + i0 * slices.s_step
                k1 = slices.first + z * slices.z_step + i1 * slices.s_step
                near = _row(density, k0)
                far = _row(density, k1)
                last = slices.size - 1
                # The texels whose ray passes outside the first and the last cell's centre.
                q = -1 - shift
                if first <= q and q < end:
                    sums[n, p, q] = bits(wp.cast(sums[n, p, q], float) + g * (w0 * near[0] + w1 * far[0]))
                q = last - shift
                if first <= q and q < end:
                    edge = (1.0 - g) * (w0 * near[last] + w1 * far[last])
                    sums[n, p, q] = bits(wp.cast(sums[n, p, q], float) + edge)
                begin = wp.max(first, -shift)
                count = wp.min(end, last - shift) - begin
                near_row = _row(density, k0 + begin + shift)
                far_row = _row(density, k1 + begin + shift)
                row = _row_store(summed_out, n, p, begin)
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
    src = _row(density, 0)
    sums = dense_store(summed_out)
    first = wp.max(c * rows.run, 0)
    end = wp.min(first + rows.run, summed_out.shape[2])
    nt = slices.size
    for n in range(summed_out.shape[0]):
        _begin_layer(sums, n, p, first, end)
        for z in range(n * layer, wp.min(n * layer + layer, slices.smoky.shape[0])):
            place = places[z]
            s = place[0] * float(p) + place[1]
            i = int(wp.floor(s))
            f = s - float(i)
            has_near = _row_has_smoke(slices, z, i)
            has_far = _row_has_smoke(slices, z, i + 1)
            if has_near or has_far:
                i0 = wp.where(has_near, i, i + 1)
                i1 = wp.where(has_far, i + 1, i)
                w0 = wp.where(has_near, 1.0 - f, 0.0)
                w1 = wp.where(has_far, f, 0.0)
                k0 = slices.first + z * slices.z_step + i0 * slices.s_step
                k1 = slices.first + z * slices.z_step + i1 * slices.s_step
                # Texels whose ray passes between the centres before the first and behind the last cell.
                q = wp.max(first, int(wp.ceil((-1.0 - place[2]) / place[0])))
                stop = wp.min(end, int(wp.ceil((float(nt) - place[2]) / place[0])))
                wide = wp.where(nt > 1, 1.0, 0.0)
                while q < stop:
                    t = place[0] * float(q) + place[2]
                    j = wp.clamp(int(t), 0, wp.max(nt - 2, 0))
                    j1 = wp.min(j + 1, nt - 1)
                    g0 = wp.max(1.0 - wp.abs(t - float(j)), 0.0)
                    g1 = wide * wp.max(1.0 - wp.abs(t - float(j + 1)), 0.0)
                    near = g0 * src[k0 + j] + g1 * src[k0 + j1]
                    far = g0 * src[k1 + j] + g1 * src[k1 + j1]
                    sums[n, p, q] = bits(wp.cast(sums[n, p, q], float) + (w0 * near + w1 * far))
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
    src = _row(density, 0)
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
                    for b in range(t_weight.shape[1]):
                        q = first
                        while q < end:
                            value = weight * t_weight[m, b, q] * src[row + t_first[m, q] + b]
                            sums[n, p, q] = bits(wp.cast(sums[n, p, q], float) + value)
                            q += 1


@wp.kernel
def _attenuate(
    rows: Rows, buffer: LightBuffer, points: wp.array[wp.vec3], color: wp.vec3, transmittance_inout: wp.array2d[float]
):
    """transmittance[c, n] *= exp(−color_c τ(points[n]))."""
    n = rows.first + wp.tid()
    depth = smoke_optical_depth(buffer, points[n])
    if depth > 0.0:
        for c in range(transmittance_inout.shape[0]):
            transmittance_inout[c, n] = transmittance_inout[c, n] * wp.exp(-color[c] * depth)


class SmokeShadow:
    """How much of a light the smoke of one domain lets through, by a buffer along the light's true rays.

    Attributes:
        buffer: the light buffer, for kernels that use `smoke_optical_depth`.
    """

    def __init__(
        self,
        launcher: Launcher,
        lattice: Lattice,
        light: Light,
        origin: np.ndarray,
        extinction: float,
        color: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ):
        """Makes the buffer; `update` fills it.

        Args:
            launcher: launches the kernels.
            lattice: the smoke's cells.
            light: any light outside the domain (`light_buffer.buffer_serves`). Its `smoke_shadow` is march or a splat;
                its `smoke_shadow_size` is the number of texels along the buffer's longer side, None = texels as wide
                as a cell; its `smoke_shadow_layer` is the number of slices in a layer, of which a receiver inside the
                box has its share, None = all, which is enough for receivers outside; its `smoke_diffusion`,
                `smoke_diffuser` and `smoke_sweeps` spread the buffer.
            origin: world position of set space's origin [stage units], [3] float64.
            extinction: σ [1/m] at density 1.
            color: factor on σ for red, green and blue.

        Raises:
            ValueError: for a light that is inside the domain or too near.
        """
        self._launcher, self._lattice, self._light = launcher, lattice, light
        self._origin, self._extinction = np.asarray(origin, np.float64), extinction
        self._color = wp.vec3(*color)
        self._splat = SPLATS.get(light.smoke_shadow)
        # A light that moves keeps one buffer, as large as it is ever needed.
        self._texels = None
        texels = [self._fit(time).texels for time in light_times(light)]
        if light.moves:
            self._texels = tuple(np.max(texels, axis=0).tolist())
        self._memory, self._shear = {}, None

    def update(self, density: wp.array, time: float) -> None:
        """Projects the smoke [nx, ny, nz] onto the buffer, with the light as at a time code."""
        if self._shear is None or self._light.moves:
            self._place(time)
        launch, memory, slices = self._launcher.launch, self._memory[self._shear.axis], self._slices
        if memory.turned is not None:
            nx, ny, nz = self._lattice.shape
            launch(_turn_slices, (nx, -(-ny // _LINE), nz), density, memory.turned)
            density = memory.turned
        memory.smoky.zero_()
        depth, count = memory.smoky.shape
        launch(_find_smoke, (count, depth, slices.size), density, slices, memory.smoky)
        kernel = _gather_splats if self._splat else _shear_slices if self._shear.is_shift else _march_slices
        summed = memory.summed
        shape = (summed.shape[1], 1, summed.shape[2])
        launch(kernel, shape, density, slices, *self._places, self._layer, summed)
        if memory.diffusion:
            self.buffer.summed = memory.diffusion.spread(summed)

    def transmittance(self, points: wp.array, transmittance_inout: wp.array) -> None:
        """Multiplies by the share of light that passes the smoke between the light and each point.

        Args:
            points: in set space, [n] vec3.
            transmittance_inout: [1, n], or [3, n] for red, green and blue.
        """
        args = (self.buffer, points, self._color, transmittance_inout)
        self._launcher.launch_each(_attenuate, len(points), *args)

    def optical_depth(self) -> np.ndarray:
        """τ from the light to the end of each layer along the ray through each texel's centre, [layers, S, T]."""
        shear = self._shear
        centres = shear.corner + shear.texel * (np.stack(np.indices(shear.texels), axis=-1) + 0.5)
        length = np.sqrt(1.0 + np.sum(shear.slopes(centres) ** 2, axis=-1))
        return self.buffer.extinction * length * self.buffer.summed.numpy()

    @property
    def _layer(self) -> int:
        """Slices in each layer."""
        return min(self._light.smoke_shadow_layer or self._shear.slices, self._shear.slices)

    def _fit(self, time: float) -> Shear:
        light, lattice = self._light, self._lattice
        beyond = self._splat.beyond if self._splat else 0.5
        # Wide enough for the splats, and for all but 0.3 % of what diffusion spreads over the edge.
        margin = bool(self._splat) + math.ceil(3.0 * math.sqrt(2.0 * light.smoke_diffusion))
        cells = light_in_cells(light, lattice, time)
        shear = fit_shear(cells, lattice.shape, light.smoke_shadow_size, self._texels, beyond, margin)
        if shear is None:
            where = f"at {light.position_at(time).tolist()}, inside the smoke domain or too near to it for a buffer"
            raise FieldError(light.path, "position", where, "a place outside, or smoke_shadow = ray_traced")
        return shear

    def _place(self, time: float) -> None:
        """Places the buffer for the light at a time code."""
        shear = self._shear = self._fit(time)
        if shear.axis not in self._memory:
            self._memory[shear.axis] = _Memory(self._launcher, self._lattice.shape, shear, self._layer, self._light)
        memory = self._memory[shear.axis]
        if self._splat:
            along_s, along_t = splat_taps(self._splat, shear, memory.sides)
            tables = (along_s.first, along_s.weight, along_t.first, along_t.weight.transpose(0, 2, 1))
            self._places = [self._launcher.array(np.ascontiguousarray(table), "smoke_splats") for table in tables]
        else:
            # Sample i of a row lies at i + ½ cells.
            memory.places.assign(np.subtract(shear.slice_places(), (0.0, 0.5, 0.5)).astype(np.float32))
            self._places = [memory.places]
        self._slices = memory.slices(shear.flipped)
        buffer = self.buffer = LightBuffer()
        buffer.summed = memory.summed
        buffer.from_set = wp.mat44((set_to_cells(self._lattice, self._origin) @ shear.from_cells).T.astype(np.float32))
        buffer.light = wp.vec4(*shear.light.tolist())
        buffer.corner, buffer.texel = wp.vec2(*shear.corner.tolist()), shear.texel
        buffer.box = wp.vec3(*map(float, (*memory.sides, shear.slices)))
        buffer.slices, buffer.layer = shear.slices, self._layer
        buffer.extinction = self._extinction * self._lattice.h


class _Memory:
    """The arrays of a buffer across one axis of the lattice."""

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], shear: Shear, layer: int, light: Light):
        self._shape, self._axis = shape, shear.axis
        self.sides = tuple(n for axis, n in enumerate(shape) if axis != shear.axis)
        n = shear.slices
        self.smoky = launcher.zeros((n, self.sides[0]), "smoke_slices", dtype=int)
        self.places = launcher.zeros(n, "smoke_slices", dtype=wp.vec3)
        self.turned = launcher.zeros((n, *self.sides), "smoke_slices") if shear.axis == 2 else None
        buffers = (-(-n // layer), *shear.texels)
        self.summed = launcher.zeros(buffers, "light_buffer")
        self.diffusion = None
        if light.smoke_diffusion:
            how = (light.smoke_diffusion, light.smoke_diffuser, light.smoke_sweeps)
            self.diffusion = Diffusion(launcher, buffers, *how)

    def slices(self, flipped: bool) -> Slices:
        """Where the slices lie in memory; those across the fastest axis are turned first."""
        _, ny, nz = self._shape
        z_step, s_step, size = [(ny * nz, nz, nz), (nz, ny * nz, nz), (self._shape[0] * ny, ny, ny)][self._axis]
        depth = self._shape[self._axis]
        slices = Slices()
        slices.smoky, slices.size = self.smoky, size
        slices.first = (depth - 1) * z_step if flipped else 0
        slices.z_step, slices.s_step = -z_step if flipped else z_step, s_step
        return slices
