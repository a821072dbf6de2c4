"""Small stages written as text, and the scenes that they hold."""

from pathlib import Path

from warp_smoke.scene import Scene

HEADER = """#usda 1.0
(
    defaultPrim = "World"
    startTimeCode = 1
    endTimeCode = 4
    timeCodesPerSecond = 24
    metersPerUnit = 1
    upAxis = "Y"
)
"""

QUAD = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""


def write_stage(folder: Path, prims: str, header: str = HEADER) -> Path:
    """A stage file with some prims below /World; a brace may close on the last line of what it holds."""
    path = folder / "scene.usda"
    prims = prims.replace(" }", "\n}\n")
    path.write_text(f'{header}\ndef Xform "World"\n{{\n{prims}\n}}\n')
    return path


def scene_of(folder: Path, prims: str, header: str = HEADER) -> Scene:
    """The scene of a stage with some prims below /World."""
    return Scene.open(write_stage(folder, prims, header))
