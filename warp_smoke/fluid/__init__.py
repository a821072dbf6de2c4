"""Stable-fluids smoke on a staggered grid: one concept a file, joined by `solver.py`."""
