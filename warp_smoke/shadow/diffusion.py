"""Energy diffusion of a light buffer: the paper's single sweep, enough sweeps to converge, and the exact solution.

Zhan, Yang, Shi and Fei (2008), equation (3), with r = νΔt/h² and h a texel's width. Edges are mirrored, so every method
conserves the buffer's sum; none leaves the buffer's range.
"""

import math

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _diffuse_sweep(
    rows: Rows, u: wp.array3d[float], near: wp.array3d[float], own: float, r: float, u_out: wp.array3d[float]
):
    """u_out(i,j) = own · u(i,j) + r (v(i−1,j) + v(i+1,j) + v(i,j−1) + v(i,j+1)), v = near, mirrored at the edges."""
    i, n, c = wp.tid()
    i += rows.first
    src = dense(u)
    v = dense(near)
    dst = dense(u_out)
    before = wp.max(i - 1, 0)
    after = wp.min(i + 1, u.shape[1] - 1)
    last = u.shape[2] - 1
    j = wp.max(c * rows.run, 0)
    end = wp.min(j + rows.run, u.shape[2])
    while j < end:
        around = v[n, before, j] + v[n, after, j] + v[n, i, wp.max(j - 1, 0)] + v[n, i, wp.min(j + 1, last)]
        dst[n, i, j] = own * src[n, i, j] + r * around
        j += 1


class Diffusion:
    """Diffuses light buffers by νΔt = r texels².

    - `paper`: one sweep u₁ = (u₀ + r Σ u₀)/(1 + 4r), Σ over the four neighbours. It is the first Jacobi sweep of the
      implicit step (I − νΔt∇²) u₁ = u₀, and adds a variance of 2r/(1 + 4r) texels² where diffusion adds 2r.
    - `sweeps`: the given number of Jacobi sweeps of the implicit step; without a number, ⌈8r⌉ explicit substeps, none
      of which flips a wave's sign (gain 1 − 8r/n ≥ 0).
    - `exact`: e^(r Δ) u₀ by cosine transforms, with Δ the five-point Laplacian.
    """

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], r: float, method: str, sweeps: int | None):
        """Allocates the scratch memory.

        Args:
            launcher: launches the kernels.
            shape: number of buffers, and their width and height in texels, (n, W, H).
            r: νΔt/h², > 0.
            method: paper, sweeps or exact.
            sweeps: number for the method `sweeps`, or None.
        """
        self._launcher, self._r, self._method, self._sweeps = launcher, r, method, sweeps
        self._first = launcher.zeros(shape, "light_buffer")
        self._second = launcher.zeros(shape, "light_buffer") if method == "sweeps" else None
        if method == "exact":
            eigenvalues = [2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in shape[1:]]
            self._gain = np.exp(-r * np.add.outer(*eigenvalues)).astype(np.float32)

    def spread(self, buffer: wp.array) -> wp.array:
        """Returns the diffused buffers [n, W, H], in this object's memory; `buffer` is left as it is."""
        r = self._r
        if self._method == "exact":
            from scipy import fft  # takes 0.1 s to import, and is needed only here

            spectrum = fft.dctn(buffer.numpy(), axes=(1, 2), norm="ortho")
            spectrum *= self._gain
            # e^(rΔ) keeps values from becoming negative; round-off may not.
            self._first.assign(np.maximum(fft.idctn(spectrum, axes=(1, 2), norm="ortho", overwrite_x=True), 0.0))
            return self._first
        if self._method == "sweeps" and self._sweeps is None:
            n = max(math.ceil(8.0 * r), 1)
            steps = [(None, 1.0 - 4.0 * r / n, r / n)] * n
        else:
            n = 1 if self._method == "paper" else self._sweeps
            steps = [(buffer, 1.0 / (1.0 + 4.0 * r), r / (1.0 + 4.0 * r))] * n
        before, other = buffer, self._second
        for source, own, weight in steps:
            out = self._first if before is not self._first else other
            self._sweep(before if source is None else source, before, own, weight, out)
            before = out
        return before

    def _sweep(self, u: wp.array, near: wp.array, own: float, r: float, out: wp.array) -> None:
        n, width, height = out.shape
        self._launcher.launch(_diffuse_sweep, (width, n, height), u, near, own, r, out)
