"""Modes of the Laplacian along the axes of a lattice: discrete cosine and sine transforms.

Along an axis the samples of a field lie half a cell inside its ends (cells) or on them (faces across the axis), and at
each end the field is extended evenly (its slope is 0 there) or oddly (its value is 0 there). The second difference
a_(m−1) − 2 a_m + a_(m+1) then has the eigenvalues −λ, λ_m = 2 − 2 cos(π s / n) for n cells, and its eigenvectors form a
discrete cosine or sine transform (G. Strang, *The Discrete Cosine Transform*, 1999):

    ends        cells   s       faces    s
    even, even  DCT-II  m       DCT-I    m
    odd, odd    DST-II  m + 1   DST-I    m + 1
    even, odd   DCT-IV  m + ½   DCT-III  m + ½
    odd, even   DST-IV  m + ½   DST-III  m + ½

Faces on odd ends are 0 and have no mode. Along a periodic axis the modes are those of the Hartley transform (R. V. L.
Hartley, 1942), Σ a_l (cos + sin)(2π l m / n), with s = 2 m; the last face is the first one, and has no mode of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.fft
import warp as wp

from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})

EVEN, ODD, PERIODIC = "even", "odd", "periodic"


def _hartley(a: np.ndarray, axis: int, overwrite_x: bool = False, workers: int | None = None) -> np.ndarray:
    """Computes the orthonormal Hartley transform of real numbers along an axis, which is its own inverse."""
    spectrum = np.moveaxis(scipy.fft.rfft(a, axis=axis, norm="ortho", workers=workers), axis, 0)
    result = a if overwrite_x else np.empty_like(a)
    modes, n = np.moveaxis(result, axis, 0), a.shape[axis]
    np.subtract(spectrum.real, spectrum.imag, out=modes[: n // 2 + 1])
    np.add(spectrum.real[1 : (n + 1) // 2], spectrum.imag[1 : (n + 1) // 2], out=modes[: n // 2 : -1])
    return result


_CELLS = {
    (EVEN, EVEN): (scipy.fft.dct, scipy.fft.idct, 2, 0.0),
    (ODD, ODD): (scipy.fft.dst, scipy.fft.idst, 2, 1.0),
    (EVEN, ODD): (scipy.fft.dct, scipy.fft.idct, 4, 0.5),
    (ODD, EVEN): (scipy.fft.dst, scipy.fft.idst, 4, 0.5),
}
_FACES = {
    (EVEN, EVEN): (scipy.fft.dct, scipy.fft.idct, 1, 0.0),
    (ODD, ODD): (scipy.fft.dst, scipy.fft.idst, 1, 1.0),
    (EVEN, ODD): (scipy.fft.dct, scipy.fft.idct, 3, 0.5),
    (ODD, EVEN): (scipy.fft.dst, scipy.fft.idst, 3, 0.5),
}


@wp.kernel
def _transform(rows: Rows, matrix: wp.array2d[float], unit: wp.vec3i, a: wp.array3d[float], a_out: wp.array3d[float]):
    """a_out(x) = Σ_l matrix_ml a(x + (l − m) unit), m the index of sample x along the axis of `unit`."""
    i, j, c = wp.tid()
    i += rows.first
    ny = a.shape[1]
    nz = a.shape[2]
    flat = wp.array(ptr=a.ptr, shape=(a.shape[0] * ny * nz,), dtype=float)
    stride = (unit[0] * ny + unit[1]) * nz + unit[2]
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, nz)
    while k < end:
        m = i * unit[0] + j * unit[1] + k * unit[2]
        first = (i * ny + j) * nz + k - m * stride
        total = wp.float32(0.0)
        for other in range(matrix.shape[1]):
            total += matrix[m, other] * flat[first + other * stride]
        a_out[i, j, k] = total
        k += 1


_UNITS = (wp.vec3i(1, 0, 0), wp.vec3i(0, 1, 0), wp.vec3i(0, 0, 1))


@dataclass(frozen=True)
class Modes:
    """The modes of one axis.

    Attributes:
        first, stop: the samples that have modes; the others are 0.
        forward, inverse: transforms from samples to modes and back, called like those of scipy.fft without type.
        eigenvalues: λ of each mode, [samples] float64; 0 for samples without a mode.
    """

    first: int
    stop: int
    forward: Callable
    inverse: Callable
    eigenvalues: np.ndarray

    def matrix(self, transform: Callable) -> np.ndarray:
        """Returns a transform as a matrix over all samples, [samples, samples] float64."""
        matrix = np.zeros((len(self.eigenvalues),) * 2)
        inner = slice(self.first, self.stop)
        matrix[inner, inner] = transform(np.eye(self.stop - self.first), axis=0)
        return matrix


def cell_modes(n: int, lower: str, upper: str) -> Modes:
    """Returns the orthonormal modes of the n cells along an axis with two ends, each even or odd, or both periodic."""
    if lower == PERIODIC:
        return Modes(0, n, _hartley, _hartley, 2.0 - 2.0 * np.cos(2.0 * np.pi * np.arange(n) / n))
    forward, inverse, kind, shift = _CELLS[lower, upper]
    eigenvalues = 2.0 - 2.0 * np.cos(np.pi * (np.arange(n) + shift) / n)
    return Modes(0, n, *(partial(each, type=kind, norm="ortho") for each in (forward, inverse)), eigenvalues)


def face_modes(n: int, lower: str, upper: str) -> Modes:
    """Returns the modes of the n + 1 faces across an axis of n cells; ends are each even or odd, or both periodic."""
    if lower == PERIODIC:
        cells = cell_modes(n, lower, upper)
        return Modes(0, n, _hartley, _hartley, np.append(cells.eigenvalues, 0.0))
    forward, inverse, kind, shift = _FACES[lower, upper]
    first, stop = int(lower == ODD), n + int(upper == EVEN)
    eigenvalues = np.zeros(n + 1)
    eigenvalues[first:stop] = 2.0 - 2.0 * np.cos(np.pi * (np.arange(stop - first) + shift) / n)
    # Not orthonormal: that would change the weight of samples on the ends.
    return Modes(first, stop, *(partial(each, type=kind) for each in (forward, inverse)), eigenvalues)


class FastTransforms:
    """Transforms to modes along some axes and back in O(n log n), by scipy.fft on the CPU."""

    def __init__(self, launcher: Launcher, modes: dict[int, Modes]):
        """Prepares.

        Args:
            launcher: gives the number of threads.
            modes: modes by axis, in the order of the forward transforms.
        """
        self._threads = launcher.threads
        self._inner = tuple(slice(modes[a].first, modes[a].stop) if a in modes else slice(None) for a in range(3))
        # One sample has one mode: itself.
        self._axes = [(axis, each) for axis, each in modes.items() if each.stop - each.first > 1]

    def forward(self, a: wp.array, modes: wp.array) -> None:
        """Writes the modes of `a`; both may be the same array."""
        if a.ptr != modes.ptr:
            wp.copy(modes, a)
        self._apply(modes, [(axis, each.forward) for axis, each in self._axes])

    def inverse(self, modes: wp.array) -> None:
        """Replaces modes by the field that they make up."""
        self._apply(modes, [(axis, each.inverse) for axis, each in reversed(self._axes)])

    def _apply(self, array: wp.array, steps: list) -> None:
        values = result = array.numpy()[self._inner]  # shares the array's memory
        for axis, transform in steps:
            result = transform(result, axis=axis, overwrite_x=True, workers=self._threads)
        if not np.may_share_memory(result, values):  # scipy may, but need not, work in place
            values[...] = result


class MatrixTransforms:
    """Transforms to modes along some axes and back by matrices of eigenvectors, on any device."""

    def __init__(self, launcher: Launcher, modes: dict[int, Modes], shape: tuple[int, int, int], label: str):
        """Prepares.

        Args:
            launcher: where it runs.
            modes: modes by axis, in the order of the forward transforms.
            shape: shape of the field.
            label: label under which memory is counted.
        """
        self._launcher, self._shape = launcher, shape
        self._forward = [(axis, self._upload(each.matrix(each.forward), label)) for axis, each in modes.items()]
        self._inverse = [(axis, self._upload(each.matrix(each.inverse), label)) for axis, each in modes.items()][::-1]
        self._scratch = launcher.zeros(shape, label)

    def _upload(self, matrix: np.ndarray, label: str) -> wp.array:
        return self._launcher.array(np.ascontiguousarray(matrix, np.float32), label)

    def forward(self, a: wp.array, modes: wp.array) -> None:
        """Writes the modes of `a`; both may be the same array."""
        self._apply(a, modes, self._forward)

    def inverse(self, modes: wp.array) -> None:
        """Replaces modes by the field that they make up."""
        self._apply(modes, modes, self._inverse)

    def _apply(self, a: wp.array, result: wp.array, steps: list) -> None:
        source, target = a, self._scratch
        for axis, matrix in steps:
            self._launcher.launch(_transform, self._shape, matrix, _UNITS[axis], source, target)
            source, target = target, self._scratch if target is result else result
        if source is not result:
            wp.copy(result, source)
