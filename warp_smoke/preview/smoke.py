"""Smoke as coloured voxels: its density, and the light that reaches each voxel through the rest of the smoke.

Volume files may hold the light that the smoke scatters (grid `light`); the voxels then show that. Without it they show
an approximation for the eye, not the simulation's shadows: every light shines in parallel rays, in its direction from
the smoke's centre, nothing but the smoke itself shadows the smoke, and multiple scattering is approximated after
M. Wrenninge, C. Kulla, V. Lundqvist, *Oz: The Great and Volumetric*, SIGGRAPH Talks 2013, by the sum
Σ bⁿ e^(−aⁿ τ), in which each further bounce is weaker (b) and less attenuated by the smoke (a).
"""

from dataclasses import dataclass

import numpy as np

from warp_smoke.lattice import occupied_box
from warp_smoke.preview.color import encode_light

# The share of the light on thick smoke that is reflected: a cloud is less white than a white wall.
REFLECTANCE = 0.7
BOUNCES = 3
LESS_HINDERED, WEAKER = 0.5, 0.5  # a and b


@dataclass(frozen=True)
class Beam:
    """Parallel light.

    Attributes:
        direction: world direction in which it travels, [3]; any length but zero.
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
        brightest: sRGB value that the greatest colour code stands for: 1 (white) or more.
    """

    rgba: np.ndarray
    to_world: np.ndarray
    extinction: float
    brightest: float = 1.0


def find_smoke(
    density: np.ndarray, to_world: np.ndarray, scattered: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None] | None:
    """Finds the box of voxels that hold smoke, with a layer of empty voxels around it, so that its edge is soft.

    Args:
        density: [nx, ny, nz] float32; values below zero or below 1/510 of the greatest count as none.
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
    """Makes voxels of smoke whose scattered light is known.

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
    """Makes voxels of smoke, with an approximation of the light that it scatters.

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
    """Returns the light [nx, ny, nz, 3], with black voxels set to the mean of the lit ones among their 26 neighbours.

    Colours are interpolated between voxels regardless of their densities: otherwise smoke would have a dark rim.
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
    """Computes the optical depth that parallel light passes through on its way to each voxel's centre.

    Slice by slice along the direction's longest axis: τ(x) = τ(x − s) + σ |s| (ρ(x − s) + ρ(x)) / 2, with s one slice
    along the ray and bilinear reads in the slice before; there is no smoke outside the voxels.

    Args:
        density: [nx, ny, nz] float32.
        depth_per_side: optical depth at density 1 along each of a voxel's sides, [3].
        direction: direction in which the light travels, in voxels, [3].

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
    """Returns plane(x − shift), bilinear, zero outside; each |shift| ≤ 1."""
    for axis, distance in enumerate(shift):
        here, there = (slice(1, None), slice(None, -1)) if distance > 0 else (slice(None, -1), slice(1, None))
        weight = np.float32(abs(distance))
        moved = (1 - weight) * plane
        np.moveaxis(moved, axis, 0)[here] += weight * np.moveaxis(plane, axis, 0)[there]
        plane = moved
    return plane
