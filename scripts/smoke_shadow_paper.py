"""Measures the smoke shadows on this machine and writes docs/smoke_shadow.json, its tables and its pictures.

The paper is Zhan, Yang, Shi and Fei (2008): its table 1, figures 3, 7 and 8, and the effect of its equation (3).
"""

import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp
from PIL import Image
from scipy.ndimage import zoom

import warp_smoke as ws
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.scene import DistantLight
from warp_smoke.shadow.coverage import frame_along
from warp_smoke.shadow.diffusion import Diffusion
from warp_smoke.shadow.dpd import DpdSmokeShadow
from warp_smoke.shadow.methods import SMOKE_SHADOWS
from warp_smoke.study.disclosure import processor
from warp_smoke.study.light_answers import implicit_step

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
REPEATS = 7
# Density grid, shadow texture, and the whole frame on the paper's workstation of 2006 [ms].
TABLE_1 = ((32, 64, 16), (64, 64, 38), (100, 128, 135), (256, 256, 378))
ORIGIN = np.zeros(3)


def median_ms(work: Callable[[], object]) -> float:
    """Measures the median time of some work, after one warm-up run [ms]."""
    work()
    times = []
    for _ in range(REPEATS):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return 1e3 * float(np.median(times))


def machine() -> str:
    """Returns the processor's name, and how many threads are used."""
    return f"{processor()}, {Launcher().threads} threads"


def plume(resolution: int, size: int | None, method: str) -> ws.Scene:
    """Returns the example plume at a resolution, with only its lamp and its floor."""
    scene = ws.Scene.open(ROOT / "stages/plume.usda")
    lamp = replace(scene.lights[0], smoke_shadow=method, smoke_shadow_size=size)
    (floor,) = (surface for surface in scene.surfaces if surface.receiver)
    floor = replace(floor, receiver=replace(floor.receiver, bake=("lit",), texture_size=256))
    domain = replace(scene.domains[0], resolution=resolution, grids=("density",))
    return replace(scene, domains=(domain,), lights=(lamp,), surfaces=(floor,))


def developed_plume() -> np.ndarray:
    """Simulates the density of frame 40 of the plume at 64³."""
    simulation = ws.Simulation(plume(64, None, "march"))
    for _ in range(40):
        simulation.step()
    return simulation.density.numpy()


def resampled(density: np.ndarray, shape: tuple[int, int, int], launcher: Launcher) -> wp.array:
    """Resamples smoke to a lattice of another resolution, linearly between cells."""
    return launcher.array(zoom(density, np.divide(shape, density.shape), order=1), "plume")


def shadow_ms(launcher: Launcher, lattice: Lattice, light: ws.Light, density: wp.array) -> float:
    """Measures the median time of a light's smoke shadow alone [ms]."""
    shadow = SMOKE_SHADOWS[light.smoke_shadow](launcher, lattice, light, ORIGIN, 9.0)
    return median_ms(lambda: shadow.update(density, 1.0))


def table_1(smoke: np.ndarray) -> list[dict]:
    """Measures the paper's rows: the entire frame, and the shadow alone by several methods [ms]."""
    rows = []
    for resolution, size, paper in TABLE_1:
        simulation = ws.Simulation(plume(resolution, size, "dpd"))
        for _ in range(3):
            simulation.step()
        frame = median_ms(simulation.step)
        launcher, lattice = simulation.launcher, simulation.plan.domains[0].lattice
        lamp, sun = simulation.plan.scene.lights[0], ws.Scene.open(ROOT / "stages/plume.usda").lights[1]
        risen = resampled(smoke, lattice.shape, launcher)
        full = launcher.array(np.random.default_rng(0).random(lattice.shape, np.float32), "full")
        row = {"grid": resolution, "texture": size, "paper_frame_ms": paper, "frame_ms": frame}
        for name, light, method, texels, density in (
            ("dpd_ms", lamp, "dpd", size, risen),
            ("dpd_full_ms", lamp, "dpd", size, full),
            ("point_ms", lamp, "march", None, risen),
            ("point_full_ms", lamp, "march", None, full),
            ("distant_ms", sun, "march", None, risen),
            ("distant_full_ms", sun, "march", None, full),
            ("distant_empty_ms", sun, "march", None, wp.zeros_like(full)),
        ):
            chosen = replace(light, smoke_shadow=method, smoke_shadow_size=texels)
            row[name] = shadow_ms(launcher, lattice, chosen, density)
        rows.append(row)
    return rows


def axes(smoke: np.ndarray) -> list[dict]:
    """Measures the default shadow alone for light along each lattice axis; memory rows are along the last [ms]."""
    launcher, rows = Launcher(), []
    for resolution in (64, 256):
        lattice = ws.make_plan(plume(resolution, None, "march")).domains[0].lattice
        density = resampled(smoke, lattice.shape, launcher)
        middle = 0.5 * np.array(lattice.shape)
        for axis, name in enumerate("xyz"):
            # Slightly oblique, so that every slice is shifted; the lamp is two box lengths away.
            direction = np.roll((1.0, 0.2, 0.15), axis)
            frame = frame_along(direction / np.linalg.norm(direction))
            turned = np.eye(4)
            turned[:3, :3] = frame * [[1.0], [-1.0], [-1.0]]
            sun, away = DistantLight(path="/Sun", transform=turned), turned.copy()
            place = np.append(middle - 2.0 * max(lattice.shape) * frame[2], 1.0)
            away[3] = place @ lattice.cells_to_world()
            lamp = ws.PointLight(path="/Lamp", transform=away)
            times = {"distant_ms": shadow_ms(launcher, lattice, sun, density)}
            times["point_ms"] = shadow_ms(launcher, lattice, lamp, density)
            rows.append({"grid": resolution, "axis": name} | times)
    return rows


def methods() -> list[dict]:
    """Measures each method against traced rays on the floor under frame 40 of the plume, and its time [ms]."""
    simulation = ws.Simulation(plume(64, None, "march"))
    for _ in range(40):
        simulation.step()
    launcher, lattice, lamp = simulation.launcher, simulation.plan.domains[0].lattice, simulation.plan.scene.lights[0]
    floor = np.stack(np.meshgrid(np.linspace(-3, 3, 200), [0.0], np.linspace(-3, 3, 200)), axis=-1).reshape(-1, 3)
    points = wp.array(floor, dtype=wp.vec3, device=launcher.device)

    def measure(light: ws.Light, **options: float) -> tuple[np.ndarray, float]:
        shadow = SMOKE_SHADOWS[light.smoke_shadow](launcher, lattice, light, ORIGIN, 9.0, **options)
        out = wp.full((1, len(floor)), 1.0, dtype=float, device=launcher.device)
        shadow.update(simulation.density, 1.0)
        shadow.transmittance(points, out)
        found = out.numpy()[0].copy()

        def again() -> None:
            shadow.update(simulation.density, 1.0)
            shadow.transmittance(points, out)

        return found, median_ms(again)

    truth, _ = measure(replace(lamp, smoke_shadow="ray_traced"), step=0.05)
    shadowed = truth < 0.999
    cases = [({"smoke_shadow": name}, name) for name in ("march", "nearest", "bilinear", "gaussian", "footprint")]
    cases += [
        ({"smoke_shadow": "dpd"}, "dpd"),
        ({"smoke_shadow": "dpd", "smoke_diffusion": 1.0}, "dpd, one sweep (r = 1)"),
        ({"smoke_shadow": "dpd", "smoke_compositing": "transmittance"}, "dpd, transmittance"),
        (
            {"smoke_shadow": "dpd", "smoke_projection": "rays", "smoke_compositing": "transmittance"},
            "dpd, true rays, transmittance",
        ),
    ]
    for diffuser in ("paper", "sweeps", "exact"):
        fields = {"smoke_shadow": "nearest", "smoke_diffusion": 1.0, "smoke_diffuser": diffuser}
        cases.append((fields, f"nearest, {diffuser} (r = 1)"))
    cases.append(({"smoke_shadow": "ray_traced"}, "ray_traced (½ cell)"))
    rows = []
    for fields, name in cases:
        found, ms = measure(replace(lamp, **fields))
        error = np.abs(found - truth)[shadowed]
        rows.append({"method": name, "mean_error": float(error.mean()), "max_error": float(error.max()), "ms": ms})
    return rows


def equation_3() -> list[dict]:
    """Compares one sweep with the implicit step that it approximates, for a point in the middle of 129² texels."""
    n = 129
    u = np.zeros((1, n, n), np.float32)
    u[0, n // 2, n // 2] = 1.0
    launcher, x = Launcher(), np.arange(n) - n // 2
    start = launcher.array(u, "start")
    rows = []
    for r in (0.05, 0.25, 1.0, 10.0):
        truth = implicit_step(u[0], r)

        def jacobi(sweeps: int, r: float = r) -> np.ndarray:
            return Diffusion(launcher, u.shape, r, "sweeps", sweeps).spread(start).numpy()[0].astype(float)

        paper = Diffusion(launcher, u.shape, r, "paper", None).spread(start).numpy()[0].astype(float)
        low, high = 0, 1024  # the least number of sweeps within 1e-3
        while high - low > 1:
            middle = (low + high) // 2
            if np.abs(jacobi(middle) - truth).sum() < 1e-3:
                high = middle
            else:
                low = middle
        kept = float(np.sum(paper.sum(axis=1) * x**2) / (2 * r))
        rows.append({"r": r, "variance_kept": kept, "l1": float(np.abs(paper - truth).sum()), "sweeps": high})
    return rows


def table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Returns a Markdown table."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, ("---",) * len(header), *rows))


def fill_in(document: str, name: str, text: str) -> str:
    """Replaces the text between the comments of a name."""
    begin, end = f"<!-- {name} -->", f"<!-- end {name} -->"
    before, _, rest = document.partition(begin)
    return f"{before}{begin}\n{text}\n{end}{rest.partition(end)[2]}"


def write_tables(measured: dict) -> None:
    """Writes the measurements into the document."""
    page = DOCS / "smoke_shadow.md"
    text = page.read_text(encoding="utf-8")
    rows = [
        (
            f"{row['grid']}³",
            f"{row['texture']}²",
            f"{row['paper_frame_ms']}",
            f"{row['frame_ms']:.1f}",
            f"{row['dpd_ms']:.2f} / {row['dpd_full_ms']:.2f}",
            f"{row['point_ms']:.2f} / {row['point_full_ms']:.2f}",
            f"{row['distant_ms']:.2f} / {row['distant_full_ms']:.2f} / {row['distant_empty_ms']:.2f}",
        )
        for row in measured["table_1"]
    ]
    header = ("grid", "texture", "paper, frame", "frame", "`dpd`", "`march`, point light", "`march`, distant light")
    note = f"Milliseconds, medians of {REPEATS} on {measured['machine']}."
    note += " Shadows alone: the plume of frame 40 / full of smoke / empty."
    text = fill_in(text, "table 1", f"{table(header, rows)}\n\n{note}")
    rows = [
        (f"{row['grid']}³, {row['axis']}", f"{row['distant_ms']:.2f}", f"{row['point_ms']:.2f}")
        for row in measured["axes"]
    ]
    text = fill_in(text, "axes", table(("grid, light along", "distant light, ms", "point light, ms"), rows))
    rows = [
        (each["method"], f"{each['mean_error']:.4f}", f"{each['max_error']:.3f}", f"{each['ms']:.2f}")
        for each in measured["methods"]
    ]
    text = fill_in(text, "methods", table(("method", "mean error", "largest error", "ms"), rows))
    rows = [
        (f"{row['r']:g}", f"{100 * row['variance_kept']:.2g} %", f"{row['l1']:.2f}", f"{row['sweeps']}")
        for row in measured["equation_3"]
    ]
    header = ("r", "variance kept", "L1 distance from the implicit step", "Jacobi sweeps to 10⁻³")
    page.write_text(fill_in(text, "equation 3", table(header, rows)), encoding="utf-8")


def figure_3() -> None:
    """Draws a light buffer of 64 × 48 texels for a volume of 32 × 48 × 32 cells, before and after one sweep."""
    scene = plume(48, None, "dpd")
    matrix = np.eye(4)
    matrix[3, :3] = 0, 1.2, 0
    box = {"lower": (-0.8, -1.2, -0.8), "upper": (0.8, 1.2, 0.8), "transform": matrix}
    simulation = ws.Simulation(replace(scene, domains=(replace(scene.domains[0], **box),)))
    for _ in range(36):
        simulation.step()
    lattice = simulation.plan.domains[0].lattice
    turn = np.eye(4)
    turn[:3, :3] = (0, 0, -1), (0, 1, 0), (1, 0, 0)
    pictures = []
    for r in (0.0, 1.0):
        light = DistantLight(path="/Sun", transform=turn, smoke_diffusion=r)
        shadow = DpdSmokeShadow(simulation.launcher, lattice, light, ORIGIN, 9.0, texels=(64, 48))
        shadow.update(simulation.density, 1.0)
        pictures.append(shadow.buffer().T[::-1])
    grey = np.hstack(pictures) / max(picture.max() for picture in pictures)
    picture = Image.fromarray(np.uint8(255 * (1 - grey)))
    picture.resize((6 * picture.width, 6 * picture.height), Image.Resampling.NEAREST).save(DOCS / "smoke_shadow_3.png")


def figure(scene: ws.Scene, frames: tuple[int, ...], name: str) -> None:
    """Draws four frames of a scene in one picture."""
    with tempfile.TemporaryDirectory() as folder:
        result = ws.run(scene, folder)
        pictures = []
        for frame in frames:
            file = Path(folder, f"{frame}.png")
            ws.preview(result, frame=frame, size=(400, 225), screenshot=file)
            pictures.append(Image.open(file).convert("RGB"))
        width, height = pictures[0].size
        sheet = Image.new("RGB", (2 * width, 2 * height))
        for index, picture in enumerate(pictures):
            sheet.paste(picture, (index % 2 * width, index // 2 * height))
        sheet.save(DOCS / name, optimize=True)


def main(parts: list[str]) -> None:
    """Runs all parts, or those named: measure, tables, figures."""
    measurements = DOCS / "smoke_shadow.json"
    if not parts or "measure" in parts:
        smoke = developed_plume()
        measured = {"machine": machine(), "equation_3": equation_3(), "methods": methods()}
        measured |= {"table_1": table_1(smoke), "axes": axes(smoke)}
        measurements.write_text(json.dumps(measured, indent=2) + "\n", encoding="utf-8")
    if not parts or {"measure", "tables"} & set(parts):
        write_tables(json.loads(measurements.read_text(encoding="utf-8")))
    if not parts or "figures" in parts:
        figure_3()
        scene = ws.Scene.open(ROOT / "stages/plume.usda")
        figure(replace(scene, end=200), (2, 20, 100, 200), "smoke_shadow_7.png")
        figure(ws.Scene.open(ROOT / "stages/cross.usda"), (12, 24, 36, 48), "smoke_shadow_8.png")


if __name__ == "__main__":
    main(sys.argv[1:])
