"""Small stages written as text, and the scenes that they hold."""

from pathlib import Path

import pytest

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
DOMAIN = """def Cube "Box" ( prepend apiSchemas = ["SmokeDomainAPI"] ) { double size = 4
%s }"""
EMITTER = """def Sphere "Source" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) { token purpose = "guide"
%s }"""


def write_stage(folder: Path, prims: str, header: str = HEADER) -> Path:
    """A stage file with some prims below /World; a brace may close on the last line of what it holds."""
    path = folder / "scene.usda"
    prims = prims.replace(" }", "\n}\n")
    path.write_text(f'{header}\ndef Xform "World"\n{{\n{prims}\n}}\n')
    return path


def scene_of(folder: Path, prims: str, header: str = HEADER) -> Scene:
    """The scene of a stage with some prims below /World."""
    return Scene.open(write_stage(folder, prims, header))


def line_of(folder: Path, prims: str, header: str = HEADER) -> str:
    """What is said of a bad stage, without its file."""
    with pytest.raises(ValueError, match="allowed") as error:
        scene_of(folder, prims, header)
    text = str(error.value)
    assert "\n" not in text
    assert text.startswith(f"{folder / 'scene.usda'}: ")
    return text.removeprefix(f"{folder / 'scene.usda'}: ")
