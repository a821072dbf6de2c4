"""Pictures of scenes in memory, of stages, and of a run's results."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from warp_smoke.files import write_png
from warp_smoke.kernels import smoke_shadow_kernels
from warp_smoke.launch import Launcher, load_kernels
from warp_smoke.picture.renderer import PictureRenderer
from warp_smoke.picture.smoke_volume import SmokeVolume
from warp_smoke.quality import choose_quality, samples_of
from warp_smoke.record import FieldError
from warp_smoke.scene import Scene

DEFAULT_SAMPLES = 2
_KERNELS = ("shading.primary_rays", "shading.radiance", "shading.surface_points", "shadow.ray_traced")


def render_kernels(scene: Scene, volumes: Sequence[SmokeVolume]) -> list[str]:
    """Returns the names of the kernel modules that a picture needs."""
    names = set(_KERNELS)
    if volumes:
        names |= {"shading.smoke_march", "shading.volume"}
        names |= {name for light in scene.lights for name in smoke_shadow_kernels(light.smoke_shadow)}
        names |= {"shadow.diffusion" for light in scene.lights if light.smoke_diffusion}
    return [f"warp_smoke.{name}" for name in sorted(names)]


def render_picture(
    scene: Scene,
    time: float,
    volumes: Sequence[SmokeVolume] = (),
    *,
    size: tuple[int, int] = (640, 360),
    samples: int = 1,
    shading: str = "pixel",
    device: str = "cpu",
    threads: int | None = None,
) -> np.ndarray:
    """Renders a picture of a scene through its camera.

    Args:
        scene: the scene.
        time: time code.
        volumes: the smoke at that time.
        size: width and height [pixels].
        samples: along each side of a pixel: samples² rays.
        shading: light per `pixel` or per `vertex`.
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.

    Returns:
        sRGB [height, width, 3] uint8, first row at the top.

    Raises:
        ValueError: the scene has no camera, a texture cannot be read, or a number is not allowed.
    """
    launcher = Launcher(device, threads)
    renderer = PictureRenderer(launcher, scene, *size, samples=samples, shading=shading)
    load_kernels(render_kernels(scene, volumes), device)
    return renderer.render(time, volumes)


def render(
    path: str | Path,
    output: str | Path,
    *,
    frame: int | None = None,
    camera: str | None = None,
    size: tuple[int, int] = (640, 360),
    quality: str | None = None,
    samples: int | None = None,
    shading: str = "pixel",
    device: str = "cpu",
    threads: int | None = None,
    on_warning: Callable[[str], None] | None = None,
) -> Path:
    """Writes a picture of a stage, or of the results in a folder, through the stage's camera.

    Smoke that a run has written is read from its files; that of any other stage is simulated up to the frame.

    Args:
        path: a USD stage, or a folder written by `run`.
        output: the `.png` file.
        frame: the frame; the middle one unless given.
        camera: prim path; the stage's own camera unless given.
        size: width and height [pixels].
        quality: a preset, draft, preview or final, for the samples, and for smoke that has to be simulated.
        samples: along each side of a pixel: samples² rays; 2, or those of the quality, unless given.
        shading: light per `pixel` or per `vertex`.
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.
        on_warning: called with a line for each thing on the stage that cannot be shown as it is.

    Returns:
        The file.

    Raises:
        ValueError: the stage or one of its files is damaged, it has no camera or no such frame, or a number is not
            allowed.
        OSError: a file cannot be read or written.
    """
    if Path(output).suffix.lower() != ".png":
        raise ValueError(f"output is {output}; allowed: a name that ends in .png")
    from warp_smoke.usd.own_look import open_in_own_look
    from warp_smoke.usd.read_volume import read_volumes

    stage, scene = open_in_own_look(path, camera)
    if scene.camera is None:
        raise ValueError(f"{path}: no camera to render through; add a UsdGeomCamera")
    if frame is None:
        frame = scene.middle_frame
    if frame not in scene.frames:
        raise FieldError(str(path), "frame", frame, f"{scene.start}…{scene.end}")
    usual = DEFAULT_SAMPLES if quality is None else samples_of(quality)
    launcher = Launcher(device, threads)
    samples = usual if samples is None else samples
    renderer = PictureRenderer(launcher, scene, *size, samples=samples, shading=shading)
    for warning in renderer.warnings if on_warning else ():
        on_warning(warning)
    volumes = [SmokeVolume(*each) for each in read_volumes(stage, scene, frame)]
    if not volumes and scene.domains:
        smoky = scene if quality is None else choose_quality(scene, quality)[0]
        volumes = simulate_smoke(smoky, frame, device, threads)
    load_kernels(render_kernels(scene, volumes), device)
    write_png(Path(output), renderer.render(frame, volumes))
    return Path(output)


def simulate_smoke(scene: Scene, frame: int, device: str = "cpu", threads: int | None = None) -> list[SmokeVolume]:
    """Simulates a scene's smoke up to a frame, without shadows and bakes.

    Raises:
        ValueError: the scene has no such frame, or the device cannot hold the smoke.
    """
    from warp_smoke.simulation import Simulation

    if frame not in scene.frames:
        raise FieldError(str(scene.source or "scene"), "frame", frame, f"{scene.start}…{scene.end}")
    surfaces = [replace(surface, receiver=None) for surface in scene.surfaces]
    domains = [replace(domain, grids=("density",)) for domain in scene.domains]
    simulation = Simulation(replace(scene, surfaces=surfaces, domains=domains), device=device, threads=threads)
    made = None
    while simulation.plan.domains and simulation.frame != frame:
        made = simulation.step()
    return [
        SmokeVolume(each.domain, each.lattice, made.smoke[each.domain.path].density) for each in simulation.plan.domains
    ]
