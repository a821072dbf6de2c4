"""The command line: arguments in, calls out.

Exit status 0 done, 2 bad input (one line), 1 failed, 130 stopped by Ctrl-C, 143 by SIGTERM.
"""

import json
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, CycloptsError, Parameter
from rich.console import Console

import warp_smoke
from warp_smoke.interrupt import Interrupted
from warp_smoke.run import plan_run

if TYPE_CHECKING:
    from rich.progress import Progress

    from warp_smoke.study.case import Row

app = App(
    name="warp-smoke",
    help="Smoke, its shadows and baked lighting for USD stages: only the effects that a scene calls for.",
    version=lambda: warp_smoke.__version__,
    help_format="rich",
    default_parameter=Parameter(negative=()),
    suppress_keyboard_interrupt=False,
)
_out, _err = Console(), Console(stderr=True)

# In a log, where no bar can move, a line says now and then how far a long run is.
_SECONDS_BETWEEN_LINES = 10

Output = Annotated[Path | None, Parameter(name=["--output", "-o"])]


@app.command
def run(
    stage: Path,
    *,
    output: Output = None,
    frames: str | None = None,
    quality: str | None = None,
    max_error: float | None = None,
    budget: float | None = None,
    resolution: int | None = None,
    bake_all: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    depth_maps: bool = False,
    resume: bool = False,
    checkpoint_every: int | None = None,
    flatten: bool = False,
    usdz: bool = False,
    volume_shader: Literal["karma", "arnold", "omniverse"] | None = None,
    watch: Annotated[bool, Parameter(name="--preview")] = False,
    as_json: Annotated[bool, Parameter(name="--json")] = False,
):
    """Simulate, shadow, bake and write: STAGE in, a finished stage over it in the output folder.

    Parameters
    ----------
    stage
        The USD stage.
    output
        Folder for the results; out/NAME unless given.
    frames
        First and last frame as A:B; the stage's unless given.
    quality
        draft, preview or final: measured settings for all that the stage leaves open.
    max_error
        Choose the fastest resolution and scheme within this error: relative L2 of the density, or rms of the bakes.
    budget
        Choose the most exact resolution and scheme of which a frame takes no longer, in milliseconds.
    resolution
        Cells along the longest side of every domain, instead of the stage's.
    bake_all
        Bake every visible mesh, not only those with SmokeReceiverAPI.
    device
        cpu, cuda or cuda:N.
    threads
        CPU threads; all unless given.
    depth_maps
        Also write the shadow maps of the last frame as pictures, textures/LIGHT.depth.png.
    resume
        Go on after the last frame of a run that was stopped or killed; from the first one where nothing is left of it.
    checkpoint_every
        Frames between checkpoints, 0 for none but at Ctrl-C; as many as cost less than 5 % of the time unless given.
    flatten
        Also write the stage as one layer, NAME.flat.usdc, beside its volumes and textures.
    usdz
        Also write the stage with its textures as one package, NAME.usdz, which cannot hold volumes.
    volume_shader
        Also write materials for the smoke, for one renderer, into a layer over the results: NAME.RENDERER.usda.
    watch
        Show frames in a window as they are made, as many as slow the run by a tenth at most, then all of them; the
        run goes on where the window is closed.
    as_json
        Print the report as JSON.
    """
    scene = _open(stage, frames, resolution, bake_all)
    by_measure = max_error is not None or budget is not None
    if by_measure and resolution is not None:
        raise ValueError(f"--resolution is {resolution}; allowed: none, where --max-error or --budget chooses it")
    choice = {"quality": quality, "max_error": max_error, "budget": budget}
    with _progress_bar() as bar:
        planned = plan_run(scene, **choice, device=device, threads=threads, on_row=_say_rows(bar))
    scene = planned.scene
    if planned.chosen:
        _err.print(str(planned.chosen), soft_wrap=True, markup=False, highlight=False)
    live = warp_smoke.live_preview(scene) if watch else None
    bar = _progress_bar()
    task = bar.add_task("Loading kernels (compiled on first use)", total=len(scene.frames))
    said = monotonic()

    made = 0

    def show(frame: "warp_smoke.Frame") -> None:
        nonlocal said, made
        if resume and not made:
            before = frame.number - 1
            _err.print(f"Going on after frame {before}" if before >= scene.start else "No checkpoint: from the start")
            bar.update(task, completed=frame.number - scene.start)
        made += 1
        bar.update(task, advance=1, description=f"Frame {frame.number}")
        if bar.disable and monotonic() - said > _SECONDS_BETWEEN_LINES:
            said = monotonic()
            _err.print(f"frame {frame.number} of {scene.end}", highlight=False)
        if live:
            live(frame)

    options = {"device": device, "threads": threads, "depth_maps": depth_maps, "on_frame": show}
    with bar:
        result = warp_smoke.run(planned, output, resume=resume, checkpoint_every=checkpoint_every, **options)
    if resume and not made:
        _err.print("Finished already: nothing to do without a change, or without --resume")
    closed_by_user = bool(live and live.closed)
    if live:
        live.close()
    written = [result.stage]
    if volume_shader:
        from warp_smoke.usd.volume_shader import write_volume_shader

        written.append(write_volume_shader(result.stage, scene, volume_shader))
    if flatten or usdz:
        from warp_smoke.usd.export import flatten_stage, package_stage

        written += [flatten_stage(result.stage, result.stage.with_suffix(".flat.usdc"))] if flatten else []
        written += [package_stage(result.stage, result.stage.with_suffix(".usdz"))] if usdz else []
    if as_json:
        print(json.dumps(result.report, indent=2))
        return
    _warn(result.report["warnings"])
    from warp_smoke.report import summary

    _out.print(summary(result.report), highlight=False)
    for file in written:
        _out.print(f"Wrote {file}", soft_wrap=True, highlight=False)
    if live and not closed_by_user:
        warp_smoke.preview(result)


@app.command
def plan(
    stage: Path,
    *,
    frames: str | None = None,
    quality: str | None = None,
    resolution: int | None = None,
    bake_all: bool = False,
    as_json: Annotated[bool, Parameter(name="--json")] = False,
):
    """Show which passes STAGE calls for, in order, and why the others do not run; nothing is simulated.

    Parameters
    ----------
    stage
        The USD stage.
    frames
        First and last frame as A:B; the stage's unless given.
    quality
        draft, preview or final: measured settings for all that the stage leaves open.
    resolution
        Cells along the longest side of every domain, instead of the stage's.
    bake_all
        Plan to bake every visible mesh, not only those with SmokeReceiverAPI.
    as_json
        Print the plan as JSON.
    """
    from rich.table import Table

    from warp_smoke.launch import Launcher

    scene = _open(stage, frames, resolution, bake_all)
    made = warp_smoke.make_plan(scene, quality=quality)
    if as_json:
        passes, left_out = ([asdict(each) for each in kind] for kind in (made.passes, made.left_out))
        plain = {"passes": passes, "left_out": left_out, "bytes": made.bytes}
        print(json.dumps(plain | {"chosen": asdict(made.chosen) if made.chosen else None}, indent=2))
        return
    _warn([*scene.warnings, *made.warnings])
    if made.chosen:
        _out.print(str(made.chosen), soft_wrap=True, markup=False, highlight=False)
    table = Table("Pass", "For", "When", "Why", title="Runs, in this order")
    for each in made.passes:
        method = f"\n[dim]{each.method}[/dim]" if each.method else ""
        table.add_row(each.name + method, "\n".join(each.subjects), each.when, each.why)
    _out.print(table if made.passes else "Nothing runs.")
    if made.left_out:
        table = Table("Pass", "For", "Why not", title="Left out", style="dim")
        for out in made.left_out:
            table.add_row(out.name, "\n".join(out.subjects), out.why)
        _out.print(table)
    _out.print(made.memory, highlight=False)
    made.check_memory(Launcher().available_bytes())


@app.command
def preview(
    path: Path,
    *,
    frame: int | None = None,
    screenshot: Path | None = None,
    movie: Path | None = None,
    html: Path | None = None,
    show: str | None = None,
    size: str = "1280x720",
):
    """Look at a stage, or at the results in a folder: in a window (press h there), a picture, a movie or a web page.

    Parameters
    ----------
    path
        A USD stage or a folder written by `run`.
    frame
        Frame to start with; the middle one unless given.
    screenshot
        Save a picture here instead of opening a window.
    movie
        Save all frames as a movie here instead: .mp4 (needs ffmpeg or the package imageio-ffmpeg) or .gif.
    html
        Save all frames here instead, as pictures in one web page that plays them in any browser.
    show
        density, temperature or speed: a cut through the smoke by colour, with a bar, instead of its look.
    size
        Width and height in pixels.
    """
    pixels = _size(size)
    with _progress_bar() as bar:
        outputs = [file for file in (movie, html) if file is not None]
        task = bar.add_task("Drawing", total=None, visible=bool(outputs))

        def show_frame(number: int, count: int) -> None:
            bar.update(task, advance=1, total=len(outputs) * count, description=f"Frame {number}")

        warp_smoke.preview(
            path,
            frame=frame,
            screenshot=screenshot,
            size=pixels,
            movie=movie,
            html=html,
            quantity=show,
            on_frame=show_frame,
        )
    for file in filter(None, (screenshot, movie, html)):
        _out.print(f"Wrote {file}", soft_wrap=True, highlight=False)


@app.command
def render(
    path: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    frame: int | None = None,
    size: str = "640x360",
    quality: str | None = None,
    samples: int | None = None,
    shading: str = "pixel",
    device: str = "cpu",
    threads: int | None = None,
):
    """Ray-cast a picture through the stage's camera: surfaces, their shadows, and smoke.

    Parameters
    ----------
    path
        A USD stage, whose smoke is simulated up to the frame, or a folder written by `run`, whose smoke is read.
    output
        The PNG file.
    frame
        The frame; the middle one unless given.
    size
        Width and height in pixels.
    quality
        draft, preview or final: measured settings for the samples, and for smoke that has to be simulated.
    samples
        Rays along each side of a pixel; 2, or those of the quality, unless given.
    shading
        Light for each pixel, or for each vertex.
    device
        cpu, cuda or cuda:N.
    threads
        CPU threads; all unless given.
    """
    options = {"quality": quality, "samples": samples, "shading": shading, "device": device, "threads": threads}
    warp_smoke.render(path, output, frame=frame, size=_size(size), **options)
    _out.print(f"Wrote {output}", soft_wrap=True, highlight=False)


@app.command
def study(
    stage: Path | None = None,
    *,
    suite: Annotated[list[str] | None, Parameter(consume_multiple=True)] = None,
    full: bool = False,
    output: Output = None,
    device: str = "cpu",
    threads: int | None = None,
    as_json: Annotated[bool, Parameter(name="--json")] = False,
):
    """Measure what accuracy costs in time, on known answers or on STAGE; tables, diagrams and a web page.

    A study that was interrupted goes on where it was.

    Parameters
    ----------
    stage
        A USD stage, studied at several settings against its finest.
    suite
        advection, pressure, flow, smoke_shadow, surface_shadow, shading, scene (with a stage) or all; several may be
        given. Without a stage all, with one scene, unless given.
    full
        Measure at more and finer resolutions; else each suite takes less than two minutes on two cores.
    output
        Folder for the results; out/study, or out/NAME.study for a stage, unless given.
    device
        cpu, cuda or cuda:N.
    threads
        CPU threads; all unless given.
    as_json
        Print disclosure, orders and rows as JSON.
    """
    with _progress_bar() as bar:
        options = {"suites": suite, "full": full, "device": device, "threads": threads, "on_row": _say_rows(bar)}
        result = warp_smoke.study(stage, output, **options)
    if as_json:
        print(json.dumps(result.as_json(), indent=2))
        return
    _warn([f"{name}: {line}" for name, lines in result.unexpected.items() for line in lines])
    _warn([f"failed: {row.key}: {row.failure}" for row in result.rows if row.failure is not None])
    if result.recommendation:
        _out.print(result.recommendation, highlight=False)
    _out.print(f"Wrote {result.page}", soft_wrap=True, highlight=False)


@app.command
def validate(path: Path, *, as_json: Annotated[bool, Parameter(name="--json")] = False):
    """Check that a stage is one that every DCC accepts; exit status 1 if it is not.

    Parameters
    ----------
    path
        A USD stage or a folder written by `run`.
    as_json
        Print the problems as JSON.
    """
    from warp_smoke.usd.validate import validate_stage

    problems = validate_stage(path)
    if as_json:
        print(json.dumps([asdict(problem) for problem in problems], indent=2, default=str))
    else:
        for problem in problems:
            _out.print(str(problem), soft_wrap=True, markup=False)
        severities = [problem.severity for problem in problems]
        counts = [f"{severities.count(each)} {each}(s)" for each in dict.fromkeys(severities)]
        _out.print(f"{path}: {', '.join(counts) or 'no problems'}", soft_wrap=True, highlight=False)
    return 1 if any(problem.severity == "error" for problem in problems) else 0


@app.command
def info(*, as_json: Annotated[bool, Parameter(name="--json")] = False):
    """Print versions, devices, threads and the kernel cache's folder.

    Parameters
    ----------
    as_json
        Print as JSON.
    """
    import warp as wp

    from warp_smoke.report import environment

    facts = environment() | {"kernel cache": str(wp.config.kernel_cache_dir)}
    if as_json:
        print(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        _out.print(f"{name:14} {value}", soft_wrap=True, highlight=False)


def _size(text: str) -> tuple[int, int]:
    """Width and height of a picture."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= 8192 and 0 < int(height) <= 8192):
        raise ValueError(f"--size is {text}; allowed: WIDTHxHEIGHT, 1 to 8192 pixels each")
    return int(width), int(height)


def _progress_bar() -> "Progress":
    """A line on the terminal that tells how far a command is; nothing where there is no terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, TimeRemainingColumn(), console=_err, transient=True, disable=not _err.is_terminal)


def _say_rows(bar: "Progress") -> Callable[["Row", int, int], None]:
    """Shows how far a study is: for each row, its number and their count."""
    task = bar.add_task("Measuring (kernels are compiled on first use)", total=None)
    said = monotonic()

    def show(row: "Row", number: int, count: int) -> None:
        nonlocal said
        bar.update(task, completed=number, total=count, description=f"{row.suite}: {row.problem}, {row.method}")
        if bar.disable and monotonic() - said > _SECONDS_BETWEEN_LINES:
            said = monotonic()
            _err.print(f"{number} of {count}: {row.suite}, {row.problem}, {row.method}", highlight=False)

    return show


def _open(stage: Path, frames: str | None, resolution: int | None, bake_all: bool) -> "warp_smoke.Scene":
    """The scene of a stage with the command line's changes."""
    scene = warp_smoke.Scene.open(stage)
    if frames is not None:
        first, colon, last = frames.partition(":")
        try:
            scene = replace(scene, start=int(first), end=int(last if colon else first))
        except ValueError:
            allowed = "A:B, whole numbers with A ≤ B"
            raise ValueError(f"--frames is {frames}; allowed: {allowed}") from None
    if resolution is not None:
        domains = [replace(d, resolution=resolution, given=d.given | {"resolution"}) for d in scene.domains]
        scene = replace(scene, domains=domains)
    if bake_all:
        baked = [s.receiver or (warp_smoke.Receiver(path=s.path) if s.holds_bakes else None) for s in scene.surfaces]
        surfaces = [replace(s, receiver=receiver) for s, receiver in zip(scene.surfaces, baked, strict=True)]
        scene = replace(scene, surfaces=surfaces)
    return scene


def _warn(warnings: list[str]) -> None:
    for warning in warnings:
        _err.print(f"[yellow]warning[/yellow] {warning}", soft_wrap=True, highlight=False)


_BAD_INPUT = (
    CycloptsError,
    ValueError,
    NotImplementedError,
    FileNotFoundError,
    FileExistsError,
    IsADirectoryError,
    NotADirectoryError,
    PermissionError,
)
_FAILED = (*_BAD_INPUT, OSError, ImportError, MemoryError, FloatingPointError)


def main() -> None:
    """Entry point of `warp-smoke`."""
    try:
        status = app(sys.argv[1:], exit_on_error=False, print_error=False)
    except BrokenPipeError:  # whoever reads the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    except _FAILED as error:
        _err.print(f"[red]error[/red] {_one_line(error)}", soft_wrap=True, highlight=False)
        status = 2 if isinstance(error, _BAD_INPUT) else 1
    except KeyboardInterrupt as stop:
        _err.print(f"{stop}; --resume goes on from there." if isinstance(stop, Interrupted) else "Stopped.")
        status = 128 + getattr(stop, "signal", signal.SIGINT)
    sys.exit(status or 0)


def _one_line(error: Exception) -> str:
    from rich.markup import escape

    if isinstance(error, OSError) and error.filename:
        return escape(f"{error.filename}: {error.strerror}")
    return escape(" ".join(str(error).split()) or type(error).__name__)
