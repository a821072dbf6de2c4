"""Every module with kernels compiles for CUDA; that needs neither a GPU nor a driver."""

from importlib import import_module
from pathlib import Path

import pytest
import warp as wp

import warp_smoke

_ROOT = Path(warp_smoke.__file__).parent


def _has_kernels(name: str) -> bool:
    import_module(name)
    return bool(wp.get_module(name).kernels)


_MODULES = [
    name
    for path in sorted(_ROOT.rglob("*.py"))
    if "\nwp.set_module_options(" in path.read_text(encoding="utf-8")
    and _has_kernels(name := ".".join(("warp_smoke", *path.relative_to(_ROOT).with_suffix("").parts)))
]


@pytest.mark.parametrize("name", _MODULES)
def test_compiles_for_cuda(name, tmp_path):
    """NVRTC takes the module's kernels for compute capability 8.0 and 9.0."""
    made = wp.compile_aot_module(import_module(name), arch=[80, 90], module_dir=tmp_path)
    assert len(made) == 2
    assert all(path.stat().st_size > 0 for path in made)
