import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_smoke.vdb.deflate import deflate_leaves

LEAF = 512


def check(values: np.ndarray, counts: list[int]) -> np.ndarray:
    """Deflates; every leaf must be its own bytes or inflate to them, and never grow. Returns the sizes."""
    leaves = deflate_leaves(values, np.array(counts))
    raw = np.split(values.reshape(-1), np.cumsum(counts)[:-1])
    for leaf, expected in zip(leaves, raw, strict=True):
        if len(leaf) == expected.nbytes:
            assert bytes(leaf) == expected.tobytes()
        else:
            assert len(leaf) < expected.nbytes
            assert zlib.decompress(leaf) == expected.tobytes()
    return np.array([len(leaf) for leaf in leaves])


def test_noise_stays_raw():
    """Leaves in which deflate finds nothing are handed back as they are."""
    bits = np.random.default_rng(2).integers(0, 2**16, 4 * LEAF).astype(np.uint16)
    assert np.all(check(bits.view(np.float16), [LEAF] * 4) == 2 * LEAF)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("shape", [(4 * LEAF,), (4 * LEAF, 3)])
def test_constant_leaves(dtype, shape):
    """Leaves of one value all but vanish."""
    values = np.zeros(shape, dtype)
    values[...] = np.array([1.7, -3.2, 0.4])[: shape[-1]] if len(shape) == 2 else 1.7
    size = values[0].size
    assert np.all(check(values, [LEAF * size] * 4) < 0.06 * LEAF * values[0].nbytes)


@settings(deadline=None, max_examples=60)
@given(
    counts=st.lists(st.integers(1, LEAF), min_size=1, max_size=30),
    components=st.sampled_from([1, 3]),
    dtype=st.sampled_from([np.float16, np.float32]),
    spread=st.sampled_from([0.0, 0.1, 2.0, 10.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_leaves(counts, components, dtype, spread, seed):
    """Leaves of any sizes, scalar or vector, narrow or wide in magnitude, inflate exactly."""
    rng = np.random.default_rng(seed)
    values = np.exp2(rng.uniform(-spread, spread, (sum(counts), components))).astype(dtype)
    values *= rng.choice([-1, 1], values.shape).astype(dtype)
    check(values if components == 3 else values[:, 0], [components * count for count in counts])
