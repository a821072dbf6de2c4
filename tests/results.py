"""A set in centimetres with Z up, whose domain is turned and stretched, and results written over it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import warp_smoke as ws
from warp_smoke.files import write_png
from warp_smoke.lattice import Lattice, place_lattice
from warp_smoke.usd.volume import VolumeResult, write_volume
from warp_smoke.usd.write import BakeResult, write_results

SET = """#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 0.01
    upAxis = "Z"
    startTimeCode = 5
    endTimeCode = 7
    timeCodesPerSecond = 30
    framesPerSecond = 30
)

def Xform "World"
{
    double3 xformOp:translate = (10, -20, 30)
    float xformOp:rotateX = 25
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]

    def Mesh "Floor" (
        prepend apiSchemas = ["MaterialBindingAPI", "SmokeReceiverAPI"]
    )
    {
        uniform token[] smoke:bake = ["lit", "smokeShadow"]
        float3[] extent = [(-100, -100, 0), (100, 100, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-100, -100, 0), (100, -100, 0), (100, 100, 0), (-100, 100, 0)]
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]
        uniform token subdivisionScheme = "none"
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "vertex"
        )
        rel material:binding = </World/Looks/Grey>
    }

    def Scope "Looks"
    {
        def Material "Grey"
        {
            token outputs:surface.connect = </World/Looks/Grey/Surface.outputs:surface>

            def Shader "Surface"
            {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor = (0.5, 0.5, 0.5)
                token outputs:surface
            }
        }
    }

    def Cube "Box" (
        prepend apiSchemas = ["SmokeDomainAPI"]
    )
    {
        double size = 100
        float3[] extent = [(-50, -50, -50), (50, 50, 50)]
        int smoke:resolution = 8
        uniform token[] smoke:grids = ["density", "temperature", "velocity"]
        double3 xformOp:translate = (0, 0, 50)
        float xformOp:rotateZ = 30
        float3 xformOp:scale = (1, 0.5, 0.75)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ", "xformOp:scale"]
    }
}
"""


@dataclass
class Results:
    """What `write_all` wrote.

    Attributes:
        root: the root layer.
        scene, lattice: what was run, and the cells of its one domain.
        fields: for each frame, the density, temperature and velocity that went into its `.vdb`.
    """

    root: Path
    scene: ws.Scene
    lattice: Lattice
    fields: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]


def write_all(source: Path, folder: Path) -> Results:
    """Opens a stage and writes three frames of random results over it, the same ones each time."""
    scene = ws.Scene.open(source)
    (domain,), (floor,) = scene.domains, scene.surfaces
    lattice = place_lattice(scene, domain)
    random = np.random.default_rng(7)
    fields, volumes, pictures = {}, {}, {}
    for name in ("volumes", "textures"):
        (folder / name).mkdir(parents=True)
    for frame in scene.frames:
        density, temperature = random.random((2, *lattice.shape), np.float32)
        fields[frame] = density, temperature, random.random((*lattice.shape, 3), np.float32)
        volumes[frame] = f"./volumes/Box.{frame:04d}.vdb"
        write_volume(folder / volumes[frame], domain, lattice, *fields[frame])
        pictures[frame] = f"./textures/Floor.lit.{frame:04d}.png"
        write_png(folder / pictures[frame], random.integers(0, 256, (16, 16, 3), np.uint8))
    shadow = "./textures/Floor.smokeShadow.png"
    write_png(folder / shadow, random.integers(0, 256, (16, 16), np.uint8))
    root = write_results(
        folder,
        "set",
        scene,
        [VolumeResult(domain=domain, lattice=lattice, grids=domain.grids, files=volumes)],
        [
            BakeResult(surface=floor, bake="lit", files=pictures),
            BakeResult(surface=floor, bake="smokeShadow", files=shadow),
        ],
    )
    return Results(root, scene, lattice, fields)
