"""Smoke as coloured voxels: its density, and the light that reaches each voxel through the rest of the smoke.

Volume files may hold the light that the smoke scatters (grid `light`), which is then what the voxels show. Without it,
an approximation for the eye, not the simulation's own shadows: every light shines in parallel rays from where it
stands as seen from the smoke's centre, nothing but the smoke itself shades the smoke, and light scattered many times
is stood in for by M. Wrenninge, C. Kulla, V. Lundqvist, *Oz: The Great and Volumetric*, SIGGRAPH Talks 2013: the sum
Σ bⁿ e^(−aⁿ τ), in which each further bounce is weaker (b) and less hindered by the smoke (a).
"""

from dataclasses import dataclass

import numpy as np

from warp_smoke.lattice import occupied_box
from warp_smoke.preview.color import encode_light

# Of the light that falls on thick smoke, what comes back: a cloud is less white than a white wall.
REFLECTANCE = 0.7
BOUNCES = 3
LESS_HINDERED, WEAKER = 0.5, 0.5  # a and b


@dataclass(frozen=True)
class Beam:
    """Parallel light.

    Attributes:
        direction: in which it travels in the world, [3]; any length but zero.
        radiance: linear RGB of a white matte surface that faces it, [3].
    """

    direction: np.ndarray
    radiance: np.ndarray


@dataclass(frozen=True)
class SmokeVoxels:
    """Smoke ready to be drawn.

    Attributes:
        rgba: [nx, ny, nz, 4] uint16 at the voxels' centres: sRGB colour as a share of `brightest`, and density as a
            share of its maximum.
        to_world: index (i, j, k) of a voxel to the world position of its centre, 4 × 4 row-vector matrix.
        extinction: where the density is greatest [1/stage unit].
        brightest: sRGB value that the greatest code of a colour stands for: white, 1, or beyond it.
    """

    rgba: np.ndarray
    to_world: np.ndarray
    extinction: float
    brightest: float = 1.0


def find_smoke(
    density: np.ndarray, to_world: np.ndarray, scattered: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None] | None:
    """The box of voxels that hold smoke, within a layer of voxels that hold none, so that its edge is soft.

    Args:
        density: [nx, ny, nz] float32; what is below zero is none, and so is what is less than 1/510 of the greatest.
        to_world: index (i, j, k) of a voxel to the world position of its centre, 4 × 4 row-vector matrix.
        scattered: light, linear RGB, [nx, ny, nz, 3], or None.

    Returns:
        Density, `to_world` and `scattered` of the box, or None if there is no smoke.
    """
    greatest = density.max(initial=0)
    box = occupied_box(density > greatest / (2 * 255))
    if box is None:
        return None
    corner = np.eye(4)
    corner[3, :3] = [each.start - 1 for each in box]
    if scattered is not None:
        scattered = np.pad(scattered[box], ((1, 1), (1, 1), (1, 1), (0, 0)))
    return np.pad(np.maximum(density[box], 0), 1), corner @ to_world, scattered


def show_light(density: np.ndarray, to_world: np.ndarray, extinction: float, scattered: np.ndarray) -> SmokeVoxels:
    """Smoke that scatters light which is known.

    Args:
        density: [nx, ny, nz] float32, at least one above zero.
        to_world: index (i, j, k) of a voxel to the world position of its centre, 4 × 4 row-vector matrix.
        extinction: at density 1 [1/stage unit].
        scattered: the light, linear RGB, [nx, ny, nz, 3]; black where there is no smoke.
    """
    return _voxels(density, to_world, extinction, _spread(np.asarray(scattered, np.float32)))


def color_smoke(
    density: np.ndarray, to_world: np.ndarray, extinction: float, beams: list[Beam], ambient: np.ndarray
) -> SmokeVoxels:
    """Lights smoke.

    Args:
        density: [nx, ny, nz] float32, at least one above zero.
        to_world: index (i, j, k) of a voxel to the world position of its centre, 4 × 4 row-vector matrix.
        extinction: at density 1 [1/stage unit].
        beams: lights on the smoke.
        ambient: light from everywhere, linear RGB [3].
    """
    axes = to_world[:3, :3]
    to_voxels = np.linalg.inv(axes)
    depth_per_side = extinction * np.linalg.norm(axes, axis=1)
    radiance = np.empty((*density.shape, 3), np.float32)
    radiance[:] = ambient
    shares = WEAKER ** np.arange(BOUNCES)
    shares /= shares.sum()
    for beam in beams:
        depth = optical_depth(density, depth_per_side, beam.direction @ to_voxels)
        lit = sum(np.float32(share) * np.exp(np.float32(-(LESS_HINDERED**n)) * depth) for n, share in enumerate(shares))
        radiance += lit[..., None] * np.asarray(beam.radiance, np.float32)
    return _voxels(density, to_world, extinction, REFLECTANCE * radiance)


def _voxels(density: np.ndarray, to_world: np.ndarray, extinction: float, radiance: np.ndarray) -> SmokeVoxels:
    rgba = np.empty((*density.shape, 4), np.uint16)
    rgba[..., :3], brightest = encode_light(radiance)
    greatest = density.max()
    rgba[..., 3] = np.rint(density * (65535 / greatest))
    return SmokeVoxels(rgba, to_world, extinction * float(greatest), brightest)


def _spread(light: np.ndarray) -> np.ndarray:
    """The light [nx, ny, nz, 3], and in black voxels the mean of the others among their 26 neighbours.

    Colours between voxels are interpolated regardless of their densities: smoke would have a dark rim.
    """
    lit = light.any(axis=3)
    sums = np.concatenate([light, lit[..., None].astype(np.float32)], axis=3)
    for axis in range(3):
        before = np.moveaxis(sums, axis, 0)
        sums = before.copy()
        sums[1:] += before[:-1]
        sums[:-1] += before[1:]
        sums = np.moveaxis(sums, 0, axis)
    return np.where(lit[..., None], light, sums[..., :3] / np.maximum(sums[..., 3:], 1.0))


def optical_depth(density: np.ndarray, depth_per_side: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Smoke passed by parallel light on its way to each voxel's centre, as optical depth.

    Slice by slice along the direction's longest axis: τ(x) = τ(x − s) + σ |s| (ρ(x − s) + ρ(x)) / 2, with s one slice
    along the ray and bilinear reads in the slice before; there is no smoke outside the voxels.

    Args:
        density: [nx, ny, nz] float32.
        depth_per_side: optical depth at density 1 along each of a voxel's sides, [3].
        direction: in which the light travels, in voxels, [3].

    Returns:
        [nx, ny, nz] float32.
    """
    axis = int(np.argmax(np.abs(direction)))
    step = np.asarray(direction, np.float64) / abs(direction[axis])
    shift = np.delete(step, axis)
    depth = np.empty_like(density)
    slices, depths = np.moveaxis(density, axis, 0), np.moveaxis(depth, axis, 0)
    if step[axis] < 0:
        slices, depths = slices[::-1], depths[::-1]
    half = np.float32(0.5 * np.linalg.norm(step * depth_per_side))
    before = np.zeros_like(slices[0])
    for n, smoke in enumerate(slices):
        here = half * smoke
        depths[n] = before + here
        before = _shifted(depths[n] + here, shift)
    return depth


def _shifted(plane: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """plane(x − shift), bilinear, zero outside; each |shift| ≤ 1."""
    for axis, distance in enumerate(shift):
        here, there = (slice(1, None), slice(None, -1)) if distance > 0 else (slice(None, -1), slice(1, None))
        weight = np.float32(abs(distance))
        moved = (1 - weight) * plane
        np.moveaxis(moved, axis, 0)[here] += weight * np.moveaxis(plane, axis, 0)[there]
        plane = moved
    return plane
