"""Known answers that the study and the tests compare with: advected shapes and flows."""

import numpy as np

# U. Ghia, K. N. Ghia, C. T. Shin, *High-Re Solutions for Incompressible Flow Using the Navier–Stokes Equations and a
# Multigrid Method*, 1982, Tables I and II: a unit cavity under a lid that moves along +x with speed 1. First u along
# the vertical line x = ½, then v along the horizontal line y = ½. v at x = 0.9063 for Re = 400 is left out: it does
# not fit its neighbours.
GHIA_Y = (
    0.0547, 0.0625, 0.0703, 0.1016, 0.1719, 0.2813, 0.4531, 0.5, 0.6172, 0.7344, 0.8516, 0.9531, 0.9609, 0.9688,
    0.9766,
)  # fmt: skip
GHIA_X = (
    0.0625, 0.0703, 0.0781, 0.0938, 0.1563, 0.2266, 0.2344, 0.5, 0.8047, 0.8594, 0.9063, 0.9453, 0.9531, 0.9609,
    0.9688,
)  # fmt: skip
GHIA_U = {
    100: (
        -0.03717, -0.04192, -0.04775, -0.06434, -0.1015, -0.15662, -0.2109, -0.20581, -0.13641, 0.00332, 0.23151,
        0.68717, 0.73722, 0.78871, 0.84123,
    ),
    400: (
        -0.08186, -0.09266, -0.10338, -0.14612, -0.24299, -0.32726, -0.17119, -0.11477, 0.02135, 0.16256, 0.29093,
        0.55892, 0.61756, 0.68439, 0.75837,
    ),
    1000: (
        -0.18109, -0.20196, -0.2222, -0.2973, -0.38289, -0.27805, -0.10648, -0.0608, 0.05702, 0.18719, 0.33304,
        0.46604, 0.51117, 0.57492, 0.65928,
    ),
}  # fmt: skip
GHIA_V = {
    100: (
        0.09233, 0.10091, 0.1089, 0.12317, 0.16077, 0.17507, 0.17527, 0.05454, -0.24533, -0.22445, -0.16914, -0.10313,
        -0.08864, -0.07391, -0.05906,
    ),
    400: (
        0.1836, 0.19713, 0.2092, 0.22965, 0.28124, 0.30203, 0.30174, 0.05186, -0.38598, -0.44993, np.nan, -0.22847,
        -0.19254, -0.15663, -0.12146,
    ),
    1000: (
        0.27485, 0.29012, 0.30353, 0.32627, 0.37095, 0.33075, 0.32235, 0.02526, -0.31966, -0.42665, -0.5155, -0.39188,
        -0.33714, -0.27669, -0.21388,
    ),
}  # fmt: skip


def taylor_green(x: np.ndarray, y: np.ndarray, viscosity: float, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns the velocity (u, v) of a vortex in a unit square with free-slip sides, an exact Navier–Stokes solution.

    G. I. Taylor, A. E. Green, *Mechanism of the Production of Small Eddies from Large Ones*, 1937.
    """
    decay = np.exp(-2.0 * viscosity * np.pi**2 * time)
    return decay * np.sin(np.pi * x) * np.cos(np.pi * y), -decay * np.cos(np.pi * x) * np.sin(np.pi * y)


def cosine_hill(distance: np.ndarray, radius: float) -> np.ndarray:
    """Returns ½ (1 + cos πr/r₀) within the radius r₀ of its top, 0 elsewhere; its slope is continuous."""
    return np.where(distance < radius, 0.5 + 0.5 * np.cos(np.pi * distance / radius), 0.0)


def deformation(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns a velocity that tears the unit cube's smoke into sheets; times cos πt/T, it undoes that by time T.

    R. J. LeVeque, *High-Resolution Conservative Algorithms for Advection in Incompressible Flow*, 1996, section 9.
    """
    x, y, z = (np.pi * each for each in (x, y, z))
    return (
        2.0 * np.sin(x) ** 2 * np.sin(2 * y) * np.sin(2 * z),
        -np.sin(2 * x) * np.sin(y) ** 2 * np.sin(2 * z),
        -np.sin(2 * x) * np.sin(2 * y) * np.sin(z) ** 2,
    )
