"""Linear RGB and the sRGB bytes of screens and picture files (IEC 61966-2-1)."""

import numpy as np

_STEPS = 4095


def _encode(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)


# The curve is steep near black: in even steps of sqrt(linear) it is off by at most 0.05 before it is rounded.
_BYTES = np.rint(255 * _encode(np.linspace(0.0, 1.0, _STEPS + 1) ** 2)).astype(np.uint8)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Bytes of sRGB, uint8 of the same shape, from linear values; those outside [0, 1] are clipped."""
    root = np.sqrt(np.clip(linear, 0.0, 1.0))
    return _BYTES[np.rint(_STEPS * root).astype(np.int16)]


def to_bytes(codes: np.ndarray) -> np.ndarray:
    """The nearest codes of 8 bits, uint8, to codes of 8 or 16 bits; the same array if it has them."""
    return codes if codes.dtype == np.uint8 else np.rint(codes / 257.0).astype(np.uint8)


def expose_codes(codes: np.ndarray, stops: float) -> np.ndarray:
    """Bytes of sRGB with their light doubled for each stop; the same array for none."""
    if stops == 0:
        return codes
    encoded = np.arange(256) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear_to_srgb(2.0**stops * linear)[codes]
