"""Measures the quality presets and their neighbours on this machine; writes warp_smoke/quality.json, docs/quality.md.

    python scripts/presets.py [smoke] [light] [picture]

Measured are the smoke of stages/obstacle.usda over its first frames against a finer run; the floor of stages/plume.usda
and the room of stages/room.usda, with plain surfaces, against rays to all of the light and through the smoke; and the
plume's picture against many rays a pixel. Each family has many points, from which the presets are chosen by hand; a
test ensures that no other point clearly beats a preset.
"""

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from time import perf_counter

import numpy as np
from PIL import Image

import warp_smoke as ws
from warp_smoke.launch import Launcher
from warp_smoke.picture import PictureRenderer, SmokeVolume
from warp_smoke.study.disclosure import BUSY, disclose
from warp_smoke.study.front import clearly_beats
from warp_smoke.study.outcome import differences, light_scene, run_scene

ROOT = Path(__file__).parents[1]
SMOKE_STAGE, LIGHT_STAGE, ROOM = "stages/obstacle.usda", "stages/plume.usda", "stages/room.usda"
FRAMES, REPEATS = 20, 5
# How often a preset and the points that seem to beat it are measured in turns.
TURNS = 3
COMPARED_TEXELS = 1024
VIEW = (320, 180)
# Returns the error, the seconds of each repeat, and the number of cells, texels or pixels.
Measure = Callable[[Mapping[str, object]], tuple[float, Sequence[float], int]]
SMOKE_FIELDS = ("resolution", "advection", "max_courant", "pressure_tolerance")
LIGHT_FIELDS = ("shadow_filter", "shadow_map_size", "smoke_shadow", "smoke_shadow_share", "texture_size")


def of_smoke(*values: object) -> dict[str, object]:
    """Returns settings of a domain."""
    return dict(zip(SMOKE_FIELDS, values, strict=True))


def of_light(*values: object) -> dict[str, object]:
    """Returns settings of lights and receivers."""
    return dict(zip(LIGHT_FIELDS, values, strict=True))


# The settings of each preset, in each family.
SMOKE = {
    "draft": of_smoke(32, "semi_lagrangian_cubic", 4.0, 1e-2),
    "preview": of_smoke(64, "semi_lagrangian_cubic", 2.0, 1e-2),
    "final": of_smoke(96, "semi_lagrangian_cubic", 1.0, 1e-3),
}
LIGHT = {
    "draft": of_light("exact", 512, "march", 2.0, 256),
    "preview": of_light("exact", 512, "march", 2.0, 512),
    "final": of_light("pcss", 1024, "march", 2.0, 1024),
}
PICTURE = {"draft": {"samples": 1}, "preview": {"samples": 2}, "final": {"samples": 4}}


# By family: where it is measured, and what its error and time mean.
ABOUT = {
    "smoke": {
        "stage": SMOKE_STAGE,
        "error": "density off by",
        "means": f"relative L2 difference of the density after {FRAMES} frames to a run at resolution 128, bfecc, "
        "Courant number 1; milliseconds a frame, and ns for each cell",
    },
    "light": {
        "stage": f"{LIGHT_STAGE} and {ROOM}",
        "error": "baked light off by",
        "means": "root mean square difference (1 = black to white) of the lit textures, looked up on "
        f"{COMPARED_TEXELS}² places, to ones of 2048² texels by rays to all of each light and through the smoke; "
        "milliseconds for shadows and bake of a stage, all made anew, in the mean, and ns for each texel",
    },
    "picture": {
        "stage": LIGHT_STAGE,
        "error": "picture off by",
        "means": f"root mean square difference (1 = black to white) of the picture of {VIEW[0]}x{VIEW[1]} pixels to "
        "one with 8² rays in each; milliseconds, and ns for each pixel",
    },
}


def with_presets(presets: Mapping[str, dict], others: Iterable[dict]) -> list[dict]:
    """Returns the presets' settings and others, each once."""
    found: list[dict] = []
    for settings in (*presets.values(), *others):
        if settings not in found:
            found.append(settings)
    return found


def smoke_candidates() -> list[dict]:
    """Returns settings that vary resolution, scheme and Courant number; then tolerance."""
    schemes = ("semi_lagrangian", "semi_lagrangian_cubic", "maccormack", "bfecc")
    grid = [of_smoke(*each, 1e-3) for each in product((32, 48, 64, 96), schemes, (2.0, 4.0))]
    grid += [of_smoke(*each, 1.0, 1e-3) for each in product((64, 96), schemes[1::2])]
    grid += [of_smoke(*each) for each in product((32, 64), schemes[1:2], (4.0,), (1e-1, 1e-2, 1e-4))]
    return with_presets(SMOKE, grid)


def light_candidates() -> list[dict]:
    """Returns settings that vary shadow filters and maps, smoke shadows, and texture sizes."""
    smoke = ("march", 0.5), ("march", 1.0), ("march", 2.0), ("ray_traced", 1.0)
    surface = [*product(("hard", "pcf_disk", "pcss"), (256, 512)), ("pcss", 1024), ("exact", 512), ("area", 512)]
    # Each kind of shadow is varied with the other kind fixed.
    pairs = [(one, ("march", 2.0)) for one in surface] + [(("pcss", 512), each) for each in smoke]
    return with_presets(LIGHT, (of_light(*one, *other, n) for (one, other), n in product(pairs, (256, 512, 1024))))


def open_scene(stage: str) -> ws.Scene:
    """Opens a stage's first frames, with plain surfaces whose lit pictures are baked."""
    scene = ws.Scene.open(ROOT / stage)
    domains = [replace(domain, grids=("density",)) for domain in scene.domains]
    surfaces = [
        replace(s, material=None, receiver=s.receiver and replace(s.receiver, bake=("lit",))) for s in scene.surfaces
    ]
    return replace(scene, end=scene.start + FRAMES, domains=domains, surfaces=surfaces)


def with_smoke(scene: ws.Scene, settings: Mapping[str, object]) -> ws.Scene:
    """Returns the scene with these settings for its smoke, without bakes."""
    surfaces = [replace(surface, receiver=None) for surface in scene.surfaces]
    domains = [replace(domain, **settings) for domain in scene.domains]
    return replace(scene, domains=domains, surfaces=surfaces, camera=None)


def with_light(scene: ws.Scene, settings: Mapping[str, object]) -> ws.Scene:
    """Returns the scene with these settings for its lights and receivers."""
    cells = max((domain.resolution for domain in scene.domains), default=0)
    fields = {name: settings[name] for name in ("shadow_filter", "shadow_map_size", "smoke_shadow")}
    share = settings["smoke_shadow_share"]
    fields["smoke_shadow_size"] = None if share == 1.0 or not cells else round(cells * share)
    lights = []
    for light in scene.lights:
        wider = 2 if isinstance(light, ws.DistantLight) else 1  # as presets have it
        lights.append(replace(light, **fields | {"shadow_map_size": wider * settings["shadow_map_size"]}))
    size = settings["texture_size"]
    surfaces = [replace(s, receiver=s.receiver and replace(s.receiver, texture_size=size)) for s in scene.surfaces]
    return replace(scene, lights=lights, surfaces=surfaces)


def smoke_measure(launcher: Launcher) -> Measure:
    """Returns a function that measures the smoke of a stage against a finer run."""
    scene = open_scene(SMOKE_STAGE)
    best, _ = run_scene(launcher, with_smoke(scene, of_smoke(128, "bfecc", 1.0, 1e-5)), 1)

    def measure(settings: Mapping[str, object]) -> tuple[float, Sequence[float], int]:
        outcome, measured = run_scene(launcher, with_smoke(scene, settings), REPEATS)
        return differences(outcome, best)["density"], measured.seconds, measured.cells

    measure(SMOKE["draft"])  # warms up
    return measure


def light_measure(launcher: Launcher, stages: Sequence[tuple[ws.Scene, Mapping[str, SmokeVolume]]]) -> Measure:
    """Returns a function that measures the baked light of stages with smoke against rays, all rebuilt each time."""
    best = of_light("area", 512, "ray_traced", 1.0, 2048)
    traced = [light_scene(launcher, with_light(scene, best), volumes, 0)[0] for scene, volumes in stages]
    truths = [wide_pictures(each.pictures) for each in traced]

    def measure(settings: Mapping[str, object]) -> tuple[float, Sequence[float], int]:
        squares, seconds, texels = [], np.zeros(REPEATS), 0
        for (scene, volumes), truth in zip(stages, truths, strict=True):
            outcome, measured = light_scene(launcher, with_light(scene, settings), volumes, REPEATS)
            squares.append(np.mean((wide_pictures(outcome.pictures) - truth) ** 2))
            seconds += np.array(measured.seconds) / len(stages)
            texels += measured.cells
        return float(np.sqrt(np.mean(squares))), seconds.tolist(), texels // len(stages)

    return measure


def wide_pictures(pictures: Mapping[tuple[str, str], np.ndarray]) -> np.ndarray:
    """Returns the baked pictures at one size, 0 to 1, interpolated between texels as in a renderer."""
    found = []
    for _, pixels in sorted(pictures.items()):
        for channel in np.moveaxis(pixels.astype(np.float32) / 255.0, 2, 0):
            size = (COMPARED_TEXELS, COMPARED_TEXELS)
            found.append(np.asarray(Image.fromarray(channel).resize(size, Image.Resampling.BILINEAR)))
    return np.stack(found)


def picture_measure(launcher: Launcher, scene: ws.Scene, volumes: Mapping[str, SmokeVolume]) -> Measure:
    """Returns a function that measures the rendered picture against one with many rays in each pixel."""

    def render(samples: int) -> Callable[[], np.ndarray]:
        renderer = PictureRenderer(launcher, scene, *VIEW, samples=samples)
        return lambda: renderer.render(scene.end, list(volumes.values())).astype(float) / 255.0

    truth = render(8)()

    def measure(settings: Mapping[str, object]) -> tuple[float, Sequence[float], int]:
        action = render(settings["samples"])
        error, seconds = float(np.sqrt(np.mean((action() - truth) ** 2))), []
        for _ in range(REPEATS):
            began = perf_counter()
            action()
            seconds.append(perf_counter() - began)
        return error, seconds, VIEW[0] * VIEW[1]

    return measure


def measure_points(candidates: Iterable[dict], presets: Mapping[str, dict], measure: Measure) -> list[dict]:
    """Measures the points of a family; where one seems to beat a preset, both are measured again."""
    points = []
    for settings in candidates:
        error, seconds, items = measure(settings)
        points.append({"presets": names_of(settings, presets), "settings": settings, "error": round(error, 5)})
        points[-1] |= times_of(float(np.median(seconds)), items)
        print_point(points[-1])
    for _ in range(TURNS):
        doubtful = {name: rivals for name in presets if (rivals := rivals_of(name, points))}
        for name, rivals in doubtful.items():
            print(f"again: {name}, and {len(rivals)} that seemed to beat it", flush=True)
            settle([preset_of(name, points), *rivals], measure)
    return points


def settle(points: Sequence[dict], measure: Measure) -> None:
    """Times points again in turns and keeps the shortest time of each: other work can only add to a time."""
    for _ in range(TURNS):
        for each in points:
            _, seconds, items = measure(each["settings"])
            again = times_of(float(np.median(seconds)), items)
            if again["milliseconds"] < each["milliseconds"]:
                each.update(again)
    for each in points:
        print_point(each)


def preset_of(name: str, points: Iterable[dict]) -> dict:
    """Returns the point of a preset."""
    return next(each for each in points if name in each["presets"])


def rivals_of(name: str, points: Sequence[dict]) -> list[dict]:
    """Returns the points that clearly beat a preset."""
    mine = preset_of(name, points)
    return [each for each in points if clearly_beats(*((one["error"], one["milliseconds"]) for one in (each, mine)))]


def names_of(settings: dict, presets: Mapping[str, dict]) -> list[str]:
    """Returns the presets that have these settings."""
    return [name for name, each in presets.items() if each == settings]


def times_of(seconds: float, items: int) -> dict[str, float]:
    """Returns a point's time, in total and per cell, texel or pixel."""
    return {"milliseconds": round(1e3 * seconds, 3), "ns_per_item": round(1e9 * seconds / items, 1)}


def print_point(each: Mapping) -> None:
    """Prints a point."""
    figures = f"error {each['error']:.4f}", f"{each['milliseconds']:.2f} ms"
    print(*each["presets"], *each["settings"].values(), *figures, sep="  ", flush=True)


def main(names: Sequence[str]) -> None:
    """Measures all families, or those named, and writes the files."""
    launcher, scene = Launcher("cpu"), open_scene(LIGHT_STAGE)
    machine, file = disclose(launcher), ROOT / "warp_smoke/quality.json"
    families = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    lit = with_smoke(scene, SMOKE["preview"])
    scene = replace(scene, domains=lit.domains)
    volumes = run_scene(launcher, lit, 0)[0].volumes
    every = {
        "smoke": (SMOKE, smoke_candidates(), lambda: smoke_measure(launcher)),
        "light": (
            LIGHT,
            light_candidates(),
            lambda: light_measure(launcher, [(scene, volumes), (open_scene(ROOM), {})]),
        ),
        "picture": (
            PICTURE,
            [{"samples": samples} for samples in (1, 2, 3, 4)],
            lambda: picture_measure(launcher, scene, volumes),
        ),
    }
    for name, (presets, candidates, prepare) in every.items():
        if not names or name in names:
            about = ABOUT[name] | {"machine": machine}
            families[name] = about | {"points": measure_points(candidates, presets, prepare())}
        for each in families[name]["points"]:  # also of those that were measured before
            each["presets"] = names_of(each["settings"], presets)
    file.write_text(json.dumps(families, indent=1) + "\n", encoding="utf-8")
    write_tables(families)
    for name, family in families.items():
        for preset in every[name][0]:
            for rival in rivals_of(preset, family["points"]):
                print(f"{name}: {preset} is clearly beaten by {rival['settings']}; pick another", file=sys.stderr)


def replace_between(text: str, name: str, lines: Iterable[str]) -> str:
    """Replaces the lines of a page between the comments of a name."""
    begin, end = f"<!-- {name} -->", f"<!-- end {name} -->"
    before, _, rest = text.partition(begin)
    return "\n".join([before + begin, *lines, end + rest.partition(end)[2]])


def busy_note(families: Mapping[str, dict]) -> list[str]:
    """Returns a warning if other work ran before measurements, or may have."""
    loads = {name: family["machine"].get("load before") for name, family in families.items()}
    if all(load is not None and load <= BUSY for load in loads.values()):
        return []
    found = ", ".join(f"{name} {'not known' if load is None else load}" for name, load in loads.items())
    return [
        "> **Busy machine.** Other work ran beside some of these measurements (load before: "
        f"{found}): compare times within a table, not with other pages. The errors do not depend on it."
    ]


def write_tables(families: Mapping[str, dict]) -> None:
    """Writes each family's presets and front into docs/quality.md."""
    page = ROOT / "docs/quality.md"
    text = replace_between(page.read_text(encoding="utf-8"), "busy", busy_note(families))
    for name, family in families.items():
        stages = " and ".join(f"`{stage}`" for stage in family["stage"].split(" and "))
        points, machine = sorted(family["points"], key=lambda each: each["milliseconds"]), family["machine"]
        header = ("preset", *points[0]["settings"], "error", "ms", "ns")
        lines = [f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
        least = float("inf")
        for each in points:
            if each["presets"] or each["error"] < least:
                named = ", ".join(f"**{preset}**" for preset in each["presets"])
                figures = f"{each['error']:.4f}", f"{each['milliseconds']:.1f}", f"{each['ns_per_item']:.0f}"
                lines.append(f"| {' | '.join((named, *map(str, each['settings'].values()), *figures))} |")
            least = min(least, each["error"])
        note = (
            f"On {stages}, {machine['processor']}, {machine['threads']} threads, {machine['date']}. Error: "
            f"{family['means']}. Of {len(points)} settings those that another beats in both are left out."
        )
        text = replace_between(text, name, [note, "", *lines])
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
