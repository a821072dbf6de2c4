"""Times surface shadows: rays against Embree, the entire cube-map pass, filters, and a baked floor with two lights.

Usage: python scripts/benchmark_shadows.py [--threads N] [--size N] [--json FILE]; the comparison with Embree needs
`pip install embreex`. Embree runs on one thread, so the default is one thread for both. Times are the best of several
runs. The results go into docs/shadows.md and docs/shadows.json.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp
from smoke_shadow_paper import fill_in, machine, table

import warp_smoke as ws
from warp_smoke.geometry import corner_normals, transform_points
from warp_smoke.launch import Launcher, Rows
from warp_smoke.shadow.casters import Casters, nearest_hit
from warp_smoke.shadow.coverage import CUBE_FRAMES, TILE, frame_along
from warp_smoke.shadow.methods import SURFACE_SHADOWS
from warp_smoke.study.shadow_scenes import bunny

wp.set_module_options({"enable_backward": False})

ROOT = Path(__file__).parents[1]
FILTERS = ("hard", "pcf_grid", "pcf_disk", "pcss", "exact", "area")
FLOOR_FILTERS = ("hard", "exact", "pcss")
REPEATS = 5


@wp.kernel
def _trace_all(
    rows: Rows, mesh: wp.uint64, start: wp.vec3, directions: wp.array[wp.vec3], distance_out: wp.array[float]
):
    """distance[n] = nearest hit along directions[n], or −1."""
    n = rows.first + wp.tid()
    distance_out[n] = nearest_hit(mesh, start, directions[n], 1.0e6, 0.0)


def best_of(*runs: Callable[[], object], repeats: int = REPEATS) -> list[float]:
    """Measures the least time of each run, in turns, so that all see the same load; the first turn is not counted."""
    times = [[] for _ in runs]
    for _ in range(repeats + 1):
        for run, taken in zip(runs, times, strict=True):
            began = perf_counter()
            run()
            taken.append(perf_counter() - began)
    return [min(taken[1:]) for taken in times]


def scenes() -> dict[str, ws.Scene]:
    """Returns the example room, and the bunny above a floor with one point light."""
    animal = ws.Surface(path="/Bunny", mesh=bunny())
    floor = ws.Surface(path="/Floor", mesh=ws.Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8)), receiver=_receiver())
    lamp = ws.PointLight(path="/Lamp", transform=_at(1.5, 3.0, 1.2), radius=0.05)
    return {
        "room": ws.Scene.open(ROOT / "stages/room.usda"),
        "bunny": ws.Scene(surfaces=[animal, floor], lights=[lamp]),
    }


def _receiver() -> ws.Receiver:
    return ws.Receiver(path="/Floor", texture_size=1024)


def _at(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[3, :3] = x, y, z
    return matrix


def _shining(*direction: float) -> np.ndarray:
    """Returns a transform whose −Z axis points along a direction."""
    matrix = np.eye(4)
    matrix[:3, :3] = frame_along(np.array(direction) / np.linalg.norm(direction)) * [[1.0], [-1.0], [-1.0]]
    return matrix


def _receivers(scene: ws.Scene) -> np.ndarray:
    boxes = [
        transform_points(s.transform_at(scene.start), s.mesh.points_at(scene.start))
        for s in scene.surfaces
        if s.receiver is not None
    ]
    return np.array([[points.min(axis=0), points.max(axis=0)] for points in boxes])


def cube_directions(size: int) -> np.ndarray:
    """Returns unit directions through all texels of a cube map, tile by tile, [n, 3] float32."""
    steps = (np.arange(size) + 0.5) / size * 2 - 1
    t, s = (a.reshape(size // TILE, TILE, size // TILE, TILE).swapaxes(1, 2) for a in np.meshgrid(steps, steps)[::-1])
    local = np.stack([s.ravel(), t.ravel(), np.ones(size * size)], axis=1)
    directions = (local @ CUBE_FRAMES).reshape(-1, 3)
    return (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


def compare_with_embree(launcher: Launcher, scene: ws.Scene, size: int) -> dict[str, float]:
    """Times all texels of a cube map by Warp's hierarchy, by the map's tiles and by Embree, then the required map."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    origin = np.zeros(3)
    casters = Casters(launcher, scene.surfaces, origin)
    casters.update(scene.start)
    light = replace(scene.lights[0], shadow_map_size=size, shadow_filter="hard")
    embree = EmbreeScene(robust=True)
    TriangleMesh(embree, casters.mesh.points.numpy().reshape(-1, 3, 3))
    directions = cube_directions(size)
    starts = np.tile(light.position_at(scene.start).astype(np.float32), (len(directions), 1))
    rays = wp.array(directions, dtype=wp.vec3)
    distance = wp.zeros(len(rays), dtype=float)
    shadow = SURFACE_SHADOWS["cube"](launcher, light, casters, _receivers(scene))

    def trace_map() -> None:
        casters.version += 1
        shadow.update(scene.start)

    shadow.update(scene.start)
    every = np.ones(shadow.map.deepest.shape, bool)
    start = wp.vec3(*starts[0].tolist())

    hierarchy, tiles, theirs, whole = best_of(
        lambda: launcher.launch_each(_trace_all, len(rays), casters.mesh.id, start, rays, distance),
        lambda: shadow.trace(every),
        lambda: embree.run(starts, directions, query="DISTANCE"),
        trace_map,
        repeats=9,
    )
    return {
        "rays": len(rays),
        "rays_of_map": shadow.rays,
        "hierarchy_ms": 1e3 * hierarchy,
        "tiles_ms": 1e3 * tiles,
        "embree_ms": 1e3 * theirs,
        "map_ms": 1e3 * whole,
        "hierarchy_over_embree": hierarchy / theirs,
        "tiles_over_embree": tiles / theirs,
        "map_over_embree": whole / theirs,
    }


def measure_filters(launcher: Launcher, scene: ws.Scene, texels: int = 512) -> list[dict[str, float | str]]:
    """Measures time and error of each filter on the scene's floor, against a sharp and a soft reference.

    The sharp reference is the mean of 4 × 4 exact rays in each texel of the floor, the soft one the light's area.
    """
    bounds = _receivers(scene)
    lower, upper = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    origin = 0.5 * (lower + upper)
    casters = Casters(launcher, scene.surfaces, origin)
    casters.update(scene.start)
    bounds = bounds - origin

    def points(count: int) -> tuple[wp.array, wp.array]:
        step = (np.arange(count) + 0.5) / count
        x, z = np.meshgrid(lower[0] + step * (upper - lower)[0], lower[2] + step * (upper - lower)[2])
        place = np.stack([x.ravel(), np.full(count**2, lower[1]), z.ravel()], axis=1) - origin
        up = np.tile(np.float32([0, 1, 0]), (count**2, 1))
        return wp.array(place.astype(np.float32), dtype=wp.vec3), wp.array(up, dtype=wp.vec3)

    def look_up(name: str, at: tuple[wp.array, wp.array]) -> tuple[np.ndarray, float, float]:
        light = replace(scene.lights[0], shadow_filter=name)
        kind = name if name in SURFACE_SHADOWS else "cube"
        shadow = SURFACE_SHADOWS[kind](launcher, light, casters, bounds)
        out = wp.zeros(len(at[0]), dtype=float)

        def trace() -> None:
            casters.version += 1
            shadow.update(scene.start)

        repeats = 1 if name == "area" else REPEATS
        return out, *best_of(trace, lambda: shadow.visibility(*at, out), repeats=repeats)

    at = points(texels)
    fine = look_up("exact", points(4 * texels))[0].numpy()
    truth = {
        "sharp": fine.reshape(texels, 4, texels, 4).mean(axis=(1, 3)).ravel(),
        "soft": look_up("area", at)[0].numpy(),
    }
    rows = []
    for name in FILTERS:
        out, trace, look = look_up(name, at)
        row = {"filter": name, "trace_ms": 1e3 * trace, "look_up_ms": 1e3 * look}
        rows.append(row | {f"error_{kind}": float(np.abs(out.numpy() - t).mean()) for kind, t in truth.items()})
    return rows


def bake_floor(threads: int | None, name: str) -> float:
    """Times a 1024² floor under the bunny and two lights, from shadows to pixels: first frame, kernels loaded [s]."""
    scene = scenes()["bunny"]
    lights = [
        replace(scene.lights[0], shadow_filter=name),
        ws.DistantLight(path="/Sun", transform=_shining(0.0, -1.0, 0.0), shadow_filter=name),
    ]
    plan = ws.make_plan(replace(scene, lights=lights, end=1))
    times = []
    for _ in range(REPEATS):
        simulation = ws.Simulation(plan, threads=threads)
        began = perf_counter()
        simulation.step()
        times.append(perf_counter() - began)
    return min(times)


def compare_hierarchies(launcher: Launcher, scene: ws.Scene, size: int) -> dict[str, float]:
    """Times all texels of a cube map for each constructor and leaf size of Warp's bounding volume hierarchy [ms]."""
    casters = Casters(launcher, scene.surfaces, np.zeros(3))
    casters.update(scene.start)
    rays = wp.array(cube_directions(size), dtype=wp.vec3)
    start = wp.vec3(*scene.lights[0].position_at(scene.start).tolist())
    distance = wp.zeros(len(rays), dtype=float)
    points, indices = casters.mesh.points, casters.mesh.indices
    meshes = {
        f"{constructor}, {leaf}": wp.Mesh(points, indices, bvh_constructor=constructor, bvh_leaf_size=leaf)
        for constructor in ("sah", "median", "cubql")
        for leaf in (1, 2, 4, 8)
    }
    args = (start, rays, distance)
    times = best_of(
        *(lambda mesh=mesh: launcher.launch_each(_trace_all, len(rays), mesh.id, *args) for mesh in meshes.values()),
        repeats=3,
    )
    return {name: 1e3 * time for name, time in zip(meshes, times, strict=True)}


def measure_bias(launcher: Launcher) -> list[dict[str, float]]:
    """Measures errors of hard shadows with the default bias, for the bunny above a floor.

    Acne: share of the bunny's points visible from the light's centre that are dark. Leak: share of the floor's points
    hidden from all of the light that are lit.
    """
    scene = scenes()["bunny"]
    bunny, floor = scene.surfaces
    lights = {"point": scene.lights[0], "distant": ws.DistantLight(path="/Sun", transform=_shining(-1.0, -2.0, -0.8))}
    casters = Casters(launcher, scene.surfaces, np.zeros(3))
    casters.update(scene.start)
    rng, points = np.random.default_rng(0), bunny.mesh.points_at(scene.start)
    corners = points[bunny.mesh.triangles].astype(float)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rng.choice(len(area), 100_000, p=area / area.sum())
    place = np.einsum("nc,ncx->nx", rng.dirichlet((1, 1, 1), len(chosen)), corners[chosen])
    normals = corner_normals(points, bunny.mesh.triangles)[chosen, 0]
    below = rng.uniform((-3.5, 0, -3), (1, 0, 1), (100_000, 3))
    up = np.tile((0.0, 1.0, 0.0), (len(below), 1))
    bounds = np.array([[each.min(axis=0), each.max(axis=0)] for each in (points, floor.mesh.points_at(scene.start))])

    def share_lit(light: ws.Light, name: str, at: np.ndarray, facing: np.ndarray) -> np.ndarray:
        shadow_map = "directional" if isinstance(light, ws.DistantLight) else "cube"
        kind = name if name in SURFACE_SHADOWS else shadow_map
        shadow = SURFACE_SHADOWS[kind](launcher, replace(light, shadow_filter=name), casters, bounds)
        shadow.update(scene.start)
        out = wp.zeros(len(at), dtype=float)
        shadow.visibility(*(wp.array(a.astype(np.float32), dtype=wp.vec3) for a in (at, facing)), out)
        return out.numpy()

    rows = []
    for kind, light in lights.items():
        reached = share_lit(light, "exact", place, normals) == 1.0
        dark = share_lit(light, "area", below, up) == 0.0
        for size in (256, 512, 1024, 2048):
            sized = replace(light, shadow_map_size=size)
            acne = np.mean(share_lit(sized, "hard", place[reached], normals[reached]) == 0.0)
            leak = np.mean(share_lit(sized, "hard", below[dark], up[dark]) == 1.0)
            rows.append({"light": kind, "size": size, "acne": float(acne), "leak": float(leak)})
    return rows


def write_tables(report: dict) -> None:
    """Writes the measurements into docs/shadows.md."""
    page = ROOT / "docs/shadows.md"
    text = page.read_text(encoding="utf-8")
    header = ("filter", "sharp error", "soft error", "map, ms", "look-up, ms")
    keys = ("error_sharp", "error_soft", "trace_ms", "look_up_ms")
    rows = [
        (f"`{row['filter']}`", *(f"{row[key]:.4f}" if "error" in key else f"{row[key]:.1f}" for key in keys))
        for row in report["filters"]["room"]
    ]
    text = fill_in(text, "filters", table(header, rows))
    rows = [
        (row["light"], str(row["size"]), f"{100 * row['acne']:.2f} %", f"{100 * row['leak']:.2f} %")
        for row in report["bias"]
    ]
    text = fill_in(text, "bias", table(("light", "texels", "bunny darkened", "floor that leaks"), rows))
    times = report["floor_ms"]
    header = ("filter", *(f"{threads}, ms" for threads in times))
    rows = [(f"`{name}`", *(f"{times[threads][name]:.0f}" for threads in times)) for name in FLOOR_FILTERS]
    text = fill_in(text, "floor", table(header, rows))
    if report["embree"]:
        header = (
            *("scene", "Embree, ms", "hierarchy, ms", "to Embree", "as maps are traced, ms", "to Embree"),
            *("rays of the map", "the map, ms", "to Embree"),
        )
        rows = [
            (
                name,
                f"{row['embree_ms']:.0f}",
                f"{row['hierarchy_ms']:.0f}",
                f"{row['hierarchy_over_embree']:.2f}",
                f"{row['tiles_ms']:.0f}",
                f"{row['tiles_over_embree']:.2f}",
                f"{row['rays_of_map'] / 1e6:.2f} of {row['rays'] / 1e6:.2f} million",
                f"{row['map_ms']:.0f}",
                f"{row['map_over_embree']:.2f}",
            )
            for name, row in report["embree"].items()
        ]
        text = fill_in(text, "embree", table(header, rows))
    names = tuple(report["hierarchies"])
    rows = [
        (name, *(f"{report['hierarchies'][scene][name]:.0f}" for scene in names))
        for name in report["hierarchies"]["room"]
    ]
    text = fill_in(text, "hierarchies", table(("constructor, leaf", *(f"{name}, ms" for name in names)), rows))
    page.write_text(text, encoding="utf-8")


def main() -> None:
    """Measures, prints the report, and writes it as JSON and into docs/shadows.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=1, help="for all but the floor")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--json", type=Path, default=ROOT / "docs/shadows.json")
    options = parser.parse_args()
    launcher = Launcher("cpu", options.threads)
    report = {"machine": machine(), "threads": options.threads, "size": options.size, "embree": {}, "hierarchies": {}}
    for name, scene in scenes().items():
        report["hierarchies"][name] = compare_hierarchies(launcher, scene, options.size)
        try:
            report["embree"][name] = compare_with_embree(launcher, scene, options.size)
        except ImportError:
            print("Without embreex there is no comparison: pip install embreex")
    report["filters"] = {"room": measure_filters(launcher, scenes()["room"])}
    report["bias"] = measure_bias(launcher)
    report["floor_ms"] = {
        name: {each: 1e3 * bake_floor(threads, each) for each in FLOOR_FILTERS}
        for name, threads in (("1 thread", 1), (f"all {Launcher('cpu').threads} threads", None))
    }
    text = json.dumps(report, indent=2)
    print(text)
    options.json.write_text(text + "\n", encoding="utf-8")
    write_tables(report)


if __name__ == "__main__":
    main()
