"""Decay towards ambient."""

from math import exp

import numpy as np

from warp_smoke.fluid.dissipation import decay


def test_decay_is_exact_in_time(launcher, upload):
    """Two half steps are one step, e^(−k dt) towards ambient; an enormous rate ends at ambient."""
    values = np.random.default_rng(2).uniform(-3, 5, (6, 7, 8)).astype(np.float32)
    whole, halves, fast = upload(values), upload(values), upload(values)
    decay(launcher, whole, 1.0, 2.0, 0.5)
    for _ in range(2):
        decay(launcher, halves, 1.0, 2.0, 0.25)
    decay(launcher, fast, 1.0, 1e6, 60.0)
    np.testing.assert_allclose(whole.numpy(), 1.0 + exp(-1.0) * (values - 1.0), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(halves.numpy(), whole.numpy(), rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(fast.numpy(), 1.0)
