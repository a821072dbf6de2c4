"""Imports the results of a run into Blender, checks what arrived, renders it, and fills in docs/dcc.md.

    python scripts/blender_witness.py STAGE NAME

Needs `bpy`; `scripts/blender_check` makes an environment that has it. `NAME.json` and `NAME.npz` hold the expected
results (from `blender_expected.py`).
"""

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

ROOT = Path(__file__).parents[1]
PAGE, PICTURE = ROOT / "docs/dcc.md", ROOT / "docs/blender.png"
SIZE, SAMPLES = 128, 64
RAYS = 8  # along each side of a pixel, to average the floor's pictures over it
# Blender has Z up: it turns (x, y, z) into (x, -z, y).
TO_BLENDER = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
GRID_TYPES = {"density": "FLOAT", "temperature": "FLOAT", "vel": "VECTOR_FLOAT"}
# What Blender's importer makes of UsdLux: type, and watts of a point light with `normalize` or strength of a sun.
ENERGIES = {"SphereLight": ("POINT", math.pi), "DistantLight": ("SUN", 4.0)}
CORRELATION = 0.9
DARKER = 0.9


class Witness:
    """The questions asked and the answers seen.

    Attributes:
        rows: question and answer.
        failures: questions whose answer was not as expected.
    """

    def __init__(self):
        self.rows: list[tuple[str, str]] = []
        self.failures: list[str] = []

    def see(self, question: str, seen: str, as_expected: bool) -> None:
        """Records an answer."""
        print(f"{'ok  ' if as_expected else 'FAIL'} {question}: {seen}")
        self.rows.append((question, seen))
        if not as_expected:
            self.failures.append(question)


def open_stage(path: Path) -> None:
    """Imports a stage into an empty scene and sets up a small render, with a world, else smoke is invisible."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(path))
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.camera = next(each for each in scene.objects if each.type == "CAMERA")
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, False
    scene.cycles.pixel_filter_type = "BOX"  # each pixel covers only its own area, for comparison
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.view_settings.view_transform = "Standard"
    scene.frame_set(scene.frame_end)


def check_volume(witness: Witness, expected: dict) -> None:
    """Checks that the volume is a sequence with the frames, files and grids of the stage."""
    scene, (volume,) = bpy.context.scene, bpy.data.volumes
    first, last = expected["frames"]
    files = expected["volume"]["files"]
    seen = [scene.frame_start, scene.frame_end]
    witness.see("frames of the scene", f"{seen[0]} to {seen[1]}", seen == [first, last])
    sequence = (volume.is_sequence, volume.frame_start, volume.frame_duration)
    witness.see("volume", f"a sequence of {sequence[2]} frames", sequence == (True, first, last - first + 1))
    wrong, grids = [], {}
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        volume.grids.load()
        grids = {grid.name: grid.data_type for grid in volume.grids}
        name = Path(volume.grids.frame_filepath).name
        if grids != {field: GRID_TYPES[field] for field in files} or any(f[str(frame)] != name for f in files.values()):
            wrong.append(frame)
    seen = f"{', '.join(grids)}, in the file of the frame at each of {last - first + 1 - len(wrong)}"
    witness.see("grids", seen, not wrong)


def check_lights(witness: Witness, expected: dict) -> None:
    """Checks type, position or direction, colour and energy of each light that Blender imports."""
    for light in expected["lights"]:
        if light["type"] not in ENERGIES:
            found = light["name"] in bpy.data.lights or bpy.data.worlds.get(light["name"]) is not None
            witness.see(
                f"`{light['name']}`, a {light['type']} without a picture", "imported" if found else "not imported", True
            )
            continue
        placed = bpy.data.objects[light["name"]]
        kind, factor = ENERGIES[light["type"]]
        color = placed.data.color
        if kind == "SUN":
            there = placed.matrix_world.to_quaternion() @ Vector((0, 0, -1))
            aims, what = np.array(light["direction"]) @ TO_BLENDER, "along"
        else:
            there, aims, what = placed.matrix_world.translation, np.array(light["position"]) @ TO_BLENDER, "at"
        energy = placed.data.energy
        place = ", ".join(f"{value:.3f}" for value in there)
        right = np.allclose(there, aims, atol=1e-4) and np.allclose(color, light["color"], atol=1e-4)
        seen = (
            f"{placed.data.type}, energy {energy:.4g} = {energy / light['intensity']:.4g} × intensity, {what} ({place})"
        )
        right = right and placed.data.type == kind and math.isclose(energy, factor * light["intensity"], rel_tol=1e-4)
        witness.see(f"`{light['name']}`, a {light['type']}", seen, right)


def check_camera(witness: Witness, expected: dict) -> None:
    """Checks position, direction and angle of view."""
    camera = bpy.context.scene.camera
    there = np.array(camera.matrix_world.translation)
    along = np.array(camera.matrix_world.to_quaternion() @ Vector((0, 0, -1)))
    degrees = math.degrees(camera.data.angle_x)
    right = np.allclose(there, np.array(expected["camera"]["position"]) @ TO_BLENDER, atol=1e-4)
    right &= np.allclose(along, np.array(expected["camera"]["direction"]) @ TO_BLENDER, atol=1e-4)
    right &= math.isclose(degrees, expected["camera"]["degrees"], rel_tol=1e-4)
    place = ", ".join(f"{value:.3f}" for value in there)
    witness.see("camera", f"at ({place}), {degrees:.2f}° wide, aimed as on the stage", bool(right))


def check_texture(witness: Witness, expected: dict) -> None:
    """Checks that the baked picture is on the receiver, over its texture coordinates, as emission."""
    receiver = bpy.data.objects[expected["receiver"]["name"]]
    material = receiver.data.materials[0]
    picture = next(node for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    targets = [link.to_socket.name for link in material.node_tree.links if link.from_node == picture]
    name, space = Path(picture.image.filepath).name, picture.image.colorspace_settings.name
    right = (material.name, name, space) == (expected["receiver"]["material"], expected["receiver"]["picture"], "sRGB")
    shines = "Emission Color" in targets
    witness.see("look of the floor", f"`{name}` as {space}, into {', '.join(targets)}", right and shines)
    layer = receiver.data.uv_layers.get(expected["receiver"]["uv_name"])
    uvs = np.array([corner.uv for corner in layer.data]) if layer else np.zeros((0, 2))
    right = np.allclose(uvs, expected["receiver"]["uvs"], atol=1e-6) if len(uvs) else False
    witness.see("texture coordinates", f"`{layer.name}`, the stage's own" if layer else "none", right)


def render(path: Path) -> np.ndarray:
    """Renders to a PNG file; returns its linear RGB [row, column, 3], from the top."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(str(path))
    picture.colorspace_settings.name = "Non-Color"
    codes = np.array(picture.pixels[:]).reshape(SIZE, SIZE, -1)[::-1, :, :3]
    bpy.data.images.remove(picture)
    return to_linear(codes)


def to_linear(codes: np.ndarray) -> np.ndarray:
    """Decodes sRGB values in [0, 1] to linear light."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def camera_rays(per_side: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns origin [3] and directions [row, column, 3] of rays through evenly spaced points of the picture."""
    scene = bpy.context.scene
    camera = scene.camera
    corners = np.array(camera.data.view_frame(scene=scene))
    at = (np.arange(SIZE * per_side) + 0.5) / (SIZE * per_side)
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = np.meshgrid(low[0] + at * (high[0] - low[0]), high[1] - at * (high[1] - low[1]))
    local = np.stack([x, y, np.full_like(x, corners[0, 2])], axis=-1)
    matrix = np.array(camera.matrix_world)
    directions = local @ matrix[:3, :3].T
    return matrix[:3, 3], directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def seen_at(receiver: str) -> tuple[np.ndarray, np.ndarray]:
    """Finds pixels that show only the receiver, and pixels that show nothing, by 2 × 2 rays through each."""
    scene = bpy.context.scene
    graph = bpy.context.evaluated_depsgraph_get()
    origin, directions = camera_rays(2)
    names = np.array(
        [
            hit[4].name if (hit := scene.ray_cast(graph, Vector(origin), Vector(direction)))[0] else ""
            for direction in directions.reshape(-1, 3)
        ]
    ).reshape(SIZE, 2, SIZE, 2)
    return (names == receiver).all(axis=(1, 3)), (names == "").all(axis=(1, 3))


def picture_in_view(picture: np.ndarray, receiver: dict) -> np.ndarray:
    """Averages a picture [h, w, …] of a flat receiver over each pixel of the view; black beyond the picture's edges."""
    origin, directions = camera_rays(RAYS)
    points = np.array(receiver["points"]) @ TO_BLENDER
    height = points[0, 2]
    hit = origin + directions * ((height - origin[2]) / directions[..., 2])[..., None]
    plane = np.column_stack([points[:, :2], np.ones(len(points))])
    to_uv, *_ = np.linalg.lstsq(plane, np.array(receiver["uvs"]), rcond=None)
    uv = np.concatenate([hit[..., :2], np.ones((*hit.shape[:2], 1))], axis=-1) @ to_uv
    h, w = picture.shape[:2]
    inside = (uv >= 0).all(axis=-1) & (uv < 1).all(axis=-1) & (directions[..., 2] < 0)
    column = np.where(inside, uv[..., 0] * w, 0).astype(int)
    row = np.where(inside, (1 - uv[..., 1]) * h, 0).clip(0, h - 1).astype(int)
    values = np.where(inside.reshape(inside.shape + (1,) * (picture.ndim - 2)), picture[row, column], 0.0)
    return values.reshape(SIZE, RAYS, SIZE, RAYS, *picture.shape[2:]).mean(axis=(1, 3))


def smoke_in_view(density: np.ndarray, to_world: np.ndarray) -> np.ndarray:
    """Integrates density along the ray of each pixel [m at density 1], in steps of half a voxel."""
    origin, directions = camera_rays(1)
    to_blender = to_world.copy()
    to_blender[:, :3] = to_world[:, :3] @ TO_BLENDER
    to_index = np.linalg.inv(to_blender)
    start = np.append(origin, 1.0) @ to_index
    along = directions @ to_index[:3, :3]
    step = 0.5 / np.linalg.norm(along, axis=-1)
    middle = np.linalg.norm((np.array(density.shape) / 2 - start[:3]) @ to_blender[:3, :3])
    reach = np.linalg.norm(np.array(density.shape) @ to_blender[:3, :3]) / 2
    total = np.zeros((SIZE, SIZE))
    for distance in np.arange(middle - reach, middle + reach, step.min()):
        index = np.rint(start[:3] + along * distance).astype(int)
        inside = ((index >= 0) & (index < density.shape)).all(axis=-1)
        i, j, k = np.where(inside[..., None], index, 0).reshape(-1, 3).T
        total += np.where(inside, density[i, j, k].reshape(SIZE, SIZE), 0.0) * step.min()
    return total


def with_and_without_smoke(path: Path, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Renders a stage as it is, and with its smoke hidden."""
    open_stage(path)
    pictures = []
    for hidden in (False, True):
        for each in bpy.context.scene.objects:
            if each.type == "VOLUME":
                each.hide_render = hidden
        pictures.append(render(folder / f"{path.stem}_{'without' if hidden else 'with'}.png"))
    return pictures[0], pictures[1]


def check_pictures(witness: Witness, stage: Path, expected: dict, arrays: dict) -> None:
    """Checks that the smoke, its shadow and the texture are in the picture."""
    baked, bare = with_and_without_smoke(stage, stage.parent)
    floor, empty = seen_at(expected["receiver"]["name"])
    smoke = smoke_in_view(arrays["density"].astype(float), arrays["density_to_world"])
    change = np.abs(baked - bare).mean(axis=-1)
    behind = smoke > 0.02
    clear = smoke == 0.0
    alike = np.corrcoef(smoke[empty], change[empty])[0, 1]
    seen = f"correlation of the change by it with the density along each ray {alike:.3f}, before nothing else"
    witness.see("smoke in the picture", seen, alike > CORRELATION and behind[empty].sum() > 100)
    noise = change[empty & clear].max()
    witness.see(
        "where no smoke is", f"the change is {noise:.4f} at most, {change[empty].max():.3f} in the smoke", noise < 0.01
    )

    lit = picture_in_view(to_linear(arrays["lit"] / 255.0), expected["receiver"])
    error = np.sqrt(np.mean((bare - lit)[floor] ** 2))
    witness.see(
        "texture in the picture", f"rms difference from `lit` {error:.4f} over {floor.sum()} pixels", error < 0.01
    )

    shadow = picture_in_view(arrays["smokeShadow"] / 255.0, expected["receiver"])
    dark, light = floor & (shadow < 0.75) & clear, floor & (shadow > 0.99) & clear
    open_stage(stage)
    swap_picture(expected, expected["frames"][0])
    before = render(stage.parent / "first_picture.png")
    ratio = bare[..., 1] / np.maximum(before[..., 1], 1e-6)
    seen = f"light is {ratio[dark].mean():.2f} of that of the first frame, {ratio[light].mean():.2f} beside it"
    witness.see("baked shadow of the smoke", seen, ratio[dark].mean() < DARKER * ratio[light].mean())

    own, own_bare = with_and_without_smoke(stage.with_name(f"{stage.stem}_dcc.usda"), stage.parent)
    unclipped = own_bare[..., 1] < 0.99
    ratio = own[..., 1] / np.maximum(own_bare[..., 1], 1e-6)
    dark, light = dark & unclipped, light & unclipped
    shares = ratio[dark].mean(), ratio[light].mean()
    seen = f"where `smokeShadow` is dark, {shares[0]:.2f} of the light without smoke; {shares[1]:.2f} beside it"
    witness.see("Blender's own shadow of the smoke, look `dcc`", seen, shares[0] < shares[1] - 0.05)


def swap_picture(expected: dict, frame: int) -> None:
    """Shows the receiver's picture of another frame."""
    receiver = bpy.data.objects[expected["receiver"]["name"]]
    picture = next(node for node in receiver.data.materials[0].node_tree.nodes if node.type == "TEX_IMAGE")
    path = Path(picture.image.filepath)
    stem, _, _ = path.stem.rpartition(".")
    picture.image = bpy.data.images.load(str(path.with_name(f"{stem}.{frame:04d}.png")))
    for each in bpy.context.scene.objects:
        each.hide_render = each.type == "VOLUME"


def write_page(witness: Witness) -> None:
    """Writes the answers into docs/dcc.md."""
    text = PAGE.read_text(encoding="utf-8")
    begin, end = "<!-- blender -->", "<!-- end blender -->"
    before, _, rest = text.partition(begin)
    lines = [
        f"Blender {bpy.app.version_string}, {SIZE}² pixels, {SAMPLES} samples:",
        "",
        "| asked | seen |",
        "|---|---|",
    ]
    lines += [f"| {question} | {seen} |" for question, seen in witness.rows]
    page = before + "\n".join([begin, *lines, end]) + rest.partition(end)[2]
    PAGE.write_text(page, encoding="utf-8")


def show_pictures(folder: Path, names: tuple[str, ...]) -> None:
    """Joins renders side by side, each pixel enlarged to three by three, into one picture."""
    parts = []
    for name in names:
        picture = bpy.data.images.load(str(folder / name))
        parts.append(np.array(picture.pixels[:], np.float32).reshape(SIZE, SIZE, 4).repeat(3, axis=0).repeat(3, axis=1))
    joined = np.concatenate(parts, axis=1)
    height, width = joined.shape[:2]
    picture = bpy.data.images.new("joined", width, height)
    picture.pixels = joined.ravel()
    picture.filepath_raw, picture.file_format = str(PICTURE), "PNG"
    picture.save()


def main(stage: Path, name: str) -> int:
    """Checks, renders, and writes the page; returns 1 if anything is not as expected."""
    expected = json.loads(Path(f"{name}.json").read_text())
    witness = Witness()
    open_stage(stage)
    check_volume(witness, expected)
    check_texture(witness, expected)
    check_lights(witness, expected)
    check_camera(witness, expected)
    check_pictures(witness, stage, expected, dict(np.load(f"{name}.npz")))
    if witness.failures:
        print(f"Not as expected: {', '.join(witness.failures)}", file=sys.stderr)
        return 1
    show_pictures(stage.parent, (f"{stage.stem}_with.png", f"{stage.stem}_dcc_with.png"))
    write_page(witness)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), sys.argv[2]))
