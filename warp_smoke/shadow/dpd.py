"""Smoke shadow by direct projection and diffusion (DPD), as published.

Zhan, Yang, Shi and Fei, "Real Time Smoke Shadow Simulation Based on Direct Projection and Diffusion", Journal of
Image and Graphics 13(11), 2008, 2231–2237: every voxel is added to one texel of a light buffer, one sweep spreads the
buffer, and projective texture mapping draws it as an opacity. Beyond the paper: projection along a point light's true
rays, diffusion that solves its equation, and transmittance instead of linear opacity.
"""

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.record import FieldError
from warp_smoke.scene import Light
from warp_smoke.shadow.diffusion import Diffusion
from warp_smoke.shadow.light_buffer import light_in_cells, light_times, set_to_cells
from warp_smoke.shadow.projective import SCATTER_PARTS, fit_plane

wp.set_module_options({"enable_backward": False})


@wp.struct
class ShadowTexture:
    """A light buffer as a texture.

    Attributes:
        buffer: Σ D over the voxels projected to each texel, [1, W, H].
        matrix: B · P · V · M, set space to homogeneous texture coordinates (s, t, r, q), for column vectors.
        optical_depth: τ of a texel with Σ D = 1.
        linear: 1 for α = min(1, τ), as published, 0 for α = 1 − e^(−τ).
    """

    buffer: wp.array3d[float]
    matrix: wp.mat44
    optical_depth: float
    linear: int


@wp.func
def shadow_depth(texture: ShadowTexture, point: wp.vec3):
    """τ = optical_depth · buf(s/q, t/q), bilinear with edges clamped; 0 where q ≤ 0 or outside the texture."""
    c = texture.matrix * wp.vec4(point[0], point[1], point[2], 1.0)
    depth = 0.0
    if c[3] > 0.0:
        s = c[0] / c[3]
        t = c[1] / c[3]
        if wp.min(s, t) >= 0.0 and wp.max(s, t) <= 1.0:
            w = texture.buffer.shape[1]
            h = texture.buffer.shape[2]
            x = wp.clamp(s * float(w) - 0.5, 0.0, float(w - 1))
            y = wp.clamp(t * float(h) - 0.5, 0.0, float(h - 1))
            i = int(x)
            j = int(y)
            i1 = wp.min(i + 1, w - 1)
            j1 = wp.min(j + 1, h - 1)
            g = y - float(j)
            near = wp.lerp(texture.buffer[0, i, j], texture.buffer[0, i, j1], g)
            far = wp.lerp(texture.buffer[0, i1, j], texture.buffer[0, i1, j1], g)
            depth = texture.optical_depth * wp.lerp(near, far, x - float(i))
    return depth


@wp.func
def opacity(texture: ShadowTexture, depth: float):
    """α of an optical depth: linear up to 1, or by Beer and Lambert."""
    if texture.linear == 1:
        return wp.min(1.0, depth)
    return 1.0 - wp.exp(-depth)


@wp.kernel
def _scatter_density(
    rows: Rows, density: wp.array3d[float], to_texels: wp.array2d[float], partial_out: wp.array3d[float]
):
    """partial[part][s][t] += D_W for each voxel W of the part, (s, t) being the texel of its centre."""
    part = rows.first + wp.tid()
    ni = density.shape[0]
    nj = density.shape[1]
    nk = density.shape[2]
    count = ni * nj
    for row in range(part * count // partial_out.shape[0], (part + 1) * count // partial_out.shape[0]):
        i = row // nj
        j = row % nj
        s = to_texels[0, 0] * float(i) + to_texels[0, 1] * float(j) + to_texels[0, 3]
        t = to_texels[1, 0] * float(i) + to_texels[1, 1] * float(j) + to_texels[1, 3]
        for k in range(nk):
            d = density[i, j, k]
            if d != 0.0:
                p = wp.clamp(int(s + to_texels[0, 2] * float(k)), 0, partial_out.shape[1] - 1)
                q = wp.clamp(int(t + to_texels[1, 2] * float(k)), 0, partial_out.shape[2] - 1)
                partial_out[part, p, q] = partial_out[part, p, q] + d


@wp.kernel
def _scatter_along_rays(
    rows: Rows,
    density: wp.array3d[float],
    to_texels: wp.array2d[float],
    light: wp.vec3,
    partial_out: wp.array3d[float],
):
    """As `_scatter_density`, with D_W / (q² cos θ) on the texel at (s/q, t/q), for a light in cell coordinates.

    q is the voxel's depth as a share of the plane's: a voxel in front of the plane covers 1/q² as much of it. Its ray
    crosses it at the angle θ to the plane's normal.
    """
    part = rows.first + wp.tid()
    ni = density.shape[0]
    nj = density.shape[1]
    count = ni * nj
    for row in range(part * count // partial_out.shape[0], (part + 1) * count // partial_out.shape[0]):
        i = row // nj
        j = row % nj
        for k in range(density.shape[2]):
            d = density[i, j, k]
            if d != 0.0:
                x = wp.vec3(float(i) + 0.5, float(j) + 0.5, float(k) + 0.5)
                q = to_texels[2, 0] * x[0] + to_texels[2, 1] * x[1] + to_texels[2, 2] * x[2] + to_texels[2, 3]
                s = to_texels[0, 0] * x[0] + to_texels[0, 1] * x[1] + to_texels[0, 2] * x[2] + to_texels[0, 3]
                t = to_texels[1, 0] * x[0] + to_texels[1, 1] * x[1] + to_texels[1, 2] * x[2] + to_texels[1, 3]
                p0 = wp.clamp(int(s / q), 0, partial_out.shape[1] - 1)
                p1 = wp.clamp(int(t / q), 0, partial_out.shape[2] - 1)
                # cos θ is q times the plane's distance, over |x − L|; to_texels[3, 0] is 1 over that distance.
                weight = wp.length(x - light) * to_texels[3, 0] / (q * q * q)
                partial_out[part, p0, p1] = partial_out[part, p0, p1] + weight * d


@wp.kernel
def _sum_parts(rows: Rows, partial: wp.array3d[float], buffer_out: wp.array3d[float]):
    """buf[s][t] = Σ_part partial[part][s][t]."""
    n = rows.first + wp.tid()
    s = n // buffer_out.shape[2]
    t = n % buffer_out.shape[2]
    total = wp.float32(0.0)
    for part in range(partial.shape[0]):
        total += partial[part, s, t]
    buffer_out[0, s, t] = total


@wp.kernel
def _let_through(
    rows: Rows,
    texture: ShadowTexture,
    points: wp.array[wp.vec3],
    color: wp.vec3,
    transmittance_inout: wp.array2d[float],
):
    """transmittance[c, n] *= 1 − α(color_c τ(points[n]))."""
    n = rows.first + wp.tid()
    depth = shadow_depth(texture, points[n])
    for c in range(transmittance_inout.shape[0]):
        transmittance_inout[c, n] = transmittance_inout[c, n] * (1.0 - opacity(texture, color[c] * depth))


@wp.kernel
def _composite_shadow(
    rows: Rows,
    texture: ShadowTexture,
    points: wp.array[wp.vec3],
    color: wp.vec3,
    shadow: wp.vec3,
    colors_inout: wp.array[wp.vec3],
):
    """C[n] = α C_shadow + (1 − α) C[n], for each of red, green and blue."""
    n = rows.first + wp.tid()
    depth = shadow_depth(texture, points[n])
    alpha = wp.vec3(
        opacity(texture, color[0] * depth), opacity(texture, color[1] * depth), opacity(texture, color[2] * depth)
    )
    surface = colors_inout[n]
    colors_inout[n] = surface + wp.cw_mul(alpha, shadow - surface)


class DpdSmokeShadow:
    """How much of a light the smoke of one domain lets through, by the paper's method (`dpd`).

    The light buffer lies on the far side of the box, perpendicular to the line from the light to the box's centre, and
    rays are parallel to that line, or with `smoke_projection` rays the true ones. Receivers look it up in perspective
    from a point light. The buffer has no depth: whatever the light shines on within the buffer's outline is in shadow,
    whether the smoke is in front of it or not. With `smoke_compositing` opacity, it is linear in density,
    α = min(1, σ h Σ D / A) with A the area of a texel in cells, so that for parallel rays the buffer's Σ α A is σ times
    the mass as long as nothing is clipped.

    Attributes:
        texture: the buffer and its matrix, for kernels that use `shadow_depth`.
    """

    def __init__(
        self,
        launcher: Launcher,
        lattice: Lattice,
        light: Light,
        origin: np.ndarray,
        extinction: float,
        color: tuple[float, float, float] = (1.0, 1.0, 1.0),
        texels: tuple[int, int] | None = None,
    ):
        """Allocates the buffer; `update` fills it.

        Args:
            launcher: launches the kernels.
            lattice: the smoke's cells.
            light: any light outside the domain; its `smoke_…` fields are the options.
            origin: world position of set space's origin [stage units], [3] float64.
            extinction: σ [1/m] at density 1.
            color: factor on σ for red, green and blue.
            texels: width and height of the buffer; None = square, `smoke_shadow_size` or as many as the domain's
                longest side has cells.

        Raises:
            ValueError: the light is inside the domain, or for true rays too near to it.
        """
        self._launcher, self._lattice, self._light = launcher, lattice, light
        self._set_to_cells = set_to_cells(lattice, np.asarray(origin, np.float64))
        self._optical_depth = extinction * lattice.h
        size = light.smoke_shadow_size or max(lattice.shape)
        width, height = texels or (size, size)
        self._color = wp.vec3(*color)
        self._partial = launcher.zeros((SCATTER_PARTS, width, height), "light_buffer")
        self._projected = self._spread = launcher.zeros((1, width, height), "light_buffer")
        self._diffusion = None
        if light.smoke_diffusion:
            how = (light.smoke_diffusion, light.smoke_diffuser, light.smoke_sweeps)
            self._diffusion = Diffusion(launcher, self._projected.shape, *how)
        self._to_texels = launcher.zeros((4, 4), "light_buffer")
        for time in light_times(light):
            self._place(time)

    def update(self, density: wp.array, time: float) -> None:
        """Projects and diffuses the smoke [nx, ny, nz], with the light at a time code."""
        if self._light.moves:
            self._place(time)
        self._partial.zero_()
        launch = self._launcher.launch_each
        if self._eye is None:
            launch(_scatter_density, SCATTER_PARTS, density, self._to_texels, self._partial)
        else:
            launch(_scatter_along_rays, SCATTER_PARTS, density, self._to_texels, self._eye, self._partial)
        launch(_sum_parts, self._projected.size, self._partial, self._projected)
        if self._diffusion:
            self._spread = self._diffusion.spread(self._projected)
            self.texture.buffer = self._spread

    def transmittance(self, points: wp.array, transmittance_inout: wp.array) -> None:
        """Multiplies by 1 − α: the paper's compositing with a black shadow.

        Args:
            points: in set space, [n] vec3.
            transmittance_inout: [1, n], or [3, n] for red, green and blue.
        """
        args = (self.texture, points, self._color, transmittance_inout)
        self._launcher.launch_each(_let_through, len(points), *args)

    def composite(self, points: wp.array, shadow_color: tuple[float, float, float], colors_inout: wp.array) -> None:
        """Blends a shadow colour over surfaces: C = α C_shadow + (1 − α) C_surface.

        Args:
            points: in set space, [n] vec3.
            shadow_color: C_shadow, linear RGB.
            colors_inout: C_surface, linear RGB, [n] vec3.
        """
        shadow = wp.vec3(*map(float, shadow_color))
        self._launcher.launch_each(
            _composite_shadow, len(points), self.texture, points, self._color, shadow, colors_inout
        )

    def buffer(self) -> np.ndarray:
        """Returns Σ D on each texel after diffusion, [W, H]."""
        return self._spread.numpy()[0]

    def _place(self, time: float) -> None:
        """Places the plane for the light at a time code."""
        light, lattice = self._light, self._lattice
        rays = light.smoke_projection == "rays"
        cells = light_in_cells(light, lattice, time)
        plane = fit_plane(cells, lattice.shape, np.asarray(lattice.up), rays)
        if plane is None:
            where = f"at {light.position_at(time).tolist()}, inside the smoke domain" + " or too near to it" * rays
            raise FieldError(light.path, "position", where, "a place outside, or smoke_shadow = ray_traced")
        _, width, height = self._projected.shape
        matrix = np.zeros((4, 4), np.float32)
        self._eye = None
        if rays and cells[3]:
            self._eye = wp.vec3(*cells[:3].tolist())
            matrix[:3] = plane.ray_texels(width, height)
            matrix[3, 0] = 1.0 / (plane.distance + plane.depth)
        else:
            matrix[:2] = plane.to_texels(width, height)
        self._to_texels.assign(matrix)
        texture = self.texture = ShadowTexture()
        texture.buffer = self._spread
        texture.matrix = wp.mat44((self._set_to_cells @ plane.texture_matrix()).T.astype(np.float32))
        area = 4.0 * float(plane.half.prod()) / (width * height)
        texture.optical_depth = self._optical_depth / area
        texture.linear = int(light.smoke_compositing == "opacity")
