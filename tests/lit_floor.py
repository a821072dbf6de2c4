"""A floor under two lights, whose bakes have known values, for the tests of bakes."""

import numpy as np
from scenes import at

from warp_smoke.geometry import Mesh
from warp_smoke.scene import DistantLight, PointLight, Receiver, Surface

ORIGIN = np.zeros(3)
SIZE = 32


def downwards():
    """A transform whose −Z axis points down."""
    return np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def floor(**fields):
    """A floor of 4 × 4 units in y = 0 around the origin, v towards −z."""
    mesh = Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    return Surface(**{"path": "/Floor", "mesh": mesh, "receiver": Receiver(path="/Floor", texture_size=SIZE)} | fields)


def texel_points():
    """Where the floor's texel centres lie, [SIZE, SIZE, 3] from the top row."""
    along = (np.arange(SIZE) + 0.5) / SIZE * 4 - 2
    z, x = np.meshgrid(along, along, indexing="ij")
    return np.stack([x, np.zeros_like(x), z], axis=2)


def srgb(linear):
    """Codes 0…255 in float64, not rounded."""
    linear = np.clip(linear, 0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


LAMP = PointLight(path="/Lamp", transform=at(0.5, 1.0, -0.25), intensity=12.0, color=(1.0, 0.7, 0.4))
SUN = DistantLight(path="/Sun", transform=downwards(), intensity=1.5, color=(0.3, 0.5, 1.0))


def lamp_terms(points):
    """Unit vectors to the lamp, and B max(l·n, 0) of the floor, [..., 3] each."""
    offset = np.array([0.5, 1.0, -0.25]) - points
    d2 = np.sum(offset**2, axis=-1, keepdims=True)
    to_light = offset / np.sqrt(d2)
    return to_light, 12.0 / (4 * np.pi * d2) * np.array([1.0, 0.7, 0.4]) * to_light[..., 1:2]
