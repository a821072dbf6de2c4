"""Small staggered grids in NumPy: sides, random velocities, and the Laplacian as matrices."""

from itertools import product

import numpy as np
import scipy.sparse

from warp_smoke.lattice import Lattice

PAIRS = list(product(("open", "closed"), repeat=2))
ALL_SIDES = [sum(pairs, ()) for pairs in product(PAIRS, repeat=3)]
# The same with every mix of axes that are periodic.
PERIODIC_SIDES = [
    sides
    for sides in (sum(pairs, ()) for pairs in product([*PAIRS, ("periodic",) * 2], repeat=3))
    if "periodic" in sides
]
CLOSED = ("closed",) * 6
PERIODIC = ("periodic",) * 6
SLAB = ("periodic", "periodic", "closed", "open", "periodic", "periodic")
OPEN = ("open",) * 6
MIXED = ("closed", "open", "open", "closed", "closed", "open")


def lattice_of(shape, sides=OPEN, voxel_size=1.0, to_world=None, meters_per_unit=1.0):
    """A lattice with its corner at the origin, unless it is placed by a matrix."""
    return Lattice(
        shape=shape,
        voxel_size=voxel_size,
        to_world=np.eye(4) if to_world is None else to_world,
        meters_per_unit=meters_per_unit,
        sides=sides,
        up=(0.0, 1.0, 0.0),
    )


def face_shapes(shape):
    """Shapes of u, v and w."""
    return [tuple(n + (a == axis) for a, n in enumerate(shape)) for axis in range(3)]


def random_velocity(launcher, shape, seed=0, sides=OPEN):
    """Normally distributed u, v and w on the device; both copies of faces on periodic sides are the same."""
    rng = np.random.default_rng(seed)
    components = [rng.standard_normal(faces).astype(np.float32) for faces in face_shapes(shape)]
    join_seams(components, sides)
    return tuple(launcher.array(component, "test") for component in components)


def no_velocity(launcher, shape):
    """Velocity 0 on the device."""
    return tuple(launcher.zeros(s, "test") for s in face_shapes(shape))


def laplacian_matrix(shares, sides):
    """L q = Σ a w (q_neighbour − q) over the flattened cells, from the open shares wx, wy, wz of the faces; sparse."""
    shape = tuple(n - (axis == 0) for axis, n in enumerate(shares[0].shape))
    cells = np.arange(np.prod(shape)).reshape(shape)
    rows, columns, values = [], [], []
    for axis, share in enumerate(shares):
        share = np.moveaxis(share.astype(np.float64), axis, 0)
        index = np.moveaxis(cells, axis, 0)
        a, b, w = index[:-1].ravel(), index[1:].ravel(), share[1:-1].ravel()
        rows += [a, b, a, b]
        columns += [b, a, a, b]
        values += [w, w, -w, -w]
        if sides[2 * axis] == "periodic":
            a, b, w = index[-1].ravel(), index[0].ravel(), share[0].ravel()
            rows += [a, b, a, b]
            columns += [b, a, a, b]
            values += [w, w, -w, -w]
        for end in (0, -1):
            if sides[2 * axis - end] == "open":
                rows.append(index[end].ravel())
                columns.append(index[end].ravel())
                values.append(-2.0 * share[end].ravel())
    rows, columns, values = (np.concatenate(each) for each in (rows, columns, values))
    return scipy.sparse.csr_array((values, (rows, columns)), shape=(cells.size, cells.size))


def open_shares(fluid, sides):
    """wx, wy, wz of a mask of fluid: 1 between cells of fluid, across periodic sides too, and on open sides, else 0."""
    shares = []
    for axis in range(3):
        mask = np.moveaxis(fluid, axis, 0)
        share = np.concatenate([mask[:1], mask[1:] * mask[:-1], mask[-1:]])
        for end in (0, -1):
            if sides[2 * axis] == "periodic":
                share[end] = mask[0] * mask[-1]
            else:
                share[end] *= sides[2 * axis - end] == "open"
        shares.append(np.ascontiguousarray(np.moveaxis(share, 0, axis), np.float32))
    return shares


def join_seams(faces, sides):
    """Makes the last faces of periodic axes the same as the first, in place."""
    for axis, field in enumerate(faces):
        if sides[2 * axis] == "periodic":
            ends = np.moveaxis(field, axis, 0)
            ends[-1] = ends[0]
