"""Makes the pictures of docs/shading.md in docs/shading/: each part of the light alone, and each kind of detail.

The still life is defined here, with materials from stages/columns.usda.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import warp_smoke as ws
from warp_smoke.files import write_png
from warp_smoke.picture import render_picture

ROOT = Path(__file__).parents[1]
SIZE, SAMPLES = (400, 300), 3
LOOKS = {
    surface.material.path.rpartition("/")[2]: surface.material
    for surface in ws.Scene.open(ROOT / "stages" / "columns.usda").surfaces
}
SKY = (0.05, 0.06, 0.08)


def look_at(eye: tuple, target: tuple) -> np.ndarray:
    """Returns a transform at `eye` whose −Z axis points to `target`, with Y up."""
    z = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    x = np.cross((0.0, 1.0, 0.0), z) / np.linalg.norm(np.cross((0.0, 1.0, 0.0), z))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = (x, np.cross(z, x), z), eye
    return matrix


def at(*position: float) -> np.ndarray:
    """Returns a translation."""
    matrix = np.eye(4)
    matrix[3, :3] = position
    return matrix


def camera(eye: tuple, target: tuple, focal_length: float = 35.0) -> ws.Camera:
    """Makes a camera with an aspect ratio of 4:3."""
    return ws.Camera(
        path="/Camera",
        transform=look_at(eye, target),
        focal_length=focal_length,
        horizontal_aperture=24.0,
        vertical_aperture=18.0,
        near=0.1,
    )


def surface(name: str, mesh: ws.Mesh, material: ws.Material, transform: np.ndarray | None = None) -> ws.Surface:
    """Makes one object of the still life."""
    return ws.Surface(
        path=f"/{name}", mesh=mesh, material=material, transform=np.eye(4) if transform is None else transform
    )


def bricks(repeats: float, **fields: object) -> ws.Material:
    """Returns the material of the columns' brick floor, repeated along each side."""
    material = LOOKS["Bricks"]
    names = ("diffuse_texture", "normal_texture", "height_texture", "roughness_texture")
    textures = {name: replace(getattr(material, name), uv_scale=(repeats, repeats)) for name in names}
    return replace(material, **textures | fields)


def still_life(**fields: object) -> ws.Scene:
    """Makes a banded ball, a metal one, a glowing one and a block on bricks, under a sun and a lamp."""
    ground = ws.Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))
    glow = ws.Material(path="/Glow", diffuse_color=(0.3, 0.12, 0.03), emissive_color=(0.9, 0.32, 0.06))
    turned = look_at((0, 0, 0), (0.5, 0, 1)) @ at(0.75, 0.4, -0.55)
    return ws.Scene(
        surfaces=[
            surface("Ground", ground, bricks(6.0)),
            surface("Banded", ws.Mesh.sphere(0.62), LOOKS["Banded"], at(-0.5, 0.62, 0.0)),
            surface("Block", ws.Mesh.box(0.8), LOOKS["Plinth"], turned),
            surface("Metal", ws.Mesh.sphere(0.3), LOOKS["Metal"], at(0.75, 1.1, -0.55)),
            surface("Glow", ws.Mesh.sphere(0.22), glow, at(0.45, 0.22, 0.75)),
        ],
        lights=[
            ws.DistantLight(
                path="/Sun",
                transform=look_at((-2, 3, 2.2), (0, 0, 0)),
                intensity=2.6,
                color=(1.0, 0.92, 0.8),
                angle=1.0,
            ),
            ws.PointLight(path="/Lamp", transform=at(2.2, 1.9, 1.6), intensity=28.0, color=(0.55, 0.7, 1.0)),
        ],
        camera=camera((0.3, 1.5, 4.2), (0.05, 0.52, 0.0)),
        **fields,
    )


def dressed(scene: ws.Scene, **fields: object) -> ws.Scene:
    """Returns the scene with some fields of every material changed."""
    surfaces = [replace(each, material=replace(each.material, **fields)) for each in scene.surfaces]
    return replace(scene, surfaces=surfaces)


def without_metal(scene: ws.Scene) -> ws.Scene:
    """Returns the scene with metal mixed into the colours of its plain materials: the same light, except ambient."""
    return replace(scene, surfaces=[replace(each, material=_mixed(each.material)) for each in scene.surfaces])


def _mixed(material: ws.Material) -> ws.Material:
    share, color = material.metallic, np.array(material.diffuse_color)
    mirrored = (1.0 - share) * np.array(material.fresnel_r0) + share * color
    return replace(
        material, metallic=0.0, diffuse_color=tuple((1.0 - share) * color), fresnel_r0=tuple(mirrored.tolist())
    )


def light_parts() -> Iterator[tuple[str, ws.Scene]]:
    """Yields each part of the light alone; the first one's sky is five times as bright as in the sum, to be visible."""
    scene = still_life()
    dark = {"emissive_color": (0.0, 0.0, 0.0)}
    black = {"diffuse_color": (0.0, 0.0, 0.0), "diffuse_texture": None, "procedural": None}
    yield "ambient", replace(dressed(scene, **dark), lights=[], ambient=tuple(5 * share for share in SKY))
    yield "diffuse", dressed(without_metal(scene), reflection="classic", fresnel_r0=(0.0, 0.0, 0.0), **dark)
    yield "specular", dressed(without_metal(scene), **black, **dark)
    yield "emissive", replace(scene, lights=[])
    yield "together", still_life(ambient=SKY)


def tessellation() -> Iterator[tuple[str, ws.Scene, str]]:
    """Yields coarse meshes, lit at their vertices and at each pixel."""
    plain = ws.Material(path="/Plain", diffuse_color=(0.12, 0.28, 0.26), fresnel_r0=(0.08, 0.08, 0.08), roughness=0.75)
    matte = ws.Material(path="/Matte", diffuse_color=(0.5, 0.47, 0.42), roughness=0.9)
    # Its self-shadow would follow the flat triangles, and hide the difference in shading.
    unshadowed = ws.Receiver(path="/Ball", bake=(), receive_shadow=False)
    ball = replace(surface("Ball", ws.Mesh.sphere(0.7, 20), plain, at(0.0, 0.7, 0.0)), receiver=unshadowed)
    scene = ws.Scene(
        surfaces=[surface("Ground", ws.Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4), 6), matte), ball],
        lights=[ws.PointLight(path="/Lamp", transform=at(0.9, 1.9, 1.1), intensity=42.0, color=(1.0, 0.95, 0.85))],
        ambient=SKY,
        camera=camera((0.0, 1.7, 4.0), (0.0, 0.5, 0.0), 38.0),
    )
    for shading in ("vertex", "pixel"):
        yield f"per_{shading}", scene, shading


def relief() -> Iterator[tuple[str, ws.Scene]]:
    """Yields bricks under grazing light, seen at a low angle: flat, with normals, shifted, and marched."""
    ground = ws.Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    sun = ws.DistantLight(
        path="/Sun", transform=look_at((-2.4, 1.0, -0.6), (0, 0, 0)), intensity=4.0, color=(1.0, 0.9, 0.75)
    )
    scene = ws.Scene(lights=[sun], ambient=SKY, camera=camera((0.15, 0.62, 2.6), (0.0, 0.0, 1.1), 30.0))
    heights = {"parallax_scale": 0.008, "parallax_bias": -0.008}
    for name, fields in (
        ("flat", {"normal_texture": None, "parallax": "none"}),
        ("normals", {"parallax": "none"}),
        ("parallax", {"parallax": "offset"} | heights),
        ("parallax_occlusion", {"parallax": "occlusion"} | heights),
    ):
        yield f"relief_{name}", replace(scene, surfaces=[surface("Ground", ground, bricks(4.0, **fields))])


def gloss() -> Iterator[tuple[str, ws.Scene]]:
    """Yields a ball without a gloss map, with one that sets the exponent, and with one that scales the highlight."""
    lights = [
        ws.PointLight(path=f"/Lamp{n}", transform=at(*place), intensity=power, color=color)
        for n, (place, power, color) in enumerate(
            (
                ((1.4, 1.8, 2.0), 40.0, (1.0, 0.9, 0.75)),
                ((-1.8, 1.2, 1.6), 22.0, (0.6, 0.75, 1.0)),
            )
        )
    ]
    ball = ws.Mesh.sphere(0.8)
    base = {"fresnel_r0": (0.25, 0.25, 0.25), "diffuse_color": (0.03, 0.09, 0.09), "roughness": 0.85}
    texture = LOOKS["Banded"].roughness_texture
    for name, fields in (
        ("off", {"roughness_texture": None}),
        ("exponent", {"roughness_texture": texture, "gloss": "exponent"}),
        ("factor", {"roughness_texture": texture, "gloss": "factor"}),
    ):
        material = replace(LOOKS["Banded"], **base | fields)
        upright = look_at((0, 0, 0), (0, -1, -1e-6))  # the poles of a sphere lie on its Z axis
        scene = ws.Scene(surfaces=[surface("Ball", ball, material, upright)], lights=lights, ambient=SKY)
        yield f"gloss_{name}", replace(scene, camera=camera((0.0, 0.5, 4.0), (0.0, 0.0, 0.0), 40.0))


def panes() -> Iterator[tuple[str, ws.Scene]]:
    """Yields panes of glass in front of each other and a ball, and a screen with holes cut by its opacity."""
    scene = still_life(ambient=SKY)
    ground, ball = scene.surfaces[:2]
    colors = (0.6, 0.08, 0.05), (0.7, 0.5, 0.05), (0.05, 0.2, 0.6)
    glass = [
        surface(
            f"Pane{n}",
            ws.Mesh.grid((-1.0 + 0.4 * n, 0.0, 1.1 - 0.2 * n), (0.7, 0, 0), (0, 0.7 + 0.15 * n, 0)),
            ws.Material(path=f"/Glass{n}", diffuse_color=color, opacity=0.45, fresnel_r0=(0.04,) * 3, roughness=0.3),
        )
        for n, color in enumerate(colors)
    ]
    file = ROOT / "stages" / "textures" / "checker.png"
    squares = ws.Texture(file=str(file), color_space="raw", channel="r", wrap_s="clamp", wrap_t="clamp")
    cut = ws.Material(path="/Cut", diffuse_color=(0.4, 0.3, 0.2), opacity_texture=squares, opacity_threshold=0.5)
    screen = surface("Screen", ws.Mesh.grid((0.5, 0.0, 0.3), (0.7, 0, 0), (0, 1.05, 0)), cut)
    # Panes and screen would cast the shadows of solid boards.
    lights = [replace(light, shadowed_by=("/Banded", "/Ground")) for light in scene.lights]
    yield "opacity", replace(scene, surfaces=[ground, ball, *glass, screen], lights=lights)


def figures() -> Iterator[tuple[str, ws.Scene, str]]:
    """Yields name, scene and shading of each picture."""
    for name, scene in (*light_parts(), *relief(), *gloss(), *panes()):
        yield name, scene, "pixel"
    yield from tessellation()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of pictures; all unless given")
    wanted = parser.parse_args().names
    for name, scene, shading in figures():
        if not wanted or name in wanted:
            picture = render_picture(scene, 1.0, size=SIZE, samples=SAMPLES, shading=shading)
            write_png(ROOT / "docs" / "shading" / f"{name}.png", picture)
