"""Exact diffusion in an empty box: each mode of the Laplacian shrinks by 1 / (1 + r λ)."""

import numpy as np
import warp as wp

from warp_smoke.fluid.diffusion.problem import DiffusionProblem
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.halo import copy_samples, last_faces
from warp_smoke.fluid.transforms import (
    EVEN,
    ODD,
    PERIODIC,
    FastTransforms,
    MatrixTransforms,
    Modes,
    cell_modes,
    face_modes,
)
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _damp(
    rows: Rows,
    along_i: wp.array[float],
    along_j: wp.array[float],
    along_k: wp.array[float],
    r: float,
    modes_inout: wp.array3d[float],
):
    """Damping: a = a / (1 + r (λ_i + λ_j + λ_k))."""
    i, j, c = wp.tid()
    i += rows.first
    a = dense(modes_inout)
    across = along_i[i] + along_j[j]
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, modes_inout.shape[2])
    while k < end:
        a[i, j, k] = a[i, j, k] / (1.0 + r * (across + along_k[k]))
        k += 1


class SpectralDiffusion:
    """Exact in a box without colliders, by the modes of the Laplacian."""

    def __init__(self, launcher: Launcher, problem: DiffusionProblem):
        """Prepares the transforms.

        Args:
            launcher: where it runs.
            problem: a problem without solids.

        Raises:
            ValueError: there are colliders.
        """
        if problem.solids is not None:
            raise ValueError("diffusion_solver is spectral in a domain with colliders; allowed: jacobi")
        self._launcher, self._problem = launcher, problem
        self._axes = {field: _field_modes(problem, field) for field in problem.fields}
        self._eigenvalues = {
            field: [launcher.array(modes[axis].eigenvalues.astype(np.float32), "diffusion") for axis in range(3)]
            for field, modes in self._axes.items()
        }
        self._transforms = {field: self._make_transforms(problem, field) for field in problem.fields}

    def _make_transforms(self, problem: DiffusionProblem, field: int | None) -> FastTransforms | MatrixTransforms:
        modes = {axis: self._axes[field][axis] for axis in (2, 1, 0)}
        if self._launcher.device.is_cpu:
            return FastTransforms(self._launcher, modes)
        shape = problem.shape if field is None else face_shape(problem.shape, field)
        return MatrixTransforms(self._launcher, modes, shape, "diffusion")

    def diffuse(self, axis: int | None, field: wp.array, r: float) -> float:
        """Diffuses a field; see `DiffusionSolver.diffuse`."""
        if r == 0.0 or any(modes.first == modes.stop for modes in self._axes[axis]):
            return 0.0
        transforms = self._transforms[axis]
        transforms.forward(field, field)
        self._launcher.launch(_damp, field.shape, *self._eigenvalues[axis], r, field)
        transforms.inverse(field)
        if axis is not None and self._problem.sides[2 * axis] == "periodic":
            copy_samples(self._launcher, [last_faces(self._problem.shape, axis)], field, field)
        return 0.0


def _field_modes(problem: DiffusionProblem, field: int | None) -> list[Modes]:
    """Returns the modes of a field along each axis."""
    modes = []
    for axis, n in enumerate(problem.shape):
        ends = slice(2 * axis, 2 * axis + 2)
        if problem.sides[2 * axis] == "periodic":
            modes.append((face_modes if field == axis else cell_modes)(n, PERIODIC, PERIODIC))
        elif field is None:
            modes.append(cell_modes(n, *(ODD if side == "open" else EVEN for side in problem.sides[ends])))
        elif field == axis:
            modes.append(face_modes(n, *(EVEN if side == "open" else ODD for side in problem.sides[ends])))
        else:
            modes.append(cell_modes(n, *(ODD if sticks else EVEN for sticks in problem.no_slip[ends])))
    return modes
