"""Kernels: few parameters in one order, and compiled before they are launched."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_scene import busy_scene
from scenes import at, plume

import warp_smoke
from warp_smoke.kernels import kernel_modules
from warp_smoke.lattice import place_lattice
from warp_smoke.launch import Launcher
from warp_smoke.picture import PictureRenderer, SmokeVolume, render_kernels

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


@pytest.mark.parametrize("shading", ["pixel", "vertex"])
@pytest.mark.parametrize(
    "fields", [{"shadow_filter": "area"}, {"smoke_diffusion": 1.0}, {"smoke_shadow": "ray_traced"}]
)
def test_all_kernels_of_a_picture_are_compiled_beforehand(launched_modules, launcher, shading, fields):
    """Likewise a picture with smoke, whatever its shadows are."""
    scene = replace(plume(), camera=warp_smoke.Camera(path="/World/Eye", transform=at(0, 1, 6)))
    scene = replace(scene, lights=[replace(light, **fields) for light in scene.lights])
    lattice = place_lattice(scene, scene.domains[0])
    volumes = [SmokeVolume(scene.domains[0], lattice, np.ones(lattice.shape, np.float32))]
    PictureRenderer(launcher, scene, 16, 12, shading=shading).render(1.0, volumes)
    assert "warp_smoke.shading.smoke_march" in launched_modules
    assert launched_modules <= set(render_kernels(scene, volumes))
