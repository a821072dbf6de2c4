"""Velocities and fields that the fluid's tests share."""

from collections.abc import Callable

import numpy as np
import pytest

from warp_smoke.fluid.grid import face_shape


@pytest.fixture
def upload(launcher) -> Callable:
    """Copies a NumPy array to the device as float32."""
    return lambda values: launcher.array(np.ascontiguousarray(values, np.float32), "test")


@pytest.fixture
def sample_velocity(upload) -> Callable:
    """Samples f(x, y, z) → (u, v, w), x, y, z in cell indices, on the faces of a lattice of a shape.

    Cell (i, j, k) has its centre at (i, j, k).
    """

    def sample(f, shape):
        components = []
        for axis in range(3):
            points = np.indices(face_shape(shape, axis), dtype=float)
            points[axis] -= 0.5
            component = np.broadcast_to(f(*points)[axis], points.shape[1:])
            components.append(upload(component))
        return tuple(components)

    return sample
