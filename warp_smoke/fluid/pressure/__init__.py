"""Pressure projection: one solver a file, all with the signature in `spectral.py`."""
