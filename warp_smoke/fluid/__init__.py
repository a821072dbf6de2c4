"""Stable-fluids smoke on a staggered grid: one concept per file, joined by `solver.py`."""
