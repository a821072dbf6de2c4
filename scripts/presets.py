"""Measures the quality presets and their neighbours on this machine; writes warp_smoke/quality.json, docs/quality.md.

    python scripts/presets.py [smoke] [light] [picture]

With nothing set that presets set: the smoke of stages/obstacle.usda over its first frames against a finer run, the
floor of stages/plume.usda, plain, against rays to all of the light and through the smoke, and its picture against many
rays a pixel. Each family has many points, the presets among them by hand; a test keeps those from being dominated.
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
from warp_smoke.study.disclosure import disclose
from warp_smoke.study.outcome import differences, light_scene, run_scene

ROOT = Path(__file__).parents[1]
SMOKE_STAGE, LIGHT_STAGE = "stages/obstacle.usda", "stages/plume.usda"
FRAMES, REPEATS = 20, 3
COMPARED_TEXELS = 1024
VIEW = (320, 180)
SMOKE_FIELDS = ("resolution", "advection", "max_courant", "pressure_tolerance")
LIGHT_FIELDS = ("shadow_filter", "shadow_map_size", "smoke_shadow", "smoke_shadow_share", "texture_size")


def of_smoke(*values: object) -> dict[str, object]:
    """Settings of a domain."""
    return dict(zip(SMOKE_FIELDS, values, strict=True))


def of_light(*values: object) -> dict[str, object]:
    """Settings of lights and receivers."""
    return dict(zip(LIGHT_FIELDS, values, strict=True))


# Of each preset, in each family.
SMOKE = {
    "draft": of_smoke(32, "semi_lagrangian_cubic", 4.0, 1e-2),
    "preview": of_smoke(64, "semi_lagrangian_cubic", 2.0, 1e-2),
    "final": of_smoke(96, "semi_lagrangian_cubic", 1.0, 1e-3),
}
LIGHT = {
    "draft": of_light("exact", 512, "march", 2.0, 256),
    "preview": of_light("exact", 512, "march", 2.0, 512),
    "final": of_light("area", 512, "march", 2.0, 1024),
}
PICTURE = {"draft": {"samples": 1}, "preview": {"samples": 2}, "final": {"samples": 4}}


def with_presets(presets: Mapping[str, dict], others: Iterable[dict]) -> list[dict]:
    """The presets' settings and others, each once."""
    found: list[dict] = []
    for settings in (*presets.values(), *others):
        if settings not in found:
            found.append(settings)
    return found


def smoke_candidates() -> list[dict]:
    """Resolutions, schemes and steps; then tolerances."""
    schemes = ("semi_lagrangian", "semi_lagrangian_cubic", "maccormack", "bfecc")
    grid = [of_smoke(*each, 1e-3) for each in product((32, 48, 64, 96), schemes, (2.0, 4.0))]
    grid += [of_smoke(*each, 1.0, 1e-3) for each in product((64, 96), schemes[1::2])]
    grid += [of_smoke(*each) for each in product((32, 64), schemes[1:2], (4.0,), (1e-1, 1e-2, 1e-4))]
    return with_presets(SMOKE, grid)


def light_candidates() -> list[dict]:
    """Filters and maps, rays, buffers of the smoke's shadow, and textures."""
    smoke = ("march", 0.5), ("march", 1.0), ("march", 2.0), ("ray_traced", 1.0)
    surface = [*product(("hard", "pcf_disk", "pcss"), (256, 512)), ("pcss", 1024), ("exact", 512), ("area", 512)]
    # Each kind of shadow is varied around one of the other's.
    pairs = [(one, ("march", 2.0)) for one in surface] + [(("pcss", 512), each) for each in smoke]
    return with_presets(LIGHT, (of_light(*one, *other, n) for (one, other), n in product(pairs, (256, 512, 1024))))


def open_scene(stage: str) -> ws.Scene:
    """A stage's first frames, with nothing set that presets set, and plain surfaces of which the light is baked."""
    scene = ws.Scene.open(ROOT / stage)
    domains = [replace(domain, grids=("density",)) for domain in scene.domains]
    surfaces = [
        replace(s, material=None, receiver=s.receiver and replace(s.receiver, bake=("lit",))) for s in scene.surfaces
    ]
    return replace(scene, end=scene.start + FRAMES, domains=domains, surfaces=surfaces)


def with_smoke(scene: ws.Scene, settings: Mapping[str, object]) -> ws.Scene:
    """The smoke alone, by some settings."""
    surfaces = [replace(surface, receiver=None) for surface in scene.surfaces]
    domains = [replace(domain, **settings) for domain in scene.domains]
    return replace(scene, domains=domains, surfaces=surfaces, camera=None)


def with_light(scene: ws.Scene, settings: Mapping[str, object]) -> ws.Scene:
    """The scene with its lights and receivers by some settings."""
    cells = max(domain.resolution for domain in scene.domains)
    fields = {name: settings[name] for name in ("shadow_filter", "shadow_map_size", "smoke_shadow")}
    share = settings["smoke_shadow_share"]
    fields["smoke_shadow_size"] = None if share == 1.0 else round(cells * share)
    lights = []
    for light in scene.lights:
        wider = 2 if isinstance(light, ws.DistantLight) else 1  # as presets have it
        lights.append(replace(light, **fields | {"shadow_map_size": wider * settings["shadow_map_size"]}))
    size = settings["texture_size"]
    surfaces = [replace(s, receiver=s.receiver and replace(s.receiver, texture_size=size)) for s in scene.surfaces]
    return replace(scene, lights=lights, surfaces=surfaces)


def measure_smoke(launcher: Launcher) -> list[dict]:
    """The points of the smoke."""
    scene = open_scene(SMOKE_STAGE)
    best, _ = run_scene(launcher, with_smoke(scene, of_smoke(128, "bfecc", 1.0, 1e-5)), 1)
    run_scene(launcher, with_smoke(scene, SMOKE["draft"]), 1)  # warms up
    points = []
    for settings in smoke_candidates():
        outcome, measured = run_scene(launcher, with_smoke(scene, settings), REPEATS)
        error = differences(outcome, best)["density"]
        points.append(point(settings, error, measured.seconds, measured.cells, SMOKE))
    return points


def measure_light(launcher: Launcher, scene: ws.Scene, volumes: Mapping[str, SmokeVolume]) -> list[dict]:
    """The points of the baked light, everything made anew each time."""
    traced, _ = light_scene(launcher, with_light(scene, of_light("area", 512, "ray_traced", 1.0, 2048)), volumes, 0)
    truth = wide_pictures(traced.pictures)
    points = []
    for settings in light_candidates():
        outcome, measured = light_scene(launcher, with_light(scene, settings), volumes, REPEATS)
        error = float(np.sqrt(np.mean((wide_pictures(outcome.pictures) - truth) ** 2)))
        points.append(point(settings, error, measured.seconds, measured.cells, LIGHT))
    return points


def wide_pictures(pictures: Mapping[tuple[str, str], np.ndarray]) -> np.ndarray:
    """The baked pictures at one size, 0 to 1, as a renderer shows them between texels."""
    found = []
    for _, pixels in sorted(pictures.items()):
        for channel in np.moveaxis(pixels.astype(np.float32) / 255.0, 2, 0):
            size = (COMPARED_TEXELS, COMPARED_TEXELS)
            found.append(np.asarray(Image.fromarray(channel).resize(size, Image.Resampling.BILINEAR)))
    return np.stack(found)


def measure_picture(launcher: Launcher, scene: ws.Scene, volumes: Mapping[str, SmokeVolume]) -> list[dict]:
    """The points of the rendered picture."""

    def render(samples: int) -> Callable[[], np.ndarray]:
        renderer = PictureRenderer(launcher, scene, *VIEW, samples=samples)
        return lambda: renderer.render(scene.end, list(volumes.values())).astype(float) / 255.0

    truth, points = render(8)(), []
    for samples in (1, 2, 3, 4):
        action = render(samples)
        error, seconds = float(np.sqrt(np.mean((action() - truth) ** 2))), []
        for _ in range(REPEATS):
            began = perf_counter()
            action()
            seconds.append(perf_counter() - began)
        points.append(point({"samples": samples}, error, seconds, VIEW[0] * VIEW[1], PICTURE))
    return points


def names_of(settings: dict, presets: Mapping[str, dict]) -> list[str]:
    """The presets that have these settings."""
    return [name for name, each in presets.items() if each == settings]


def point(
    settings: dict, error: float, seconds: Sequence[float], items: int, presets: Mapping[str, dict]
) -> dict[str, object]:
    """One row of the measurements; `items` are cells, texels or pixels."""
    took = float(np.median(seconds))
    named = names_of(settings, presets)
    print(*named, *settings.values(), f"error {error:.4f}  {1e3 * took:.2f} ms", sep="  ", flush=True)
    return {
        "presets": named,
        "settings": settings,
        "error": round(error, 5),
        "milliseconds": round(1e3 * took, 3),
        "ns_per_item": round(1e9 * took / items, 1),
    }


def main(names: Sequence[str]) -> None:
    """Measures all families, or those named, and writes the file."""
    launcher, scene = Launcher("cpu"), open_scene(LIGHT_STAGE)
    file = ROOT / "warp_smoke/quality.json"
    families = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    lit = with_smoke(scene, SMOKE["preview"])
    scene = replace(scene, domains=lit.domains)

    def keep(name: str, stage: str, error: str, means: str, measure: Callable[[], list[dict]]) -> None:
        if not names or name in names:
            about = {"stage": stage, "machine": disclose(launcher), "error": error, "means": means}
            families[name] = about | {"points": measure()}

    keep(
        "smoke",
        SMOKE_STAGE,
        "density off by",
        f"relative L2 difference of the density after {FRAMES} frames to a run at resolution 128, bfecc, Courant "
        "number 1; milliseconds a frame, and ns for each cell",
        lambda: measure_smoke(launcher),
    )
    volumes = run_scene(launcher, lit, 0)[0].volumes
    keep(
        "light",
        LIGHT_STAGE,
        "baked light off by",
        f"root mean square difference (1 = black to white) of the lit texture, looked up on {COMPARED_TEXELS}² places, "
        "to one of 2048² texels by rays to all of each light and through the smoke; milliseconds for shadows and bake, "
        "all made anew, and ns for each texel",
        lambda: measure_light(launcher, scene, volumes),
    )
    keep(
        "picture",
        LIGHT_STAGE,
        "picture off by",
        f"root mean square difference (1 = black to white) of the picture of {VIEW[0]}x{VIEW[1]} pixels to one with 8² "
        "rays in each; milliseconds, and ns for each pixel",
        lambda: measure_picture(launcher, scene, volumes),
    )
    for name, presets in (("smoke", SMOKE), ("light", LIGHT), ("picture", PICTURE)):
        for each in families[name]["points"]:  # also of those that were measured before
            each["presets"] = names_of(each["settings"], presets)
    file.write_text(json.dumps(families, indent=1) + "\n", encoding="utf-8")
    write_tables(families)


def write_tables(families: Mapping[str, dict]) -> None:
    """Writes each family's presets and front into docs/quality.md."""
    page = ROOT / "docs/quality.md"
    text = page.read_text(encoding="utf-8")
    for name, family in families.items():
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
            f"On `{family['stage']}`, {machine['processor']}, {machine['threads']} threads, {machine['date']}. Error: "
            f"{family['means']}. Of {len(points)} settings those that another beats in both are left out."
        )
        begin, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        before, _, rest = text.partition(begin)
        text = "\n".join([before + begin, note, "", *lines, end + rest.partition(end)[2]])
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
