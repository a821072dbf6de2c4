"""Scenes written as stages: what is read again is equal."""

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from pxr import Usd, UsdGeom
from storable import scenes

from warp_smoke.geometry import Mesh
from warp_smoke.scene import (
    Emitter,
    Material,
    MaterialSubset,
    PointLight,
    Scene,
    SmokeDomain,
    Surface,
    Texture,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a picture in it."""
    folder = tmp_path_factory.mktemp("author")
    Image.new("RGB", (2, 2)).save(folder / "picture.png")
    return folder


@given(st.data())
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_round_trip(folder, data):
    """Any scene, written and read again, is equal to itself, with nothing to warn of but flat triangles."""
    scene = data.draw(scenes(folder / "picture.png"))
    suffix = data.draw(st.sampled_from(("usda", "usdc")))
    path = folder / f"scene.{suffix}"
    path.unlink(missing_ok=True)
    scene.save(path)
    read = Scene.open(path)
    assert read == scene
    assert all(warning.endswith("have no area") for warning in read.warnings)


def test_same_scene_gives_the_same_bytes(folder):
    """Nothing written twice differs."""
    ball = Mesh.sphere()
    scene = Scene(
        emitters=[Emitter(path=f"/World/E{n}", mesh=ball) for n in range(9)],
        surfaces=[Surface(path="/World/Ball", mesh=ball)],
    )
    for name in ("one.usda", "two.usda"):
        scene.save(folder / name)
    assert (folder / "one.usda").read_bytes() == (folder / "two.usda").read_bytes()


def test_empty_scene(folder):
    """A scene of nothing is a stage with a default prim."""
    Scene().save(folder / "empty.usda")
    assert Scene.open(folder / "empty.usda") == Scene()
    stage = Usd.Stage.Open(str(folder / "empty.usda"))
    assert stage.GetDefaultPrim().GetPath() == "/World"


def test_what_only_emits_or_collides_is_a_guide(folder):
    """An emitter that is no surface is not rendered; one that is, is."""
    ball = Mesh.sphere()
    Scene(
        emitters=[Emitter(path="/World/Seen", mesh=ball), Emitter(path="/World/Hidden", mesh=ball)],
        surfaces=[Surface(path="/World/Seen", mesh=ball)],
    ).save(folder / "guides.usda")
    stage = Usd.Stage.Open(str(folder / "guides.usda"))
    purposes = [
        UsdGeom.Imageable(stage.GetPrimAtPath(f"/World/{name}")).ComputePurpose() for name in ("Seen", "Hidden")
    ]
    assert purposes == ["default", "guide"]


def test_nothing_to_say_nothing_authored(folder):
    """Only what differs from the schema's defaults is written, so that files stay readable."""
    Scene(domains=[SmokeDomain(path="/World/Box", resolution=12)]).save(folder / "short.usda")
    stage = Usd.Stage.Open(str(folder / "short.usda"))
    prim = stage.GetPrimAtPath("/World/Box")
    assert [prop.GetName() for prop in prim.GetAuthoredPropertiesInNamespace("smoke")] == ["smoke:resolution"]


def test_textures_are_written_relative_to_the_file(folder):
    """A stage can be moved together with its textures."""
    texture = Texture(file=str(folder / "picture.png"))
    material = Material(path="/World/M", diffuse_texture=texture)
    (folder / "stages").mkdir()
    for place, written in (("a.usda", "@./picture.png@"), ("stages/a.usda", "@../picture.png@")):
        Scene(surfaces=[Surface(path="/World/A", mesh=Mesh.box(), material=material)]).save(folder / place)
        assert written in (folder / place).read_text()


BALL, BOX = Mesh.sphere(), Mesh.box()


@pytest.mark.parametrize(
    ("scene", "line"),
    [
        (
            Scene(emitters=[Emitter(path="/A", mesh=BALL)], surfaces=[Surface(path="/A", mesh=BOX)]),
            "/A: mesh is different among the records with this path; allowed: the same shape and place for all of them",
        ),
        (
            Scene(emitters=[Emitter(path="/A", mesh=BALL)], lights=[PointLight(path="/A")]),
            "/A: path is /A; allowed: one kind of thing at each path",
        ),
        (
            Scene(surfaces=[Surface(path="/A", mesh=BALL)], lights=[PointLight(path="/A/B/L")]),
            "/A/B/L: path is /A/B/L; allowed: a path that is not inside /A",
        ),
        (
            Scene(lights=[PointLight(path="/A light")]),
            "/A light: path is /A light; allowed: letters, digits and _ between slashes",
        ),
        (
            Scene(
                surfaces=[Surface(path=f"/A{n}", mesh=BALL, material=Material(path="/M", roughness=n)) for n in (0, 1)]
            ),
            "/M: path is /M; allowed: one kind of thing at each path",
        ),
    ],
)
def test_scenes_that_no_stage_can_hold(folder, scene, line):
    """Records that cannot stand on one stage are refused in one line, and no file is written."""
    with pytest.raises(ValueError, match="allowed") as error:
        scene.save(folder / "refused.usda")
    assert str(error.value) == line
    assert not (folder / "refused.usda").exists()


def test_materials_of_faces_and_metal_come_back(folder):
    """Face subsets with their materials, metal, opacity and textures of every kind are as they were."""
    Image.new("RGB", (2, 2)).save(folder / "picture.png")
    data = {"file": str(folder / "picture.png"), "color_space": "raw", "channel": "g"}
    metal = Material(
        path="/World/Metal",
        fresnel_r0=(0.04, 0.04, 0.04),
        metallic=0.5,
        occlusion=0.75,
        metallic_texture=Texture(**data),
        occlusion_texture=Texture(**data),
        emissive_texture=Texture(file=data["file"]),
    )
    glass = Material(
        path="/World/Glass", opacity=0.5, opacity_threshold=0.25, specular_texture=Texture(file=data["file"])
    )
    subset = MaterialSubset(path="/World/A/Top", triangles=[2, 3], material=metal)
    scene = Scene(surfaces=[Surface(path="/World/A", mesh=Mesh.box(), material=glass, subsets=[subset])])
    scene.save(folder / "faces.usda")
    assert Scene.open(folder / "faces.usda").surfaces == scene.surfaces
    with pytest.raises(ValueError, match=r"^/World/Metal: fresnel_r0 is .*allowed: grey"):
        replace_material(scene, replace(metal, fresnel_r0=(0.1, 0.2, 0.3))).save(folder / "refused.usda")


def replace_material(scene, material):
    """The scene with another material on its first subset."""
    (surface,) = scene.surfaces
    (subset,) = surface.subsets
    return replace(scene, surfaces=[replace(surface, subsets=[replace(subset, material=material)])])


def test_given_settings_come_back(folder):
    """What a stage sets is known, also at its default value, and is written again; what it leaves open is not."""
    domain = SmokeDomain(path="/Smoke", resolution=64, max_courant=2.0, given=frozenset({"resolution"}))
    light = PointLight(path="/Lamp", shadow_filter="pcss", given=frozenset({"shadow_filter"}))
    file = folder / "given.usda"
    Scene(domains=[domain], lights=[light]).save(file)
    scene = Scene.open(file)
    assert scene.domains[0].given == {"resolution", "max_courant"}
    assert scene.lights[0].given == {"shadow_filter"}
    assert scene.domains[0] == domain
