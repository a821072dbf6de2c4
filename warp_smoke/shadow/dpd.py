"""Shadow of smoke by direct projection and diffusion (DPD), as published.

Zhan, Yang, Shi and Fei, "Real Time Smoke Shadow Simulation Based on Direct Projection and Diffusion", Journal of
Image and Graphics 13(11), 2008, 2231–2237: every voxel is added to one texel of a light buffer, one sweep spreads the
buffer, and projective texture mapping draws it as an opacity.
"""

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.record import FieldError
from warp_smoke.scene import Light
from warp_smoke.shadow.light_buffer import light_in_cells, light_times, set_to_cells
from warp_smoke.shadow.projective import fit_plane

wp.set_module_options({"enable_backward": False})

# Voxels are scattered in this many parts, each by one thread into a buffer of its own and added up in a fixed order:
# the result is the same on any device and for any number of threads, without atomics.
_PARTS = 16


@wp.struct
class ShadowTexture:
    """A light buffer as a texture.

    Attributes:
        buffer: Σ D over the voxels that fell on each texel, [W, H].
        matrix: B · P · V · M, set space to homogeneous texture coordinates (s, t, r, q), for column vectors.
        opacity: α of a texel with Σ D = 1.
    """

    buffer: wp.array2d[float]
    matrix: wp.mat44
    opacity: float


@wp.func
def shadow_opacity(texture: ShadowTexture, point: wp.vec3):
    """α = min(1, opacity · buf(s/q, t/q)), bilinear with edges clamped; 0 where q ≤ 0 or outside the texture."""
    c = texture.matrix * wp.vec4(point[0], point[1], point[2], 1.0)
    alpha = 0.0
    if c[3] > 0.0:
        s = c[0] / c[3]
        t = c[1] / c[3]
        if wp.min(s, t) >= 0.0 and wp.max(s, t) <= 1.0:
            w = texture.buffer.shape[0]
            h = texture.buffer.shape[1]
            x = wp.clamp(s * float(w) - 0.5, 0.0, float(w - 1))
            y = wp.clamp(t * float(h) - 0.5, 0.0, float(h - 1))
            i = int(x)
            j = int(y)
            i1 = wp.min(i + 1, w - 1)
            j1 = wp.min(j + 1, h - 1)
            g = y - float(j)
            near = wp.lerp(texture.buffer[i, j], texture.buffer[i, j1], g)
            far = wp.lerp(texture.buffer[i1, j], texture.buffer[i1, j1], g)
            alpha = wp.min(1.0, texture.opacity * wp.lerp(near, far, x - float(i)))
    return alpha


@wp.kernel
def _scatter_density(
    rows: Rows, density: wp.array3d[float], to_texels: wp.array2d[float], partial_out: wp.array3d[float]
):
    """partial[part][s][t] += D_W for each voxel W of the part, (s, t) being the texel that its centre falls on."""
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
def _sum_parts(rows: Rows, partial: wp.array3d[float], buffer_out: wp.array2d[float]):
    """buf[s][t] = Σ_part partial[part][s][t]."""
    n = rows.first + wp.tid()
    s = n // buffer_out.shape[1]
    t = n % buffer_out.shape[1]
    total = wp.float32(0.0)
    for part in range(partial.shape[0]):
        total += partial[part, s, t]
    buffer_out[s, t] = total


@wp.kernel
def _diffuse_sweep(rows: Rows, buffer: wp.array2d[float], r: float, buffer_out: wp.array2d[float]):
    """u₁(i,j) = (u₀(i,j) + r (u₀(i−1,j) + u₀(i+1,j) + u₀(i,j−1) + u₀(i,j+1))) / (1 + 4 r), mirrored at the edges."""
    n = rows.first + wp.tid()
    i = n // buffer.shape[1]
    j = n % buffer.shape[1]
    i0 = wp.max(i - 1, 0)
    i1 = wp.min(i + 1, buffer.shape[0] - 1)
    j0 = wp.max(j - 1, 0)
    j1 = wp.min(j + 1, buffer.shape[1] - 1)
    around = buffer[i0, j] + buffer[i1, j] + buffer[i, j0] + buffer[i, j1]
    buffer_out[i, j] = (buffer[i, j] + r * around) / (1.0 + 4.0 * r)


@wp.kernel
def _let_through(rows: Rows, texture: ShadowTexture, points: wp.array[wp.vec3], transmittance_inout: wp.array[float]):
    """transmittance[n] *= 1 − α(points[n])."""
    n = rows.first + wp.tid()
    transmittance_inout[n] = transmittance_inout[n] * (1.0 - shadow_opacity(texture, points[n]))


@wp.kernel
def _composite_shadow(
    rows: Rows, texture: ShadowTexture, points: wp.array[wp.vec3], shadow: wp.vec3, colors_inout: wp.array[wp.vec3]
):
    """C[n] = α C_shadow + (1 − α) C[n]."""
    n = rows.first + wp.tid()
    alpha = shadow_opacity(texture, points[n])
    colors_inout[n] = alpha * shadow + (1.0 - alpha) * colors_inout[n]


def diffuse_buffer(launcher: Launcher, buffer: wp.array, r: float, buffer_out: wp.array) -> None:
    """One sweep of the paper's equation (3), r = ν Δt / h².

    It is the first Jacobi sweep of the implicit step (I − νΔt ∇²) u₁ = u₀: it keeps the sum and the range of u₀, and
    adds a variance of 2 r / (1 + 4 r) texels², which is that of diffusion only as r → 0.

    Args:
        launcher: launches the kernel.
        buffer: u₀ [W, H].
        r: ≥ 0.
        buffer_out: u₁ [W, H].
    """
    launcher.launch_each(_diffuse_sweep, buffer.size, buffer, r, buffer_out)


class DpdSmokeShadow:
    """How much of a light the smoke of one domain lets through, by the paper's method (`dpd`).

    The light buffer lies on the far side of the box, at right angles to the line from the light to the box's centre,
    and rays are parallel to that line. On receivers it is looked up in perspective from a point light. It knows no
    depth: whatever is in front of the light and inside the buffer's outline is in the shadow, smoke or no smoke before
    it. Opacity is linear in density, α = min(1, σ h Σ D / A) with A the area of a texel in cells, so that the buffer's
    Σ α A is σ times the mass as long as none is clipped.

    Attributes:
        texture: the buffer and its matrix, for kernels that use `shadow_opacity`.
    """

    def __init__(
        self,
        launcher: Launcher,
        lattice: Lattice,
        light: Light,
        origin: np.ndarray,
        extinction: float,
        texels: tuple[int, int] | None = None,
    ):
        """Makes the buffer; `update` fills it.

        Args:
            launcher: launches the kernels.
            lattice: the smoke's cells.
            light: any light outside the domain; its `smoke_diffusion` is r of `diffuse_buffer`.
            origin: world position of set space's origin [stage units], [3] float64.
            extinction: σ [1/m] at density 1.
            texels: width and height of the buffer; None = square, `smoke_shadow_size` or as many as the domain's
                longest side has cells.

        Raises:
            ValueError: for a light that is inside the domain.
        """
        self._launcher, self._lattice, self._light = launcher, lattice, light
        self._set_to_cells = set_to_cells(lattice, np.asarray(origin, np.float64))
        self._optical_depth = extinction * lattice.h
        size = light.smoke_shadow_size or max(lattice.shape)
        width, height = texels or (size, size)
        self._partial = launcher.zeros((_PARTS, width, height), "light_buffer")
        self._projected = launcher.zeros((width, height), "light_buffer")
        self._diffused = launcher.zeros((width, height), "light_buffer") if light.smoke_diffusion else self._projected
        self._to_texels = launcher.zeros((2, 4), "light_buffer")
        for time in light_times(light):
            self._place(time)

    def update(self, density: wp.array, time: float) -> None:
        """Projects and diffuses the smoke [nx, ny, nz], with the light as at a time code."""
        if self._light.moves:
            self._place(time)
        self._partial.zero_()
        self._launcher.launch_each(_scatter_density, _PARTS, density, self._to_texels, self._partial)
        self._launcher.launch_each(_sum_parts, self._projected.size, self._partial, self._projected)
        if self._light.smoke_diffusion:
            diffuse_buffer(self._launcher, self._projected, self._light.smoke_diffusion, self._diffused)

    def transmittance(self, points: wp.array, transmittance_inout: wp.array) -> None:
        """Multiplies by 1 − α: the paper's compositing with a black shadow.

        Args:
            points: in set space, [n] vec3.
            transmittance_inout: [n].
        """
        self._launcher.launch_each(_let_through, len(points), self.texture, points, transmittance_inout)

    def composite(self, points: wp.array, shadow_color: tuple[float, float, float], colors_inout: wp.array) -> None:
        """C = α C_shadow + (1 − α) C_surface.

        Args:
            points: in set space, [n] vec3.
            shadow_color: C_shadow, linear RGB.
            colors_inout: C_surface, linear RGB, [n] vec3.
        """
        shadow = wp.vec3(*map(float, shadow_color))
        self._launcher.launch_each(_composite_shadow, len(points), self.texture, points, shadow, colors_inout)

    def buffer(self) -> np.ndarray:
        """Σ D on each texel after diffusion, [W, H]."""
        return self._diffused.numpy()

    def _place(self, time: float) -> None:
        """Places the plane for the light at a time code."""
        light, lattice = self._light, self._lattice
        plane = fit_plane(light_in_cells(light, lattice, time), lattice.shape, np.asarray(lattice.up))
        if plane is None:
            where = f"at {light.position_at(time).tolist()}, inside the smoke domain"
            raise FieldError(light.path, "position", where, "a place outside, or smoke_shadow = ray_traced")
        width, height = self._diffused.shape
        self._to_texels.assign(plane.to_texels(width, height).astype(np.float32))
        texture = self.texture = ShadowTexture()
        texture.buffer = self._diffused
        texture.matrix = wp.mat44((self._set_to_cells @ plane.texture_matrix()).T.astype(np.float32))
        area = 4.0 * float(plane.half.prod()) / (width * height)
        texture.opacity = self._optical_depth / area
