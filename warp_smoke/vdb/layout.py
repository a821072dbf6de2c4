"""The file layout that the writer and the reader of OpenVDB files share: version 224 and the 5-4-3 tree.

Source: K. Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", 2013, and the OpenVDB library's files.

A root holds upper nodes of 32³ lower nodes of 16³ leaves of 8³ voxels. Child or voxel (x, y, z) of a node of n³ has
slot number (x n + y) n + z; a node's bit masks have slot 0 in the lowest bit. Everything in the file is little-endian.
"""

import struct

import numpy as np

MAGIC = 0x56444220
FILE_VERSION = 224
HEADER = struct.Struct("<qIIIB36s")  # magic, file version, library version (two numbers), has offsets, UUID

# Compression flags of a grid.
ZIP, ACTIVE_MASK, BLOSC = 1, 2, 4

# Children or voxels along an axis of a node, and voxels along an axis of an upper and a lower node.
UPPER, LOWER, LEAF = 32, 16, 8
UPPER_SPAN, LOWER_SPAN = UPPER * LOWER * LEAF, LOWER * LEAF
LEAF_VOXELS = LEAF**3

HALF_SUFFIX = "_HalfFloat"
SCALAR_TREE, VECTOR_TREE = "Tree_float_5_4_3", "Tree_vec3s_5_4_3"


def slots(position: np.ndarray, size: int) -> np.ndarray:
    """Returns the slot numbers [n] of positions [n, 3] in a node of size³."""
    return (position[:, 0] * size + position[:, 1]) * size + position[:, 2]


def active_bounds(leaves: np.ndarray, masks: np.ndarray) -> tuple[list[int], list[int]]:
    """Returns the lowest and highest index of the active voxels along each axis.

    Args:
        leaves: positions of leaves in units of leaves, [n, 3], at least one.
        masks: active voxels of each leaf, bool [n, 512], at least one in each leaf.
    """
    lowest, highest = [], []
    for axis, along in enumerate(leaves.T):
        others = tuple({0, 1, 2} - {axis})
        first, last = (
            masks[along == edge].any(axis=0).reshape(LEAF, LEAF, LEAF).any(axis=others).nonzero()[0]
            for edge in (along.min(), along.max())
        )
        lowest.append(int(along.min()) * LEAF + int(first[0]))
        highest.append(int(along.max()) * LEAF + int(last[-1]))
    return lowest, highest
