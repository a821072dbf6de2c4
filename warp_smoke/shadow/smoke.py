"""Smoke shadow by a light buffer of optical depth, gathered along the light's true rays.

After the shear-warp of Lacroute and Levoy (1994); transmittance by Beer and Lambert, T = exp(−σ ∫ ρ ds). Voxels are
sampled along each texel's ray (`march`) or spread over texels (`splats`), slice by slice (`slice_projection`). The
buffer is layered, so that a receiver inside the smoke is shadowed only by the smoke between it and the light.
"""

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.record import FieldError
from warp_smoke.scene import Light
from warp_smoke.shadow.diffusion import Diffusion
from warp_smoke.shadow.light_buffer import TOUCH, Shear, fit_buffer, light_times, set_to_cells
from warp_smoke.shadow.slice_projection import blocks_along, find_smoke, project_slices, splat_slices, turn_slices
from warp_smoke.shadow.slice_rows import Slices
from warp_smoke.shadow.splats import SPLATS, splat_taps

wp.set_module_options({"enable_backward": False})

_TOUCH = wp.constant(TOUCH)


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
    """τ = σ h Σ ρ · |ray| / |ray_z| between the light and a point; 0 in front of the smoke and beside it."""
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
    """Depth up to which a ray's smoke counts for a point at depth z: none in front of the box, all of it behind.

    So a receiver outside the box, or on its side, gets all of the ray's smoke or none, however few the layers.
    """
    enters = wp.float32(_TOUCH)
    leaves = wp.float32(box[2] - _TOUCH)
    for axis in range(2):
        # A ray along a side must not become 0 · ∞.
        inverse = 1.0 / wp.where(wp.abs(slope[axis]) < 1.0e-12, 1.0e-12, slope[axis])
        low = (_TOUCH - near[axis]) * inverse
        high = (box[axis] - _TOUCH - near[axis]) * inverse
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
        """Allocates the buffer; `update` fills it.

        Args:
            launcher: launches the kernels.
            lattice: the smoke's cells.
            light: any light outside the domain (`light_buffer.buffer_serves`). Its `smoke_shadow` is march or a splat;
                its `smoke_shadow_size` is the number of texels along the buffer's longer side, None = texels as wide
                as a cell; its `smoke_shadow_layer` is the number of slices in a layer, within which receivers inside
                the box interpolate, None = all, which is enough for receivers outside; its `smoke_diffusion`,
                `smoke_diffuser` and `smoke_sweeps` diffuse the buffer.
            origin: world position of set space's origin [stage units], [3] float64.
            extinction: σ [1/m] at density 1.
            color: factor on σ for red, green and blue.

        Raises:
            ValueError: the light is inside the domain or too near to it.
        """
        self._launcher, self._lattice, self._light = launcher, lattice, light
        self._origin, self._extinction = np.asarray(origin, np.float64), extinction
        self._color = wp.vec3(*color)
        self._splat = SPLATS.get(light.smoke_shadow)
        # A light that moves keeps one buffer, as large as it ever needs.
        self._texels = None
        texels = [self._fit(time).texels for time in light_times(light)]
        if light.moves:
            self._texels = tuple(np.max(texels, axis=0).tolist())
        self._memory, self._shear = {}, None

    def update(self, density: wp.array, time: float) -> None:
        """Projects the smoke [nx, ny, nz] onto the buffer, with the light at a time code."""
        if self._shear is None or self._light.moves:
            self._place(time)
        memory, slices, launcher = self._memory[self._shear.axis], self._slices, self._launcher
        if memory.turned is None:
            find_smoke(launcher, density, slices)
        else:
            turn_slices(launcher, density, memory.blocks, memory.turned, memory.smoky)
            density = memory.turned
        if self._splat:
            splat_slices(launcher, density, slices, memory.places, self._layer, memory.summed)
        else:
            (places,) = memory.places
            project_slices(launcher, density, slices, places, self._layer, self._shear.is_shift, memory.summed)
        if memory.diffusion:
            self.buffer.summed = memory.diffusion.spread(memory.summed)

    def transmittance(self, points: wp.array, transmittance_inout: wp.array) -> None:
        """Multiplies by the share of light that passes the smoke between the light and each point.

        Args:
            points: in set space, [n] vec3.
            transmittance_inout: [1, n], or [3, n] for red, green and blue.
        """
        args = (self.buffer, points, self._color, transmittance_inout)
        self._launcher.launch_each(_attenuate, len(points), *args)

    def optical_depth(self) -> np.ndarray:
        """Returns τ from the light to the end of each layer along the ray through each texel centre, [layers, S, T]."""
        shear = self._shear
        centres = shear.corner + shear.texel * (np.stack(np.indices(shear.texels), axis=-1) + 0.5)
        length = np.sqrt(1.0 + np.sum(shear.slopes(centres) ** 2, axis=-1))
        return self.buffer.extinction * length * self.buffer.summed.numpy()

    @property
    def _layer(self) -> int:
        """Slices in each layer."""
        return min(self._light.smoke_shadow_layer or self._shear.slices, self._shear.slices)

    def _fit(self, time: float) -> Shear:
        light = self._light
        shear = fit_buffer(light, self._lattice, time, self._texels)
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
            memory.place(along_s.first, along_s.weight, along_t.first, along_t.weight.transpose(0, 2, 1))
        else:
            # Sample i of a row lies at i + ½ cells.
            memory.places[0].assign(np.subtract(shear.slice_places(), (0.0, 0.5, 0.5)).astype(np.float32))
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
        self._launcher, self._shape, self._axis = launcher, shape, shear.axis
        self.sides = tuple(n for axis, n in enumerate(shape) if axis != shear.axis)
        n = shear.slices
        self.smoky = launcher.zeros((n, self.sides[0]), "smoke_slices", dtype=int)
        self.places = [launcher.zeros(n, "smoke_slices", dtype=wp.vec3)]
        self.turned = self.blocks = None
        if shear.axis == 2:
            nx, ny, nz = shape
            self.turned = launcher.zeros((nx, nz, ny), "smoke_slices")
            self.blocks = launcher.zeros((nx, blocks_along(ny), nz), "smoke_slices", dtype=int)
        buffers = (-(-n // layer), *shear.texels)
        self.summed = launcher.zeros(buffers, "light_buffer")
        self.diffusion = None
        if light.smoke_diffusion:
            how = (light.smoke_diffusion, light.smoke_diffuser, light.smoke_sweeps)
            self.diffusion = Diffusion(launcher, buffers, *how)

    def place(self, *tables: np.ndarray) -> None:
        """Sets a splat's tables; they are reallocated only when their shapes change, as happens when lights move."""
        if [array.shape for array in self.places] != [table.shape for table in tables]:
            self.places = [self._launcher.array(np.ascontiguousarray(table), "smoke_splats") for table in tables]
        else:
            for array, table in zip(self.places, tables, strict=True):
                array.assign(np.ascontiguousarray(table))

    def slices(self, flipped: bool) -> Slices:
        """Returns the slices' layout in memory; those across the fastest axis are transposed first."""
        _, ny, nz = self._shape
        z_step, s_step, size = [(ny * nz, nz, nz), (nz, ny * nz, nz), (ny, ny * nz, ny)][self._axis]
        depth = self._shape[self._axis]
        slices = Slices()
        slices.smoky, slices.size = self.smoky, size
        slices.first = (depth - 1) * z_step if flipped else 0
        slices.z_step, slices.s_step = -z_step if flipped else z_step, s_step
        return slices
