"""Coordinates brought into the unit square."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from warp_smoke.uv_fit import fit_unit_square


@pytest.mark.parametrize("uvs", [[[0, 0], [1, 1]], [[-0.001, 0.5], [1.001, 0.5]], [[0.2, 0.4]], [[np.nan, 0.0]], []])
def test_coordinates_that_stay_as_they_are(uvs):
    """Those within the square to rounding, those that are no numbers, and none at all."""
    assert fit_unit_square(np.array(uvs).reshape(-1, 2), 0.002) is None


@given(arrays(np.float32, (5, 2), elements=st.floats(-1e4, 1e4, width=32)))
def test_all_fits_reach_from_0_to_1(uvs):
    """What leaves the square reaches from 0 to 1 along u and v, or is 0 where all are equal; order is kept."""
    fit = fit_unit_square(uvs, 0.0)
    if fit is None:
        assert np.all((uvs >= 0) & (uvs <= 1))
        return
    fitted = fit(uvs)
    assert np.all((fitted >= 0) & (fitted <= 1))
    for axis in range(2):
        assert np.all(np.diff(fitted[np.argsort(uvs[:, axis]), axis]) >= 0)
        assert fitted[:, axis].min() == 0
        assert fitted[:, axis].max() == float(np.ptp(uvs[:, axis]) > 0)
