"""Pressure problems among solids, their exact solutions by sparse LU, and solvers for them by name."""

from types import SimpleNamespace

import numpy as np
import scipy.sparse.csgraph
import scipy.sparse.linalg
from staggered import laplacian_matrix, open_shares

from warp_smoke.fluid.grid import Box
from warp_smoke.fluid.pressure import PRESSURE_SOLVERS, PressureProblem

AROUND_SOLIDS = [name for name in PRESSURE_SOLVERS if name != "spectral"]
CONJUGATE_GRADIENTS = ["multigrid", "spectral_conjugate_gradient", "conjugate_gradient"]


def solids_of(launcher, fluid, shares):
    """Solids as the solver sees them."""
    wx, wy, wz = (launcher.array(share.astype(np.float32), "test") for share in shares)
    device, box = launcher.array(fluid.astype(np.float32), "test"), Box((0, 0, 0), fluid.shape)
    return SimpleNamespace(fluid=device, wx=wx, wy=wy, wz=wz, box=box, changes=1)


def solver_of(launcher, name, fluid, sides, tolerance=1e-5, max_iterations=200, shares=None):
    """A solver around the solid cells (0) of a mask, and between closed faces if shares are given."""
    solids = solids_of(launcher, fluid, open_shares(fluid, sides) if shares is None else shares)
    problem = PressureProblem(
        shape=fluid.shape, sides=sides, solids=solids, tolerance=tolerance, max_iterations=max_iterations
    )
    return PRESSURE_SOLVERS[name](launcher, problem)


def solve(launcher, solver, divergence, guess=None):
    """The pressure as an array, and the status."""
    d = launcher.array(divergence.astype(np.float32), "test")
    q = launcher.array((np.zeros(d.shape) if guess is None else guess).astype(np.float32), "test")
    status = solver.solve(d, q)
    return q.numpy().copy(), status


def closed_components(fluid, sides, shares=None):
    """Masks of the bodies of fluid, connected through open faces, that touch no open side."""
    matrix = laplacian_matrix(open_shares(fluid, sides) if shares is None else shares, sides)
    matrix.eliminate_zeros()
    _, label = scipy.sparse.csgraph.connected_components(matrix, directed=False)
    label = label.reshape(fluid.shape)
    leaks = np.bincount(label.ravel(), weights=-matrix.sum(axis=1))
    bodies = np.unique(label[fluid > 0])
    return [label == body for body in bodies if leaks[body] < 1e-9]


def without_means(field, components):
    """The field with its mean over each component removed."""
    field = field.astype(np.float64).copy()
    for mask in components:
        field[mask] -= field[mask].mean()
    return field


def direct(divergence, shares, sides, components):
    """The pressure by sparse LU in float64, with mean 0 on closed components; solid cells are 0."""
    matrix = laplacian_matrix(shares, sides).tolil()
    right = without_means(divergence, components)
    for cell in np.flatnonzero(matrix.diagonal() == 0):
        matrix[cell, cell] = 1.0  # solid, or alone
        right.ravel()[cell] = 0.0
    for mask in components:
        cells = np.flatnonzero(mask)
        matrix[cells[0], :] = 0.0
        matrix[cells[0], cells] = 1.0  # stands for an equation that follows from the others
        right.ravel()[cells[0]] = 0.0
    return scipy.sparse.linalg.spsolve(matrix.tocsc(), right.ravel()).reshape(divergence.shape)
