"""Known answers for shadows and shading, and norms of the error against them."""

import numpy as np

from warp_smoke.geometry import normalized


def difference(found: np.ndarray, truth: np.ndarray, whole: float | None = None) -> dict[str, float]:
    """Returns the norms of an error over points that stand for equal areas.

    Args:
        found: what was computed, [n, ...].
        truth: what it should be, of the same shape.
        whole: root mean square that `relative_l2` is relative to; None = that of the truth.
    """
    error = np.abs(np.asarray(found, np.float64) - truth)
    l2 = float(np.sqrt(np.mean(error**2)))
    whole = float(np.sqrt(np.mean(np.square(truth)))) if whole is None else whole
    return {"l1": float(error.mean()), "l2": l2, "linf": float(error.max()), "relative_l2": l2 / whole}


def gaussian_depth(distance: np.ndarray, width: float, extinction: float) -> np.ndarray:
    """Returns the optical depth τ = σ s √(2π) e^(−b²/2s²) on lines at distance b from a Gaussian blob of peak 1."""
    return extinction * width * np.sqrt(2.0 * np.pi) * np.exp(-0.5 * (distance / width) ** 2)


def sphere_depth(distance: np.ndarray, radius: float, extinction: float) -> np.ndarray:
    """Returns the optical depth σ 2 √(R² − b²) on lines that pass the middle of a uniform ball at distance b."""
    return extinction * 2.0 * np.sqrt(np.maximum(radius**2 - distance**2, 0.0))


def spread_gaussian(squares: np.ndarray, variance: float, added: float) -> np.ndarray:
    """Returns a plane Gaussian, initially of peak 1, after diffusion, at squared distances from its middle."""
    wide = variance + added
    return variance / wide * np.exp(-0.5 * squares / wide)


def implicit_step(u: np.ndarray, r: float) -> np.ndarray:
    """Returns (I − r Δ)⁻¹ u on a buffer [w, h] with mirrored edges, Δ the five-point Laplacian, by cosine transform."""
    from scipy import fft

    eigenvalues = [2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in u.shape]
    return fft.idctn(fft.dctn(np.asarray(u, np.float64)) / (1.0 + r * np.add.outer(*eigenvalues)))


def variance(u: np.ndarray) -> float:
    """Returns the variance of a buffer [w, h] along its first axis, about its mean [texels²]."""
    share, x = u.sum(axis=1) / u.sum(), np.arange(len(u))
    return float(share @ x**2 - (share @ x) ** 2)


def sphere_shadow_radius(height: float, distance: float, radius: float) -> float:
    """Returns the radius H R / √(d² − R²) of a ball's shadow on a plane, lit from H above it and d above the ball."""
    return height * radius / float(np.sqrt(distance**2 - radius**2))


def disk_share(cut: np.ndarray) -> np.ndarray:
    """Returns the share of a unit disk that lies beyond a line at a signed distance −1…1 from its middle."""
    cut = np.clip(cut, -1.0, 1.0)
    return (np.arccos(cut) - cut * np.sqrt(1.0 - cut**2)) / np.pi


def wave_heights(x: np.ndarray, y: np.ndarray, amplitude: float) -> np.ndarray:
    """Returns the heights A sin 2πx sin 2πy."""
    return amplitude * np.sin(2.0 * np.pi * x) * np.sin(2.0 * np.pi * y)


def wave_normals(x: np.ndarray, y: np.ndarray, amplitude: float) -> np.ndarray:
    """Returns the unit normals of `wave_heights`, [..., 3]."""
    k = 2.0 * np.pi
    slope_x = amplitude * k * np.cos(k * x) * np.sin(k * y)
    slope_y = amplitude * k * np.sin(k * x) * np.cos(k * y)
    return normalized(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))


def blinn_phong(
    to_light: np.ndarray,
    to_eye: np.ndarray,
    normal: np.ndarray,
    light: np.ndarray,
    diffuse: np.ndarray,
    r0: np.ndarray,
    exponent: float,
) -> np.ndarray:
    """B ⊗ (m_d + (R₀ + (1 − R₀)(1 − h·l)⁵)(m + 8)/8 (n·h)ᵐ) max(l·n, 0) in float64, [n, 3]; vectors [n, 3], unit."""
    h = normalized(to_light + to_eye)
    h_dot_l = np.clip(np.sum(h * to_light, axis=1), 0.0, 1.0)[:, None]
    n_dot_h = np.maximum(np.sum(h * normal, axis=1), 0.0)[:, None]
    n_dot_l = np.maximum(np.sum(normal * to_light, axis=1), 0.0)[:, None]
    fresnel = r0 + (1.0 - r0) * (1.0 - h_dot_l) ** 5
    return light * (diffuse + fresnel * (exponent + 8.0) / 8.0 * n_dot_h**exponent) * n_dot_l


def blinn_phong_albedo(exponent: float) -> float:
    """Returns (m + 8)(m + 2^(−m/2))/((m + 2)(m + 4)), the share of normal light that (m + 8)/8 (n·h)ᵐ reflects."""
    return (exponent + 8.0) * (exponent + 2.0 ** (-exponent / 2.0)) / ((exponent + 2.0) * (exponent + 4.0))


def edge_penumbra(points: np.ndarray, light: np.ndarray, radius: float, height: float) -> np.ndarray:
    """Returns the share of a spherical light that points on y = 0 see past a half plane x < 0 at some height, [n].

    The plane through the point and the edge passes the light's middle at an angle φ, and the light is seen as a disk
    of angular radius α: the cut is at tan φ / tan α of the disk's radius.

    Args:
        points: [n, 3], y = 0.
        light: its middle, with x = 0, [3].
        radius: of the light.
        height: of the half plane.
    """
    x = points[:, 0]
    normal = np.stack([np.full_like(x, height), x, np.zeros_like(x)], axis=1)
    toward = light - points
    distance = np.linalg.norm(toward, axis=1)
    sine = np.sum(normal * toward, axis=1) / (np.linalg.norm(normal, axis=1) * distance)
    return disk_share(-np.tan(np.arcsin(sine)) / np.tan(np.arcsin(radius / distance)))
