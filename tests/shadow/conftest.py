"""Lights, placed prims and look-ups that the shadow tests share."""

import numpy as np
import pytest
import warp as wp

from warp_smoke.geometry import corner_normals, transform_normals, transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.scene import DistantLight, PointLight, Surface
from warp_smoke.shadow.casters import Casters
from warp_smoke.study import shadow_scenes

_HARD = {"shadow_filter": "hard"}


def _placed(position):
    matrix = np.eye(4)
    matrix[3, :3] = position
    return matrix


def _aimed(direction):
    """A matrix whose −Z axis points along `direction`."""
    z = -np.asarray(direction, float) / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = x, np.cross(z, x), z
    return matrix


@pytest.fixture(scope="session")
def placed():
    """A function: position → transform."""
    return _placed


@pytest.fixture(scope="session")
def point_light():
    """A function: position → point light, with hard shadows unless told otherwise."""
    return lambda position, **fields: PointLight(path="/light", transform=_placed(position), **_HARD | fields)


@pytest.fixture(scope="session")
def distant_light():
    """A function: direction in which it shines → distant light, with hard shadows unless told otherwise."""
    return lambda direction, **fields: DistantLight(path="/light", transform=_aimed(direction), **_HARD | fields)


@pytest.fixture(scope="session")
def cast(launcher):
    """A function: (*(mesh, position)) → casters of these meshes at time 1."""

    def make(*placed_meshes, origin=(0, 0, 0)):
        surfaces = [
            Surface(path=f"/s{n}", mesh=mesh, transform=_placed(position))
            for n, (mesh, position) in enumerate(placed_meshes)
        ]
        casters = Casters(launcher, surfaces, origin)
        casters.update(1.0)
        return casters

    return make


@pytest.fixture(scope="session")
def sample_surface():
    """A function: (mesh, position, count, rng) → points spread evenly over the mesh and face normals, [n, 3]."""

    def sample(mesh, position, count, rng):
        corners = mesh.points_at(1.0).astype(float)[mesh.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        triangle = rng.choice(len(area), count, p=area / area.sum())
        share = rng.dirichlet((1, 1, 1), count)
        points = np.sum(share[:, :, None] * corners[triangle], axis=1)
        normals = corner_normals(mesh.points_at(1.0), mesh.triangles)[triangle, 0]
        matrix = _placed(position)
        return transform_points(matrix, points), transform_normals(matrix, normals)

    return sample


@pytest.fixture(scope="session")
def lattice_at():
    """A function: (shape, corner, voxel_size, axes, meters_per_unit) → lattice with open sides, Y up."""

    def make(shape, corner=None, voxel_size=1.0, axes=None, meters_per_unit=1.0):
        to_world = np.eye(4)
        to_world[:3, :3] = np.eye(3) if axes is None else axes
        size = voxel_size * np.asarray(shape)
        to_world[3, :3] = -0.5 * size @ to_world[:3, :3] if corner is None else corner
        return Lattice(
            shape=tuple(shape),
            voxel_size=voxel_size,
            to_world=to_world,
            meters_per_unit=meters_per_unit,
            sides=("open",) * 6,
            up=tuple(to_world[:3, :3] @ (0.0, 1.0, 0.0)),
        )

    return make


@pytest.fixture(scope="session")
def bunny():
    """The Stanford bunny of Warp's examples, about 1.6 units tall."""
    return shadow_scenes.bunny()


@pytest.fixture(scope="session")
def visibility(device):
    """A function: (shadow, points, normals) → visibility [n]."""

    def look_up(shadow, points, normals):
        points = np.asarray(points, np.float32)
        normals = np.broadcast_to(np.asarray(normals, np.float32), points.shape)
        points, normals = (wp.array(a, dtype=wp.vec3, device=device) for a in (points, normals))
        out = wp.full(len(points), -1.0, dtype=float, device=device)
        shadow.visibility(points, normals, out)
        return out.numpy()

    return look_up


@pytest.fixture(scope="session")
def transmittance(device):
    """A function: (*shadows, points=) → product of their transmittances [n]."""

    def look_up(*shadows, points):
        points = wp.array(np.asarray(points, np.float32), dtype=wp.vec3, device=device)
        out = wp.full((1, len(points)), 1.0, dtype=float, device=device)
        for shadow in shadows:
            shadow.transmittance(points, out)
        return out.numpy()[0]

    return look_up
