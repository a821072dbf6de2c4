"""Triangle meshes as the passes need them, and simple solids (USD's gprims) as triangle meshes."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from warp_smoke.record import FieldError, Record, Samples, each_value, read_only, value_at

# A chord of a 64-gon stays within 0.12 % of its circle.
SEGMENTS = 64


@dataclass(frozen=True, eq=False)
class Mesh(Record):
    """A triangle mesh in its own (local) space, front faces counter-clockwise.

    Attributes:
        points: [n, 3] float32 in stage units; Samples [t, n, 3] if the points move (the triangles stay the same).
        triangles: indices into points, [m, 3] int32.
        normals: unit normal at each corner, [m, 3, 3] float32; Samples [t, m, 3, 3] if they turn; None for the
            triangles' own normals.
        uvs: texture coordinates at each corner, [m, 3, 2] float32, v up, or None.
        faces: index of the polygon that each triangle was cut from, [m] int32; None if each triangle is a polygon;
            ignored by comparisons.
    """

    points: np.ndarray | Samples
    triangles: np.ndarray
    normals: np.ndarray | Samples | None = None
    uvs: np.ndarray | None = None
    faces: np.ndarray | None = field(default=None, compare=False)

    def __post_init__(self):
        points = self.points
        if isinstance(points, Samples):
            self._store("points", Samples(points.times, read_only(points.values, np.float32)))
        else:
            self._store("points", read_only(points, np.float32))
        self._store("triangles", read_only(self.triangles, np.int32).reshape(-1, 3))
        every = each_value(self.points)
        if every.ndim != 3 or every.shape[2] != 3:
            raise FieldError("mesh", "points", f"shape {every.shape[1:]}", "[n, 3]")
        if not np.all(np.isfinite(every)):
            index = np.argwhere(~np.isfinite(every))[0, 1]
            raise FieldError("mesh", "points", f"{every[:, index][0]} at index {index}", "finite numbers")
        count = every.shape[1]
        if self.triangles.size and not 0 <= self.triangles.min() <= self.triangles.max() < count:
            raise FieldError("mesh", "triangles", f"{self.triangles.min()}…{self.triangles.max()}", f"0…{count - 1}")
        for name, width in (("normals", 3), ("uvs", 2)):
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, Samples):
                self._store(name, Samples(value.times, read_only(value.values, np.float32)))
            else:
                self._store(name, read_only(value, np.float32))
            allowed, shape = (len(self.triangles), 3, width), each_value(getattr(self, name)).shape[1:]
            if shape != allowed:
                raise FieldError("mesh", name, f"shape {shape}", str(list(allowed)))

    def points_at(self, time: float) -> np.ndarray:
        """Returns the local points at a time code, [n, 3] float32."""
        return value_at(self.points, time)

    def normals_at(self, time: float) -> np.ndarray | None:
        """Returns the unit normals at the triangles' corners at a time code, [m, 3, 3] float32, or None."""
        normals = value_at(self.normals, time)
        return normalized(normals).astype(np.float32) if isinstance(self.normals, Samples) else normals

    def part(self, triangles: np.ndarray) -> "Mesh":
        """Returns a mesh of the triangles with these indices [k] and all points."""

        def some(corners: np.ndarray | Samples | None) -> np.ndarray | Samples | None:
            if isinstance(corners, Samples):
                return Samples(corners.times, corners.values[:, triangles])
            return None if corners is None else corners[triangles]

        kept = {name: some(getattr(self, name)) for name in ("triangles", "normals", "uvs", "faces")}
        return replace(self, **kept)

    @property
    def deforms(self) -> bool:
        """Whether the points or the normals move."""
        changing = (value for value in (self.points, self.normals) if isinstance(value, Samples))
        return any(np.ptp(value.values, axis=0).any() for value in changing)

    @cached_property
    def welded(self) -> np.ndarray:
        """The triangles with coincident points merged (those that coincide at all times), [m, 3]."""
        every = each_value(self.points)
        tracks = np.moveaxis(every, 1, 0).reshape(every.shape[1], every.shape[0] * 3)
        _, point = np.unique(tracks, axis=0, return_inverse=True)
        return point.ravel()[self.triangles]

    @cached_property
    def is_smooth(self) -> bool:
        """Whether the normals at a triangle's corners ever differ by more than rounding."""
        if self.normals is None:
            return False
        return any(np.any(np.abs(np.diff(each, axis=1)) > 1e-5) for each in each_value(self.normals))

    @cached_property
    def is_closed(self) -> bool:
        """Whether the triangles use every edge equally often in both directions, so that nothing leaks."""
        edges = self.welded[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        _, edge = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
        return not np.bincount(edge.ravel(), weights=np.sign(edges[:, 1] - edges[:, 0])).any()

    @classmethod
    def box(cls, size=(2.0, 2.0, 2.0), lower=None) -> "Mesh":
        """Returns a box centred on the origin, with UVs that cover [0, 1]² on each side.

        Args:
            size: length of all sides, or of those along x, y and z, [3] [stage units].
            lower: its lowest corner, [3]; None centres the box on the origin.
        """
        size = np.broadcast_to(np.asarray(size, np.float64), (3,))
        lower = -size / 2 if lower is None else np.asarray(lower, np.float64)
        corners, normals = [], []
        for axis in range(3):
            s, t = (axis + 1) % 3, (axis + 2) % 3
            for side in (0.0, 1.0):
                quad = np.zeros((4, 3))
                quad[:, axis] = side
                quad[:, s] = (0, 1, 1, 0) if side else (1, 0, 0, 1)
                quad[:, t] = (0, 0, 1, 1)
                corners.append(lower + quad * size)
                normal = np.zeros(3)
                normal[axis] = 2.0 * side - 1.0
                normals.append(normal)
        points = np.concatenate(corners)
        triangles = np.concatenate([[[k, k + 1, k + 2], [k, k + 2, k + 3]] for k in range(0, 24, 4)])
        quad_uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        return cls(
            points,
            triangles,
            np.repeat(normals, 6, axis=0).reshape(-1, 3, 3),
            np.tile(quad_uvs[[0, 1, 2, 0, 2, 3]], (6, 1)).reshape(-1, 3, 2),
        )

    @classmethod
    def grid(cls, corner, u_edge, v_edge, divisions: int = 1) -> "Mesh":
        """Returns a flat patch corner + u·u_edge + v·v_edge, u and v in [0, 1], facing u_edge × v_edge.

        Args:
            corner: where u = v = 0, [3] [stage units].
            u_edge: side along which u grows, [3].
            v_edge: side along which v grows, [3].
            divisions: quads along each side, of two triangles each.
        """
        steps = np.linspace(0.0, 1.0, divisions + 1)
        u, v = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
        corner, u_edge, v_edge = (np.asarray(a, np.float64) for a in (corner, u_edge, v_edge))
        points = corner + u[:, None] * u_edge + v[:, None] * v_edge
        i, j = (a.ravel() for a in np.meshgrid(range(divisions), range(divisions), indexing="ij"))
        a = i * (divisions + 1) + j
        b = a + divisions + 1
        triangles = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=1).reshape(-1, 3)
        normal = np.cross(u_edge, v_edge)
        normals = np.broadcast_to(normal / np.linalg.norm(normal), (len(triangles), 3, 3))
        return cls(points, triangles, normals, np.stack([u, v], axis=1)[triangles])

    @classmethod
    def sphere(cls, radius: float = 1.0, segments: int = SEGMENTS) -> "Mesh":
        """Returns a sphere around the origin with this radius [stage units] and number of segments around Z."""
        angle = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
        return cls.revolved(radius * np.cos(angle), radius * np.sin(angle), segments=segments, smooth=True)

    @classmethod
    def cylinder(cls, radius: float = 1.0, height: float = 2.0, axis: str = "Z", segments: int = SEGMENTS) -> "Mesh":
        """Returns a closed cylinder centred on the origin along X, Y or Z; radius and height in stage units."""
        return cls.revolved([0, radius, radius, 0], np.array([-1, -1, 1, 1]) * height / 2, axis, segments)

    @classmethod
    def cone(cls, radius: float = 1.0, height: float = 2.0, axis: str = "Z", segments: int = SEGMENTS) -> "Mesh":
        """Returns a closed cone along X, Y or Z, from −height/2 to its apex at height/2 [stage units]."""
        return cls.revolved([0, radius, 0], np.array([-1, -1, 1]) * height / 2, axis, segments)

    @classmethod
    def capsule(cls, radius: float = 0.5, height: float = 1.0, axis: str = "Z", segments: int = SEGMENTS) -> "Mesh":
        """Returns a cylinder of this height [stage units] along X, Y or Z with a hemisphere added at each end."""
        angle = np.linspace(-np.pi / 2, 0, segments // 4 + 1)
        r, z = radius * np.cos(angle), radius * np.sin(angle) - height / 2
        return cls.revolved(np.concatenate([r, r[::-1]]), np.concatenate([z, -z[::-1]]), axis, segments, smooth=True)

    @classmethod
    def revolved(cls, r, z, axis: str = "Z", segments: int = SEGMENTS, smooth: bool = False) -> "Mesh":
        """Returns a surface of revolution, closed if its outline starts and ends on the axis.

        Args:
            r: distances of the outline's points from the axis, from bottom to top, [n] [stage units].
            z: heights of the outline's points along the axis, [n] [stage units].
            axis: X, Y or Z.
            segments: number of segments around the axis.
            smooth: whether normals are smooth along the outline too, and not only around the axis.
        """
        r, z = np.asarray(r, np.float64), np.asarray(z, np.float64)
        # r is exactly 0 at closed ends, so that their triangles collapse to points that can be left out.
        r = np.where(np.abs(r) < 1e-12 * np.abs(r).max(), 0.0, r)
        turn = 2 * np.pi * np.arange(segments) / segments
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        points = np.concatenate(
            [r[:, None, None] * ring, np.broadcast_to(z[:, None, None], (len(r), segments, 1))], axis=2
        ).reshape(-1, 3)
        level, k = (a.ravel() for a in np.meshgrid(range(len(r) - 1), range(segments), indexing="ij"))
        right = (k + 1) % segments
        a, b = level * segments + k, level * segments + right
        c, d = b + segments, a + segments
        triangles = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
        u = np.stack([k, k + 1, k + 1, k, k + 1, k], axis=1).reshape(-1, 3) / segments
        length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))])
        uvs = np.stack([u, (length / length[-1])[triangles // segments]], axis=2)

        slope = np.stack([np.diff(z), -np.diff(r)], axis=1)  # outward (r, z) normal of each band
        slope /= np.linalg.norm(slope, axis=1, keepdims=True)
        if smooth:
            # One more band at each end, mirrored, so that the poles' normals lie on the axis.
            first, last = (slope[e] * (-1 if r[e] == 0 else 1, 1) for e in (0, -1))
            padded = np.concatenate([[first], slope, [last]])
            outline = padded[:-1] + padded[1:]
            outline /= np.linalg.norm(outline, axis=1, keepdims=True)
            corner = outline[triangles // segments]
        else:
            corner = np.repeat(slope[level], 2, axis=0)[:, None, :].repeat(3, axis=1)
        direction = 2 * np.pi * u
        normals = np.stack(
            [corner[..., 0] * np.cos(direction), corner[..., 0] * np.sin(direction), corner[..., 1]], axis=2
        )

        keep = np.ones(len(triangles), bool)
        for corners in ((0, 1), (1, 2), (2, 0)):
            p, q = (points[triangles[:, n]] for n in corners)
            keep &= np.any(p != q, axis=1)
        turned = {"Z": (0, 1, 2), "X": (2, 0, 1), "Y": (1, 2, 0)}[axis]
        return cls(points[:, turned], triangles[keep], normals[keep][..., turned], uvs[keep])


@dataclass(frozen=True, eq=False)
class Points(Record):
    """Small spheres in their own (local) space.

    Attributes:
        points: centres, [n, 3] float32 in stage units; Samples [t, n, 3] if they move.
        widths: diameters, [n] float32 in stage units, at least 0; Samples [t, n] if they change.
    """

    points: np.ndarray | Samples
    widths: np.ndarray | Samples

    def __post_init__(self):
        for name in ("points", "widths"):
            value = getattr(self, name)
            if isinstance(value, Samples):
                self._store(name, Samples(value.times, read_only(value.values, np.float32)))
            else:
                self._store(name, read_only(value, np.float32))
        points, widths = each_value(self.points), each_value(self.widths)
        if points.ndim != 3 or points.shape[2] != 3 or not np.all(np.isfinite(points)):
            raise FieldError("points", "points", f"shape {points.shape[1:]}", "[n, 3] finite numbers")
        if widths.shape[1:] != points.shape[1:2] or not np.all(np.isfinite(widths) & (widths >= 0.0)):
            allowed = f"[{points.shape[1]}] finite numbers, one per point, at least 0"
            found = f"of shape {widths.shape[1:]} with a least value of {widths.min(initial=0.0)}"
            raise FieldError("points", "widths", found, allowed)

    def points_at(self, time: float) -> np.ndarray:
        """Returns the local centres at a time code, [n, 3] float32."""
        return value_at(self.points, time)

    def widths_at(self, time: float) -> np.ndarray:
        """Returns the local diameters at a time code, [n] float32."""
        return value_at(self.widths, time)

    @property
    def deforms(self) -> bool:
        """Whether the spheres move or change size."""
        changing = [each for each in (self.points, self.widths) if isinstance(each, Samples)]
        return any(np.ptp(each.values, axis=0).any() for each in changing)


def corner_normals(points: np.ndarray, triangles: np.ndarray, smooth: bool = False) -> np.ndarray:
    """Returns unit normals at each corner, [m, 3, 3] float64; zero for triangles without area.

    Args:
        points: [n, 3].
        triangles: [m, 3].
        smooth: whether to use the area-weighted mean of the faces around each point instead of the face normal.
    """
    p = np.asarray(points, np.float64)[triangles]
    face = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    if not smooth:
        return normalized(np.repeat(face[:, None], 3, axis=1))
    total = np.zeros((len(points), 3))
    for corner in range(3):
        np.add.at(total, triangles[:, corner], face)
    return normalized(total)[triangles]


def normalized(vectors: np.ndarray) -> np.ndarray:
    """Normalizes vectors along the last axis; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def transform_points(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Transforms points [..., 3] by a 4 × 4 matrix in USD's row-vector convention (p' = p M), in float64."""
    matrix = np.asarray(matrix, np.float64)
    return np.asarray(points, np.float64) @ matrix[:3, :3] + matrix[3, :3]


def transform_normals(matrix: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Transforms unit normals [..., 3] by the inverse transpose of a 4 × 4 row-vector matrix, in float64.

    Normals stay on the outside under a mirroring matrix; see `winding_flips` for the triangles' order. A matrix that
    flattens has no inverse, but its cofactors (the inverse transpose times the determinant) give the plane's normal.
    """
    x, y, z = np.asarray(matrix, np.float64)[:3, :3]
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])
    return normalized(np.asarray(normals, np.float64) @ (-cofactors if winding_flips(matrix) else cofactors))


def winding_flips(matrix: np.ndarray) -> bool:
    """Returns whether a transform mirrors, which turns counter-clockwise triangles clockwise."""
    return bool(np.linalg.det(np.asarray(matrix, np.float64)[:3, :3]) < 0)
