"""The last frame of a run, how long its frames take, and how far it is from that of another run."""

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from warp_smoke.kernels import kernel_modules
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, load_kernels
from warp_smoke.lighting import Lighting
from warp_smoke.picture import PictureRenderer, SmokeVolume, render_kernels
from warp_smoke.plan import make_plan
from warp_smoke.scene import Scene
from warp_smoke.simulation import Simulation
from warp_smoke.study.case import Measured
from warp_smoke.timing import Timings

_VIEW_SIZE = (320, 180)
# Bakes of anything but light are the same at all settings.
_LIGHT_BAKES = ("lit", "irradiance", "visibility", "smokeShadow")


@dataclass(frozen=True)
class Outcome:
    """The last frame of a run.

    Attributes:
        volumes: the smoke, by domain path.
        pictures: baked pictures, by receiver path and bake.
        view: the picture through the camera, [h, w, 3] uint8, or None without a camera.
    """

    volumes: Mapping[str, SmokeVolume]
    pictures: Mapping[tuple[str, str], np.ndarray]
    view: np.ndarray | None


def run_scene(launcher: Launcher, scene: Scene, repeats: int) -> tuple[Outcome, Measured]:
    """Runs all frames of a scene; the measurement has no errors yet.

    Frames after the first are timed: the first has no fluid step and sets up what is static. A scene with too few
    frames for `repeats` runs again; one with a single frame is timed on that frame, after a warm-up run.
    """
    samples: list[float] = []
    outcome, count, passes, simulation = _run_once(launcher, scene, samples)
    alone = len(scene.frames) == 1
    if alone:
        samples.clear()
    while len(samples) < repeats:
        _, count, passes, simulation = _run_once(launcher, scene, samples)
    cells = sum(each.lattice.cells for each in simulation.plan.domains)
    per_frame = {name: seconds / count for name, seconds in passes.items()}
    return outcome, Measured({}, tuple(samples), cells or None, passes=per_frame)


def _run_once(launcher: Launcher, scene: Scene, samples: list[float]) -> tuple[Outcome, int, dict, Simulation]:
    """Adds frame times to `samples`; returns the outcome, the number of timed frames, time by pass, and simulation."""
    simulation = Simulation(scene, device=str(launcher.device), threads=launcher.threads)
    seconds, alone = simulation.timings.seconds, len(scene.frames) == 1
    before, pictures = dict(seconds), {}
    for number in scene.frames:
        began = perf_counter()
        frame = simulation.step()
        launcher.synchronize()
        took = perf_counter() - began
        pictures |= frame.pictures
        if alone or number > scene.start:
            samples.append(took)
        else:
            before = dict(seconds)
    passes = {name: seconds[name] - before.get(name, 0.0) for name in seconds if name != "load_kernels"}
    volumes = {
        each.domain.path: SmokeVolume(each.domain, each.lattice, frame.smoke[each.domain.path].density)
        for each in simulation.plan.domains
    }
    outcome = Outcome(volumes, _of_light(pictures), _view(launcher, scene, list(volumes.values())))
    return outcome, len(scene.frames) - (not alone), passes, simulation


def light_scene(
    launcher: Launcher, scene: Scene, volumes: Mapping[str, SmokeVolume], repeats: int
) -> tuple[Outcome, Measured]:
    """Computes all shadows and bakes of a scene's last frame from given smoke, reusing nothing from earlier frames."""
    plan = make_plan(scene)
    load_kernels(kernel_modules(plan), str(launcher.device))
    densities = {path: launcher.array(each.density, "density") for path, each in volumes.items()}
    seconds = []
    for repeat in range(repeats + 1):
        lighting = Lighting(launcher, plan, Timings(launcher))
        began = perf_counter()
        pictures = lighting.update(scene.end, densities)
        launcher.synchronize()
        if repeat:  # the first one warms up
            seconds.append(perf_counter() - began)
    pictures = _of_light(pictures)
    texels = sum(int(np.prod(each.shape[:2])) for each in pictures.values())
    return Outcome(volumes, pictures, None), Measured({}, tuple(seconds), texels or None)


def _of_light(pictures: Mapping[tuple[str, str], np.ndarray]) -> dict[tuple[str, str], np.ndarray]:
    return {key: pixels for key, pixels in pictures.items() if key[1] in _LIGHT_BAKES}


def _view(launcher: Launcher, scene: Scene, volumes: list[SmokeVolume]) -> np.ndarray | None:
    if scene.camera is None:
        return None
    renderer = PictureRenderer(launcher, scene, *_VIEW_SIZE)
    load_kernels(render_kernels(scene, volumes), str(launcher.device))
    return renderer.render(scene.end, volumes)


def differences(found: Outcome, finest: Outcome) -> dict[str, float]:
    """Returns how far one run is from another, in the results that both have.

    Returns:
        `density`: relative L2 difference, on the cells of the coarser run; `shadows` and `picture`: root mean square
        difference of the baked pictures' and of the view's values, which go from 0 to 1.
    """
    errors = {}
    paths = found.volumes.keys() & finest.volumes.keys()
    if paths:
        pairs = [_on_coarser(found.volumes[path], finest.volumes[path]) for path in sorted(paths)]
        off = sum(((a - b) ** 2).sum() for a, b in pairs)
        size = sum((b**2).sum() for _, b in pairs)
        errors["density"] = float(np.sqrt(off / size)) if size else float(off > 0)
    baked = sorted(found.pictures.keys() & finest.pictures.keys())
    if baked:
        errors["shadows"] = _rms([(found.pictures[key], finest.pictures[key]) for key in baked])
    if found.view is not None and finest.view is not None:
        errors["picture"] = _rms([(found.view, finest.view)])
    return errors


def _rms(pairs: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Returns the root mean square difference of pixels, scaled so that the largest code is 1."""
    total = count = 0.0
    for a, b in pairs:
        most = np.iinfo(a.dtype).max if np.issubdtype(a.dtype, np.integer) else 1.0
        total += (((a.astype(float) - b.astype(float)) / most) ** 2).sum()
        count += a.size
    return float(np.sqrt(total / count))


def _on_coarser(a: SmokeVolume, b: SmokeVolume) -> tuple[np.ndarray, np.ndarray]:
    """Averages two densities over the cells of the coarser lattice, float64."""
    coarser = max(a.lattice, b.lattice, key=lambda lattice: lattice.voxel_size)
    return tuple(mean_over(each.density, each.lattice, coarser) for each in (a, b))


def mean_over(density: np.ndarray, lattice: Lattice, coarser: Lattice) -> np.ndarray:
    """Averages a density over the cells of another lattice with the same axes; it is 0 outside its own cells."""
    means = density.astype(float)
    if lattice == coarser:
        return means
    corners = [each.to_world[3, :3] @ lattice.axes.T for each in (lattice, coarser)]
    for axis in range(3):
        ends = [
            corner[axis] + each.voxel_size * np.arange(each.shape[axis] + 1)
            for corner, each in zip(corners, (lattice, coarser), strict=True)
        ]
        (fine_low, fine_high), (low, high) = ((end[:-1], end[1:]) for end in ends)
        shared = np.minimum(high[:, None], fine_high) - np.maximum(low[:, None], fine_low)
        weights = np.maximum(shared, 0.0) / coarser.voxel_size
        means = np.moveaxis(np.tensordot(weights, means, axes=(1, axis)), 0, axis)
    return means
