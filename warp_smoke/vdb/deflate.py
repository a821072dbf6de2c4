"""Deflates the values of many leaves, where that pays.

zlib takes 20 to 40 µs for the kilobyte of a leaf. In the half floats of a smooth field a Huffman code can only exploit
that signs and exponents are alike, which saves a seventh at best; without it, files are as large as with OpenVDB's own
blosc (docs/vdb.md). So half-float leaves are deflated only if their values repeat, and 32-bit leaves always.
"""

import zlib
from itertools import pairwise

import numpy as np


def deflate_leaves(values: np.ndarray, counts: np.ndarray) -> list[bytes | memoryview]:
    """Returns the bytes of each leaf: a zlib stream if that is shorter, else the raw values.

    Args:
        values: the leaves' values one after the other, float16 or float32, [m] or [m, 3].
        counts: how many numbers each leaf has, [n], none zero; their sum is the size of `values`.
    """
    numbers = values.reshape(-1)
    raw = memoryview(numbers.view(np.uint8))
    ends = np.cumsum(counts * numbers.itemsize).tolist()
    leaves = [raw[start:end] for start, end in pairwise((0, *ends))]
    halves = numbers.dtype == np.float16
    worth_trying = _repetitive(numbers, counts, lag=numbers.size // len(values)) if halves else range(len(leaves))
    for leaf in worth_trying:
        stream = zlib.compress(leaves[leaf], 1)
        if len(stream) < len(leaves[leaf]):
            leaves[leaf] = stream
    return leaves


def _repetitive(halves: np.ndarray, counts: np.ndarray, lag: int) -> np.ndarray:
    """Returns the indices of the leaves in which most values equal the previous one."""
    bits = halves.view(np.uint16)
    equal = np.zeros(len(bits), np.int32)
    np.equal(bits[lag:], bits[:-lag], out=equal[lag:], casting="unsafe")
    return (np.add.reduceat(equal, np.cumsum(counts) - counts) > counts // 2).nonzero()[0]
