"""Connections between cells near solids: the first closed face on a trace, and cells that open faces connect.

Traces step through the cells that their straight line crosses (J. Amanatides, A. Woo, *A Fast Voxel Traversal Algorithm
for Ray Tracing*, 1987).
"""

import warp as wp

from warp_smoke.fluid.interpolation import base

# Traces end a little before a closed face, so that round-off does not put them behind it.
SHORT = wp.constant(0.999)


@wp.struct
class SolidCells:
    """Cells and faces in the form that kernels take.

    fluid is 1 in fluid cells; held is 1 in cells whose content is on the same side of every wall as before the step;
    wx, wy, wz are the open shares of faces; crowded is 1 if the cell or a neighbour has a closed face or is not held;
    near is 1 if a trace ends in a crowded cell.
    """

    fluid: wp.array3d[float]
    held: wp.array3d[float]
    wx: wp.array3d[float]
    wy: wp.array3d[float]
    wz: wp.array3d[float]
    crowded: wp.array3d[float]
    near: wp.array3d[float]


@wp.func
def way_to_solid(solids: SolidCells, i: int, j: int, k: int, x: float, y: float, z: float):
    """Returns the share of the path from a cell's centre along (x, y, z) to the first closed face; 2 if none."""
    step_x = 1.0 / wp.abs(x)  # infinite along axes that are not crossed
    step_y = 1.0 / wp.abs(y)
    step_z = 1.0 / wp.abs(z)
    next_x = 0.5 * step_x
    next_y = 0.5 * step_y
    next_z = 0.5 * step_z
    way = wp.min(next_x, wp.min(next_y, next_z))
    result = wp.float32(2.0)
    while SHORT * way < 1.0:  # also for a trace that ends on the face itself, which rounds to the cell behind it
        share = wp.float32(0.0)
        if next_x == way:
            upwards = wp.where(x > 0.0, 1, 0)
            share = solids.wx[i + upwards, j, k]
            i += 2 * upwards - 1
            next_x += step_x
        elif next_y == way:
            upwards = wp.where(y > 0.0, 1, 0)
            share = solids.wy[i, j + upwards, k]
            j += 2 * upwards - 1
            next_y += step_y
        else:
            upwards = wp.where(z > 0.0, 1, 0)
            share = solids.wz[i, j, k + upwards]
            k += 2 * upwards - 1
            next_z += step_z
        fluid = solids.fluid
        if i < 0 or j < 0 or k < 0 or i >= fluid.shape[0] or j >= fluid.shape[1] or k >= fluid.shape[2]:
            break  # traces have already been limited to the domain
        if share == 0.0:
            result = way
            break
        way = wp.min(next_x, wp.min(next_y, next_z))
    return result


# The eight cells from (i, j, k) on are corners numbered x y z in binary; a set of them is an integer with one bit each.


@wp.func
def _corner(a: wp.array3d[float], i: int, j: int, k: int, corner: int):
    """Returns the value of a in a corner; along an axis of one cell both corners are that cell."""
    x = wp.min(i + corner // 4, a.shape[0] - 1)
    y = wp.min(j + (corner // 2) % 2, a.shape[1] - 1)
    z = wp.min(k + corner % 2, a.shape[2] - 1)
    return a[x, y, z]


@wp.func
def _connected(solids: SolidCells, i: int, j: int, k: int, start: int):
    """Returns the set of corners that can be reached from a corner through open faces."""
    # Bit n: the face between corner n and the next one along the axis is open.
    along_x = wp.int32(0)
    along_y = wp.int32(0)
    along_z = wp.int32(0)
    i1 = wp.min(i + 1, solids.fluid.shape[0] - 1)
    j1 = wp.min(j + 1, solids.fluid.shape[1] - 1)
    k1 = wp.min(k + 1, solids.fluid.shape[2] - 1)
    for a in range(2):
        for b in range(2):
            if solids.wx[i + 1, wp.where(a == 1, j1, j), wp.where(b == 1, k1, k)] > 0.0:
                along_x = along_x | (1 << (2 * a + b))
            if solids.wy[wp.where(a == 1, i1, i), j + 1, wp.where(b == 1, k1, k)] > 0.0:
                along_y = along_y | (1 << (4 * a + b))
            if solids.wz[wp.where(a == 1, i1, i), wp.where(b == 1, j1, j), k + 1] > 0.0:
                along_z = along_z | (1 << (4 * a + 2 * b))
    reached = 1 << start
    for _ in range(7):  # the longest path visits every corner once
        by_x = ((reached & along_x) << 4) | ((reached >> 4) & along_x)
        by_y = ((reached & along_y) << 2) | ((reached >> 2) & along_y)
        by_z = ((reached & along_z) << 1) | ((reached >> 1) & along_z)
        reached = reached | by_x | by_y | by_z
    return reached


@wp.func
def sum_connected(solids: SolidCells, a: wp.array3d[float], x: float, y: float, z: float):
    """Returns Σ w a and Σ w over the corners around (x, y, z) that are connected with it, w their trilinear weights.

    The point is in cell indices within a. Cells that are not held have no valid value and weight 0.
    """
    i = base(x, a.shape[0])
    j = base(y, a.shape[1])
    k = base(z, a.shape[2])
    fx = x - float(i)
    fy = y - float(j)
    fz = z - float(k)
    nearest = 4 * int(fx + 0.5) + 2 * int(fy + 0.5) + int(fz + 0.5)
    reached = _connected(solids, i, j, k, nearest)
    total = wp.float32(0.0)
    weights = wp.float32(0.0)
    for corner in range(8):
        if ((reached >> corner) & 1) == 1:
            weight = _corner(solids.held, i, j, k, corner)
            weight *= wp.where(corner // 4 == 1, fx, 1.0 - fx)
            weight *= wp.where((corner // 2) % 2 == 1, fy, 1.0 - fy)
            weight *= wp.where(corner % 2 == 1, fz, 1.0 - fz)
            total += weight * _corner(a, i, j, k, corner)
            weights += weight
    return total, weights
