"""Signatures of kernels: few parameters, in one order."""

import ast
from pathlib import Path

import pytest

import warp_smoke

_FILES = [
    path for path in sorted(Path(warp_smoke.__file__).parent.rglob("*.py")) if "@wp.kernel" in path.read_text("utf-8")
]


def _kernels(path: Path) -> list[ast.FunctionDef]:
    functions = (node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.FunctionDef))
    return [each for each in functions if any("wp.kernel" in ast.unparse(mark) for mark in each.decorator_list)]


@pytest.mark.parametrize("path", _FILES, ids=lambda path: path.stem)
def test_kernels_take_few_parameters_in_one_order(path):
    """Each kernel has 12 parameters at most: Rows first, what it writes last, and named so."""
    kernels = _kernels(path)
    assert kernels
    for kernel in kernels:
        names = [each.arg for each in kernel.args.args]
        written = [name.endswith(("_out", "_inout")) for name in names]
        assert len(names) <= 12, kernel.name
        assert ast.unparse(kernel.args.args[0].annotation) == "Rows", kernel.name
        assert any(written), kernel.name
        assert written == sorted(written), kernel.name
