"""Conversion of linear RGB to the sRGB bytes of screens and picture files (IEC 61966-2-1), and back."""

import numpy as np

_STEPS = 4095


def _encode(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)


def _decode(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


# The curve is steep near black: in even steps of sqrt(linear) it is off by at most 0.05 before it is rounded.
_CODES = _encode(np.linspace(0.0, 1.0, _STEPS + 1) ** 2).astype(np.float32)
_BYTES = np.rint(255 * _CODES).astype(np.uint8)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Encodes linear values as sRGB bytes, uint8 of the same shape; values outside [0, 1] are clipped."""
    root = np.sqrt(np.clip(linear, 0.0, 1.0))
    return _BYTES[np.rint(_STEPS * root).astype(np.int16)]


def encode_light(linear: np.ndarray) -> tuple[np.ndarray, float]:
    """Encodes linear values as sRGB codes; the curve is extended to values brighter than white.

    Returns:
        Codes, uint16 of the same shape, 0 for values below 0; and the sRGB value that 65535 stands for, at least 1.
    """
    root = np.sqrt(np.maximum(linear, 0.0))
    encoded = _CODES[np.rint(_STEPS * np.minimum(root, 1.0)).astype(np.int16)]
    bright = root > 1.0
    encoded[bright] = _encode(root[bright] ** 2)
    brightest = max(float(encoded.max(initial=0.0)), 1.0)
    return np.rint(encoded * (65535 / brightest)).astype(np.uint16), brightest


def expose_light(codes: np.ndarray, brightest: float, stops: float) -> tuple[np.ndarray, float]:
    """Returns what `encode_light` would for the same light doubled for each stop."""
    if stops == 0:
        return codes, brightest
    table, brightest = encode_light(2.0**stops * _decode(np.linspace(0.0, brightest, 65536)))
    return table[codes], brightest


def to_bytes(codes: np.ndarray) -> np.ndarray:
    """Rounds 8- or 16-bit codes to 8 bits, uint8; returns the same array if it is 8-bit."""
    return codes if codes.dtype == np.uint8 else np.rint(codes / 257.0).astype(np.uint8)


def expose_codes(codes: np.ndarray, stops: float) -> np.ndarray:
    """Returns sRGB bytes with their light doubled for each stop; the same array for 0 stops."""
    if stops == 0:
        return codes
    return linear_to_srgb(2.0**stops * _decode(np.arange(256) / 255))[codes]
