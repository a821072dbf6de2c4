"""The suites by name; a suite's module, and its kernels with it, is imported only when needed."""

from importlib import import_module

from warp_smoke.study.case import Suite

SUITES = ("advection", "pressure", "flow", "smoke_shadow", "surface_shadow", "shading")


def load_suite(name: str) -> Suite:
    """Imports a suite's module."""
    return import_module(f"warp_smoke.study.{name}")
