"""Shadow of smoke by a light buffer of optical depth: a gather along each texel's ray, one bilinear sample a slice.

After the shear-warp of Lacroute and Levoy (1994); transmittance by Beer and Lambert, T = exp(−σ ∫ ρ ds). The buffer
is layered, so that a receiver inside the smoke has only the smoke between it and the light before it.
"""

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows, bits, dense_store
from warp_smoke.record import FieldError
from warp_smoke.scene import Light
from warp_smoke.shadow.light_buffer import Shear, fit_shear, light_in_cells, light_times, set_to_cells

wp.set_module_options({"enable_backward": False})


@wp.struct
class LightBuffer:
    """Smoke as seen from a light; (s, t, z) are shear coordinates (see `light_buffer`).

    Attributes:
        summed: Σ ρ over the slices from the light to the end of each layer, [layers, S, T].
        from_set: set space to shear coordinates, for column vectors.
        light: the light in shear coordinates.
        corner: (s, t) of the buffer's texel (0, 0).
        texel: side of a texel.
        slices: number of slices.
        layer: slices in each layer (the last may have fewer).
        extinction: optical depth of one cell's length at density 1.
    """

    summed: wp.array3d[float]
    from_set: wp.mat44
    light: wp.vec4
    corner: wp.vec2
    texel: float
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
        s = (q[0] - ray[0] / ray[2] * q[2] - b.corner[0]) / b.texel - 0.5
        t = (q[1] - ray[1] / ray[2] * q[2] - b.corner[1]) / b.texel - 0.5
        rows = b.summed.shape[1]
        columns = b.summed.shape[2]
        # The outermost texels hold no smoke, so nothing lies beyond them.
        if s > 0.0 and t > 0.0 and s < float(rows - 1) and t < float(columns - 1):
            i = wp.min(int(s), rows - 2)
            j = wp.min(int(t), columns - 2)
            f = s - float(i)
            g = t - float(j)
            z = wp.min(q[2], float(b.slices))
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
def _layer_sum(summed: wp.array3d[float], layer: int, i: int, j: int, f: float, g: float):
    near = (1.0 - g) * summed[layer, i, j] + g * summed[layer, i, j + 1]
    far = (1.0 - g) * summed[layer, i + 1, j] + g * summed[layer, i + 1, j + 1]
    return (1.0 - f) * near + f * far


@wp.kernel
def _order_slices(
    rows: Rows,
    density: wp.array3d[float],
    first: int,
    s_stride: int,
    t_stride: int,
    z_stride: int,
    slices_out: wp.array3d[float],
    smoky_out: wp.array2d[int],
):
    """slices[z, s+1, t+1] = density at (s, t, z), inside a border of zeros; smoky[z, s+1] = whether a row has any."""
    s, z, c = wp.tid()
    s += rows.first
    src = wp.array(ptr=density.ptr, shape=(density.shape[0] * density.shape[1] * density.shape[2],), dtype=float)
    dst = dense_store(slices_out)
    row = first + s * s_stride + z * z_stride
    t = wp.max(c * rows.run, 0)
    end = wp.min(t + rows.run, slices_out.shape[2] - 2)
    found = wp.int32(0)
    while t < end:
        value = bits(src[row + t * t_stride])
        dst[z, s + 1, t + 1] = value
        found = found | value
        t += 1
    if found != 0:  # on CUDA a row has many threads, which all write the same
        smoky_out[z, s + 1] = 1


@wp.kernel
def _march_slices(
    rows: Rows,
    slices: wp.array3d[float],
    smoky: wp.array2d[int],
    places: wp.array[wp.vec3],
    layer: int,
    summed_out: wp.array3d[float],
):
    """summed[l, p, q] = summed[l−1, p, q] + Σ_z slices[z](a_z p + b_z, a_z q + c_z), bilinear, over the layer's z."""
    p, _, c = wp.tid()
    p += rows.first
    nt = slices.shape[2]
    src = wp.array(ptr=slices.ptr, shape=(slices.shape[0] * slices.shape[1] * nt,), dtype=float)
    # The sums are read back as integers too: a float load might alias the store, which would stop vectorisation.
    sums = dense_store(summed_out)
    first = wp.max(c * rows.run, 0)
    end = wp.min(first + rows.run, summed_out.shape[2])
    for n in range(summed_out.shape[0]):
        q = first
        while q < end:
            before = wp.int32(0)
            if n > 0:
                before = sums[n - 1, p, q]
            sums[n, p, q] = before
            q += 1
        for z in range(n * layer, wp.min(n * layer + layer, slices.shape[0])):
            place = places[z]
            s = place[0] * float(p) + place[1]
            i = int(wp.floor(s))
            if i >= 0 and i < slices.shape[1] - 1 and smoky[z, i] + smoky[z, i + 1] > 0:
                f = s - float(i)
                row = (z * slices.shape[1] + i) * nt
                q = wp.max(first, int(wp.ceil(-place[2] / place[0])))
                last = wp.min(end, int(wp.ceil((float(nt - 1) - place[2]) / place[0])))
                while q < last:
                    t = place[0] * float(q) + place[2]
                    j = wp.clamp(int(t), 0, nt - 2)
                    g = t - float(j)
                    k = row + j
                    near = (1.0 - f) * src[k] + f * src[k + nt]
                    far = (1.0 - f) * src[k + 1] + f * src[k + nt + 1]
                    sums[n, p, q] = bits(wp.cast(sums[n, p, q], float) + near + g * (far - near))
                    q += 1


@wp.kernel
def _attenuate(rows: Rows, buffer: LightBuffer, points: wp.array[wp.vec3], transmittance_inout: wp.array[float]):
    """transmittance[n] *= exp(−τ(points[n]))."""
    n = rows.first + wp.tid()
    depth = smoke_optical_depth(buffer, points[n])
    if depth > 0.0:
        transmittance_inout[n] = transmittance_inout[n] * wp.exp(-depth)


class SmokeShadow:
    """How much of a light the smoke of one domain lets through (`march`).

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
        slices_per_layer: int = 2,
    ):
        """Makes the buffer; `update` fills it.

        Args:
            launcher: launches the kernels.
            lattice: the smoke's cells.
            light: any light outside the domain (`light_buffer.buffer_serves`); its `smoke_shadow_size` is the number
                of texels along the buffer's longer side, None = texels as wide as a cell.
            origin: world position of set space's origin [stage units], [3] float64.
            extinction: σ [1/m] at density 1.
            slices_per_layer: a receiver inside the smoke has its share of the layer it lies in.

        Raises:
            ValueError: for a light that is inside the domain or too near.
        """
        self._launcher, self._lattice, self._light = launcher, lattice, light
        self._origin, self._extinction, self._layer = np.asarray(origin, np.float64), extinction, slices_per_layer
        # A light that moves keeps one buffer, as large as it is ever needed.
        self._texels = None
        texels = [self._fit(time).texels for time in light_times(light)]
        if light.moves:
            self._texels = tuple(np.max(texels, axis=0).tolist())
        self._scratch, self._shear = {}, None

    def update(self, density: wp.array, time: float) -> None:
        """Projects the smoke [nx, ny, nz] onto the buffer, with the light as at a time code."""
        if self._shear is None or self._light.moves:
            self._place(time)
        slices, smoky, places, summed = self._scratch[self._shear.axis]
        smoky.zero_()
        shape = (slices.shape[1] - 2, slices.shape[0], slices.shape[2] - 2)
        self._launcher.launch(_order_slices, shape, density, *self._strides(), slices, smoky)
        shape = (summed.shape[1], 1, summed.shape[2])
        self._launcher.launch(_march_slices, shape, slices, smoky, places, self._layer, summed)

    def transmittance(self, points: wp.array, transmittance_inout: wp.array) -> None:
        """Multiplies by the share of light that passes the smoke between the light and each point.

        Args:
            points: in set space, [n] vec3.
            transmittance_inout: [n].
        """
        self._launcher.launch_each(_attenuate, len(points), self.buffer, points, transmittance_inout)

    def optical_depth(self) -> np.ndarray:
        """τ from the light to the end of each layer along the ray through each texel's centre, [layers, S, T]."""
        shear = self._shear
        centres = shear.corner + shear.texel * (np.stack(np.indices(shear.texels), axis=-1) + 0.5)
        length = np.sqrt(1.0 + np.sum(shear.slopes(centres) ** 2, axis=-1))
        return self.buffer.extinction * length * self.buffer.summed.numpy()

    def _fit(self, time: float) -> Shear:
        light, size = self._light, self._light.smoke_shadow_size
        shear = fit_shear(light_in_cells(light, self._lattice, time), self._lattice.shape, size, self._texels)
        if shear is None:
            where = f"at {light.position_at(time).tolist()}, inside the smoke domain or too near to it for march"
            raise FieldError(light.path, "position", where, "a place outside, or smoke_shadow = ray_traced")
        return shear

    def _place(self, time: float) -> None:
        """Places the buffer for the light at a time code."""
        shear = self._shear = self._fit(time)
        if shear.axis not in self._scratch:
            ns, nt = (n for axis, n in enumerate(self._lattice.shape) if axis != shear.axis)
            zeros, n = self._launcher.zeros, shear.slices
            self._scratch[shear.axis] = (
                zeros((n, ns + 2, nt + 2), "smoke_slices"),
                zeros((n, ns + 2), "smoke_slices", dtype=int),
                zeros(n, "smoke_slices", dtype=wp.vec3),
                zeros((-(-n // self._layer), *shear.texels), "light_buffer"),
            )
        _, _, places, summed = self._scratch[shear.axis]
        # Sample i of a row lies at i + ½ cells, and is element i + 1 behind the border.
        places.assign(np.add(shear.slice_places(), (0.0, 0.5, 0.5)).astype(np.float32))
        buffer = self.buffer = LightBuffer()
        buffer.summed = summed
        buffer.from_set = wp.mat44((set_to_cells(self._lattice, self._origin) @ shear.from_cells).T.astype(np.float32))
        buffer.light = wp.vec4(*shear.light.tolist())
        buffer.corner, buffer.texel = wp.vec2(*shear.corner.tolist()), shear.texel
        buffer.slices, buffer.layer = shear.slices, self._layer
        buffer.extinction = self._extinction * self._lattice.h

    def _strides(self) -> tuple[int, int, int, int]:
        """Index of the first cell, and steps along s, t and z, in the density's memory."""
        _, ny, nz = self._lattice.shape
        steps = [ny * nz, nz, 1]
        z_step = steps.pop(self._shear.axis)
        first = 0
        if self._shear.flipped:
            first, z_step = (self._shear.slices - 1) * z_step, -z_step
        return first, *steps, z_step
