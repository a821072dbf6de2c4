from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from pxr import Usd, UsdGeom

from warp_smoke.geometry import Mesh, normalized
from warp_smoke.material import GLOSS_ROLES, PARALLAXES, PROCEDURALS, REFLECTIONS
from warp_smoke.record import Samples
from warp_smoke.scene import (
    ADVECTION_SCHEMES,
    AXES,
    BAKES,
    BOUNDARIES,
    DIFFUSION_SOLVERS,
    FALLOFF_MODELS,
    GRIDS,
    PRESSURE_SOLVERS,
    SHADOW_FILTERS,
    SMOKE_COMPOSITINGS,
    SMOKE_DIFFUSERS,
    SMOKE_PROJECTIONS,
    SMOKE_SHADOWS,
    SOURCES,
    WRAP_MODES,
    Camera,
    Collider,
    DistantLight,
    Emitter,
    Material,
    MaterialSubset,
    PointLight,
    Procedural,
    Receiver,
    Scene,
    SmokeDomain,
    SpotLight,
    Surface,
    Texture,
)


def numbers(low=-1e6, high=1e6):
    """Numbers as people write them: those that single precision keeps, since most USD attributes are float."""
    single = st.floats(np.float32(low).item(), np.float32(high).item(), width=32, allow_subnormal=False)
    return single.map(as_written).filter(lambda number: low <= number <= high)


def as_written(number):
    """The shortest decimal that single precision stores as this number."""
    return float(str(np.float32(number)))


def vectors(size, elements):
    """Tuples of so many numbers."""
    return st.tuples(*[elements] * size)


@st.composite
def changing(draw, values):
    """Samples that do vary, at quarters of time codes."""
    times = draw(st.lists(st.integers(-40, 400), min_size=2, max_size=4, unique=True))
    samples = np.array([draw(values) for _ in times])
    if np.all(samples == samples[0]):
        if samples.ndim == 3:
            samples[-1, 3, :3] += 1  # of a matrix: moved, not sheared
        else:
            samples[-1] = ~samples[-1] if samples.dtype == bool else np.vectorize(as_written)(samples[-1] + 1)
    return Samples(np.sort(times) / 4, samples)


@st.composite
def matrices(draw):
    """Boxes turned by right angles, scaled, mirrored and moved; any double precision numbers."""
    sizes = draw(vectors(3, st.floats(0.01, 100).flatmap(lambda size: st.sampled_from((size, -size)))))
    matrix = np.zeros((4, 4))
    matrix[range(3), draw(st.permutations(range(3)))] = sizes
    matrix[3] = *draw(vectors(3, st.floats(-1e6, 1e6))), 1.0
    return matrix


transforms = matrices() | changing(matrices()) | st.just(np.eye(4))


@st.composite
def meshes(draw):
    """Any triangles over a few points, moving or not, with or without normals and texture coordinates."""
    count = draw(st.integers(3, 6))
    triangles = draw(st.lists(vectors(3, st.integers(0, count - 1)), min_size=1, max_size=5))
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    points = rng.normal(size=(count, 3)).astype(np.float32)
    if draw(st.booleans()):
        points = Samples([1, 2.5], np.stack([points, points + 1]))
    normals = normalized(rng.normal(size=(len(triangles), 3, 3))) if draw(st.booleans()) else None
    uvs = rng.normal(size=(len(triangles), 3, 2)) if draw(st.booleans()) else None
    return Mesh(points, triangles, normals, uvs)


def optional(**fields):
    """Keyword arguments of a record, each there or left at its default."""
    return st.fixed_dictionaries({}, optional=fields)


positive, not_negative, degrees = numbers(1e-6), numbers(0), numbers(1, 180)
colors = vectors(3, not_negative)
sizes = st.integers(1, 16384)

# Periodic sides come in pairs.
SIDE_PAIRS = [(a, b) for a, b in product(BOUNDARIES, repeat=2) if a == b or "periodic" not in (a, b)]

domain_fields = optional(
    transform=matrices(),  # a domain that moves is read as it is at the start
    resolution=st.integers(1, 4096),
    boundary=vectors(3, st.sampled_from(SIDE_PAIRS)).map(lambda pairs: sum(pairs, ())),
    time_scale=positive,
    max_courant=positive,
    buoyancy_density=numbers(),
    buoyancy_temperature=numbers(),
    ambient_temperature=numbers(),
    vorticity=not_negative,
    turbulence=not_negative,
    turbulence_scale=positive,
    viscosity=not_negative,
    wind=vectors(3, numbers()),
    density_diffusion=not_negative,
    temperature_diffusion=not_negative,
    density_dissipation=not_negative,
    temperature_cooling=not_negative,
    extinction=not_negative,
    extinction_color=vectors(3, not_negative),
    albedo=vectors(3, numbers(0, 1)),
    density_scale=positive,
    grids=st.lists(st.sampled_from(GRIDS), unique=True).map(tuple),
    active_box=st.booleans(),
    advection=st.sampled_from(ADVECTION_SCHEMES),
    pressure_solver=st.sampled_from(PRESSURE_SOLVERS),
    pressure_tolerance=positive,
    diffusion_solver=st.sampled_from(DIFFUSION_SOLVERS),
    diffusion_sweeps=st.integers(1, 10_000),
)
boxes = st.one_of(
    positive.map(lambda half: {"lower": (-half,) * 3, "upper": (half,) * 3}),
    st.builds(
        lambda lower, size: {"lower": lower, "upper": tuple(float(a + b) for a, b in zip(lower, size, strict=True))},
        vectors(3, st.integers(-1000, 1000).map(float)),
        vectors(3, st.integers(1, 1000)),
    ),
)
emitter_fields = optional(
    density=not_negative | changing(not_negative),
    temperature=numbers() | changing(numbers()),
    rate=not_negative | changing(not_negative),
    velocity=vectors(3, numbers()) | changing(vectors(3, numbers())),
    inherit_velocity=numbers(),
    source=st.sampled_from(SOURCES),
    noise=numbers(0, 1),
    noise_scale=positive,
    enabled=st.booleans() | changing(st.booleans()),
)
receiver_fields = optional(
    bake=st.lists(st.sampled_from(BAKES), unique=True).map(tuple),
    texture_size=sizes,
    receive_smoke=st.booleans(),
    receive_shadow=st.booleans(),
)
light_fields = {
    "transform": transforms,
    "color": colors,
    "intensity": not_negative | changing(not_negative),
    "normalize": st.booleans(),
    "enabled": st.booleans() | changing(st.booleans()),
    "shadow_enable": st.booleans(),
    "shadow_bias": not_negative,
    "shadow_slope_bias": not_negative,
    "shadow_map_size": sizes,
    "shadow_near": numbers(0, 1),
    "shadow_far": numbers(2),
    "shadow_filter": st.sampled_from(SHADOW_FILTERS),
    "smoke_shadow": st.sampled_from(SMOKE_SHADOWS),
    "smoke_shadow_size": sizes,
    "smoke_shadow_layer": st.integers(1, 4096),
    "smoke_diffusion": numbers(0, 1000),
    "smoke_diffuser": st.sampled_from(SMOKE_DIFFUSERS),
    "smoke_sweeps": st.integers(1, 10_000),
    "smoke_projection": st.sampled_from(SMOKE_PROJECTIONS),
    "smoke_compositing": st.sampled_from(SMOKE_COMPOSITINGS),
}
point_fields = light_fields | {
    "radius": not_negative,
    "falloff_start": numbers(0, 1),
    "attenuation": vectors(3, positive),
}
falloffs = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"falloff_model": st.sampled_from(FALLOFF_MODELS), "falloff_end": numbers(2)}),
)
spot_fields = point_fields | {"cone_angle": degrees, "cone_softness": numbers(0, 1), "focus": not_negative}
textures = optional(
    wrap_s=st.sampled_from(WRAP_MODES),
    wrap_t=st.sampled_from(WRAP_MODES),
    color_space=st.sampled_from(("auto", "sRGB", "raw")),
    scale=vectors(4, numbers()),
    bias=vectors(4, numbers()),
    uv_scale=vectors(2, numbers()),
    uv_rotation=numbers(),
    uv_translation=vectors(2, numbers()),
)
channels = st.sampled_from(("r", "g", "b", "a"))
procedurals = st.builds(
    Procedural,
    kind=st.sampled_from(PROCEDURALS),
    size=st.integers(1, 8192),
    color1=colors,
    color2=colors,
    zoom=positive,
    center=vectors(2, numbers()),
    max_iterations=st.integers(1, 128),
    repeats=st.integers(1, 4096),
)
material_fields = optional(
    diffuse_color=colors,
    fresnel_r0=colors,
    roughness=numbers(0, 1),
    emissive_color=colors,
    reflection=st.sampled_from(REFLECTIONS),
    gloss=st.sampled_from(GLOSS_ROLES),
    parallax=st.sampled_from(PARALLAXES),
    parallax_scale=numbers(),
    parallax_bias=numbers(),
    procedural=procedurals,
)
# As the specification asks of a normal map, so that there is nothing to warn of.
directions = {"color_space": "raw", "scale": (2.0, 2.0, 2.0, 1.0), "bias": (-1.0, -1.0, -1.0, 0.0)}
camera_fields = optional(
    transform=transforms,
    focal_length=positive,
    horizontal_aperture=positive,
    vertical_aperture=positive,
    horizontal_offset=numbers(),
    vertical_offset=numbers(),
    near=numbers(),
    far=positive,
)
settings_fields = optional(
    start=st.integers(-1000, 10),
    end=st.integers(11, 5000),
    time_codes_per_second=st.floats(1e-3, 1e6),
    meters_per_unit=st.floats(1e-6, 1e6),
    up_axis=st.sampled_from(AXES),
    ambient=colors,
)


def first_written(roles):
    """When the author comes to a shape: emitters, then colliders, then surfaces."""
    return min(map("ecs".index, roles))


@st.composite
def scenes(draw, picture):
    """Scenes with a few records of each kind, in groups of any depth."""
    names = iter(range(100))
    root = draw(st.sampled_from(("/World", "")))

    def path():
        return root + draw(st.sampled_from(("/P{}", "/G{}/Part", "/G{}/A/B"))).format(next(names))

    def some(most=2):
        return range(draw(st.integers(0, most)))

    domains = [SmokeDomain(path=path(), **draw(boxes), **draw(domain_fields)) for _ in some()]
    # Prims come back in the order in which they are first written.
    roles = sorted(draw(st.lists(st.sets(st.sampled_from("ecs"), min_size=1), max_size=3)), key=first_written)
    materials = [Material(path=path(), **draw(material_fields)) for _ in some()]
    if draw(st.booleans()):
        data = {
            field: Texture(file=str(picture), **draw(textures), channel=draw(channels))
            for field in draw(st.sets(st.sampled_from(("height_texture", "roughness_texture"))))
        }
        look = {
            "diffuse_texture": Texture(file=str(picture), **draw(textures)),
            "normal_texture": Texture(file=str(picture), **(draw(textures) | directions)),
        }
        materials.append(Material(path=path(), **look, **data, **draw(material_fields)))
    emitters, colliders, surfaces = [], [], []
    for role in roles:
        place = {"path": path(), "transform": draw(transforms), "mesh": draw(meshes())}
        if "e" in role:
            emitters.append(Emitter(**place, **draw(emitter_fields)))
        if "c" in role:
            colliders.append(Collider(**place, **draw(optional(thickness=not_negative, friction=numbers(0, 1)))))
        if "s" in role:
            receiver = Receiver(path=place["path"], **draw(receiver_fields)) if draw(st.booleans()) else None
            visible = draw(st.just(True) | changing(st.booleans()))
            material = draw(st.sampled_from([None, *materials]))
            surfaces.append(Surface(**place, material=material, visible=visible, receiver=receiver))
    lights = [
        *(DistantLight(path=path(), **draw(optional(angle=not_negative, **light_fields))) for _ in some(1)),
        *(PointLight(path=path(), **draw(optional(**point_fields)), **draw(falloffs)) for _ in some(1)),
        *(SpotLight(path=path(), **draw(optional(**spot_fields)), **draw(falloffs)) for _ in some(1)),
    ]
    camera = Camera(path=path(), **draw(camera_fields)) if draw(st.booleans()) else None
    return Scene(
        domains=domains,
        emitters=emitters,
        colliders=colliders,
        surfaces=surfaces,
        lights=lights,
        camera=camera,
        **draw(settings_fields),
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
            "/A: mesh is another one for each of its records; allowed: one shape and place for all that it is",
        ),
        (
            Scene(emitters=[Emitter(path="/A", mesh=BALL)], lights=[PointLight(path="/A")]),
            "/A: path is /A; allowed: one kind of thing at a path",
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
            "/M: path is /M; allowed: one kind of thing at a path",
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
