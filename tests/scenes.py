"""Small scenes that several tests share, built from records."""

import numpy as np

import warp_smoke as ws


def at(x: float, y: float, z: float) -> np.ndarray:
    """A transform that moves the origin to (x, y, z)."""
    matrix = np.eye(4)
    matrix[3, :3] = x, y, z
    return matrix


def shining(direction) -> np.ndarray:
    """A transform whose −Z axis points along a direction."""
    z = -np.asarray(direction, float) / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = x, np.cross(z, x), z
    return matrix


def floor(size: float = 6.0, texture_size: int = 64, **fields) -> ws.Surface:
    """A square floor in y = 0 around the origin that is baked."""
    mesh = ws.Mesh.grid((-size / 2, 0, size / 2), (size, 0, 0), (0, 0, -size))
    bake = ("lit", "visibility", "smokeShadow")
    receiver = ws.Receiver(path="/World/Floor", bake=bake, texture_size=texture_size)
    return ws.Surface(path="/World/Floor", mesh=mesh, receiver=receiver, **fields)


def plume(resolution: int = 16, frames: int = 4, **domain) -> ws.Scene:
    """Smoke over a baked floor under a point and a distant light: it calls for everything but solids."""
    return ws.Scene(
        domains=[
            ws.SmokeDomain(
                path="/World/Smoke", transform=at(0, 1, 0), resolution=resolution, buoyancy_temperature=4.0, **domain
            )
        ],
        emitters=[ws.Emitter(path="/World/Source", mesh=ws.Mesh.sphere(0.25, 16), transform=at(0, 0.4, 0))],
        surfaces=[floor()],
        lights=[
            ws.PointLight(path="/World/Lamp", transform=at(1.5, 3.5, 1.0), intensity=60.0),
            ws.DistantLight(path="/World/Sun", transform=shining((-0.4, -1.0, 0.2)), intensity=2.0),
        ],
        end=frames,
    )
