"""Kernels: few parameters in one order, and compiled before they are launched."""

import ast
from dataclasses import replace
from pathlib import Path

import pytest
from busy_scene import busy_scene
from scenes import at, plume

import warp_smoke
from warp_smoke.kernels import kernel_modules
from warp_smoke.launch import Launcher

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


BALL = warp_smoke.Collider(path="/World/Ball", mesh=warp_smoke.Mesh.sphere(0.2, 16), transform=at(0, 1.2, 0))


@pytest.fixture
def launched_modules(monkeypatch):
    """Modules of the kernels that have been launched."""
    launched, launch = set(), Launcher._launch
    monkeypatch.setattr(Launcher, "_launch", lambda *args: [launched.add(args[1].module.name), launch(*args)])
    return launched


@pytest.mark.parametrize("colliders", [(), (BALL,)], ids=["box", "ball"])
@pytest.mark.parametrize("scheme", ["semi_lagrangian", "semi_lagrangian_cubic", "maccormack", "bfecc"])
def test_all_kernels_are_compiled_beforehand(launched_modules, scheme, colliders):
    """Steps launch no kernel of a module that the plan did not name, which would be compiled in the middle of a run."""
    simulation = warp_smoke.Simulation(replace(plume(advection=scheme), colliders=colliders))
    for _ in range(3):
        simulation.step()
    assert "warp_smoke.fluid.emitters" in launched_modules
    assert launched_modules <= set(kernel_modules(simulation.plan))


def test_all_kernels_of_a_busy_scene_are_compiled_beforehand(launched_modules):
    """Likewise with points that emit, walls that move, turbulence, wind, diffusion, coloured smoke and light grids."""
    simulation = warp_smoke.Simulation(busy_scene())
    for _ in range(3):
        simulation.step()
    assert "warp_smoke.fluid.point_voxels" in launched_modules
    assert launched_modules <= set(kernel_modules(simulation.plan))
