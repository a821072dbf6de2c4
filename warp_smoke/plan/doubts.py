"""Warnings about parts of a scene that can be run but were probably not intended."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from warp_smoke.geometry import Mesh, corner_normals, transform_normals, transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.plan.participants import heats, pushes, stirs, weighs
from warp_smoke.plan.passes import DomainPlan, ReceiverPlan
from warp_smoke.plan.reach import is_moving
from warp_smoke.record import each_value, value_at
from warp_smoke.scene import (
    ArrayCollider,
    ArrayEmitter,
    Collider,
    DistantLight,
    Emitter,
    Light,
    Scene,
    Surface,
)

# Fraction of a cell's side below which an emitter is too small. Measured: the output of a ball this wide differs by a
# factor of 8 between the middle of a cell and its corner, that of a ball of 0.75 by a factor of 2.6.
_SMALL = 0.5


def open_meshes(domains: Iterable[DomainPlan]) -> Iterator[str]:
    """Yields a warning for each emitter or collider with holes, whose inside can only be estimated."""
    shapes = {each.path: each for domain in domains for each in (*domain.emitters, *domain.colliders)}
    for path, each in shapes.items():
        mesh = getattr(each, "mesh", None)
        if isinstance(mesh, Mesh) and not mesh.is_closed:
            yield f"{path}: its mesh is not closed; what counts as inside it is estimated"


def idle_emitters(scene: Scene, domains: Sequence[DomainPlan]) -> Iterator[str]:
    """Yields warnings for emitters without effect, and for domains that hold no smoke, only hot or moving air."""
    for each in scene.emitters:
        here = [domain for domain in domains if any(each.path == other.path for other in domain.emitters)]
        if not _smokes(each) and not any(_stirs_or_heats(each, domain) for domain in here):
            yield f"{each.path}: it has no effect: its density or rate is 0, and its heat and motion are not used"
    for domain in domains:
        if not any(map(_smokes, domain.emitters)) and "temperature" not in domain.grids:
            sources = ", ".join(each.path for each in domain.emitters)
            yield f"{domain.domain.path}: it never holds smoke: the density or rate of {sources} is 0"


def _smokes(emitter: Emitter | ArrayEmitter) -> bool:
    """Returns whether it ever emits smoke."""
    rate = getattr(emitter, "rate", None)
    return weighs(emitter) and (rate is None or bool(np.any(each_value(rate))))


def _stirs_or_heats(emitter: Emitter | ArrayEmitter, domain: DomainPlan) -> bool:
    heated = "emit_temperature" in domain.passes and heats(emitter, domain.domain.ambient_temperature)
    return heated or pushes(emitter) or stirs(emitter)


def small_emitters(domains: Iterable[DomainPlan], time: float) -> Iterator[str]:
    """Yields a warning for each emitter smaller than half a cell: what share of a cell it fills is left to chance."""
    for domain in domains:
        for each in domain.emitters:
            if isinstance(each, Emitter) and isinstance(each.mesh, Mesh):
                points = transform_points(each.transform_at(time), each.mesh.points_at(time)) @ domain.lattice.axes.T
                size, cell = np.ptp(points, axis=0).max(initial=0.0), domain.lattice.voxel_size
                if 0.0 < size < _SMALL * cell:
                    yield (
                        f"{each.path}: it is {size:.3g} across and the cells of {domain.domain.path} are {cell:.3g}, "
                        "so how much it emits, if any, depends on where in a cell it is; is a higher resolution meant?"
                    )


def filled_domains(domains: Iterable[DomainPlan], time: float) -> Iterator[str]:
    """Yields a warning for each stationary collider that fills a domain, leaving room for neither air nor smoke."""
    for domain in domains:
        for each in domain.colliders:
            if not is_moving(each) and _fills(each, domain.lattice, time):
                yield f"{each.path}: it fills {domain.domain.path}, which holds neither air nor smoke"


def _fills(collider: Collider | ArrayCollider, lattice: Lattice, time: float) -> bool:
    """Returns whether all cell centres are inside: the middle is, and no triangle comes near their box."""
    if isinstance(collider, ArrayCollider):
        return bool(np.all(value_at(collider.solid, time) <= 0.0))
    points = transform_points(collider.transform_at(time) @ lattice.world_to_cells(), collider.mesh.points_at(time))
    corners = points[collider.mesh.triangles]
    n = np.asarray(lattice.shape)
    near = np.all((corners.min(axis=1) <= n - 0.5) & (corners.max(axis=1) >= 0.5), axis=1)
    return not near.any() and abs(_winding_number(corners - 0.5 * n)) > 0.5


def _winding_number(corners: np.ndarray) -> float:
    """Returns how often triangles [m, 3, 3] wind around the origin (A. Van Oosterom, J. Strackee, 1983)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    x, y, z = (np.linalg.norm(each, axis=1) for each in (a, b, c))
    solid = np.einsum("ni,ni->n", a, np.cross(b, c))
    plane = x * y * z + (a * b).sum(1) * z + (b * c).sum(1) * x + (c * a).sum(1) * y
    return float(np.arctan2(solid, plane).sum() / (2.0 * np.pi))


def dark_receivers(receivers: Iterable[ReceiverPlan], time: float) -> Iterator[str]:
    """Yields a warning for each receiver that bakes to black because of its winding or its normals."""
    for each in receivers:
        if each.lights and faces_away(each.surface, [light.light for light in each.lights], time):
            yield f"{each.surface.path}: it faces away from every light; are its orientation and normals right?"


def faces_away(surface: Surface, lights: Iterable[Light], time: float) -> bool:
    """Returns whether every corner of a surface faces away from every light; False if the surface or a light moves.

    Args:
        surface: its normals point to its front; without normals, the front is the side that sees its triangles
            counter-clockwise.
        lights: the lights that reach it.
        time: time code.
    """
    lights = tuple(lights)
    if is_moving(surface, *lights):
        return False
    mesh, matrix = surface.mesh, surface.transform_at(time)
    points, normals = mesh.points_at(time), mesh.normals_at(time)
    if normals is None:
        normals = corner_normals(points, mesh.triangles)
    corners = transform_points(matrix, points)[mesh.triangles]
    normals = transform_normals(matrix, normals)
    return all(np.all(np.sum(normals * _towards(light, corners, time), axis=-1) <= 0.0) for light in lights)


def _towards(light: Light, points: np.ndarray, time: float) -> np.ndarray:
    """Returns vectors from world points towards a light, not normalized."""
    if isinstance(light, DistantLight):
        return np.broadcast_to(-light.direction_at(time), points.shape)
    return light.position_at(time) - points
