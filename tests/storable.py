"""Hypothesis strategies: any scene that a stage can hold to the bit, for what is written and read again."""

from itertools import product

import numpy as np
from hypothesis import strategies as st

from warp_smoke import scene as kinds
from warp_smoke.geometry import Mesh, normalized
from warp_smoke.material import GLOSS_ROLES, PARALLAXES, PROCEDURALS, REFLECTIONS
from warp_smoke.record import Samples


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
SIDE_PAIRS = [(a, b) for a, b in product(kinds.BOUNDARIES, repeat=2) if a == b or "periodic" not in (a, b)]

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
    grids=st.lists(st.sampled_from(kinds.GRIDS), unique=True).map(tuple),
    active_box=st.booleans(),
    advection=st.sampled_from(kinds.ADVECTION_SCHEMES),
    pressure_solver=st.sampled_from(kinds.PRESSURE_SOLVERS),
    pressure_tolerance=positive,
    diffusion_solver=st.sampled_from(kinds.DIFFUSION_SOLVERS),
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
    source=st.sampled_from(kinds.SOURCES),
    noise=numbers(0, 1),
    noise_scale=positive,
    turbulence=not_negative,
    enabled=st.booleans() | changing(st.booleans()),
)

receiver_fields = optional(
    bake=st.lists(st.sampled_from(kinds.BAKES), unique=True).map(tuple),
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
    "shadow_filter": st.sampled_from(kinds.SHADOW_FILTERS),
    "smoke_shadow": st.sampled_from(kinds.SMOKE_SHADOWS),
    "smoke_shadow_size": sizes,
    "smoke_shadow_layer": st.integers(1, 4096),
    "smoke_diffusion": numbers(0, 1000),
    "smoke_diffuser": st.sampled_from(kinds.SMOKE_DIFFUSERS),
    "smoke_sweeps": st.integers(1, 10_000),
    "smoke_projection": st.sampled_from(kinds.SMOKE_PROJECTIONS),
    "smoke_compositing": st.sampled_from(kinds.SMOKE_COMPOSITINGS),
}

point_fields = light_fields | {
    "radius": not_negative,
    "falloff_start": numbers(0, 1),
    "attenuation": vectors(3, positive),
}

falloffs = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"falloff_model": st.sampled_from(kinds.FALLOFF_MODELS), "falloff_end": numbers(2)}),
)

spot_fields = point_fields | {"cone_angle": degrees, "cone_softness": numbers(0, 1), "focus": not_negative}

textures = optional(
    wrap_s=st.sampled_from(kinds.WRAP_MODES),
    wrap_t=st.sampled_from(kinds.WRAP_MODES),
    color_space=st.sampled_from(("auto", "sRGB", "raw")),
    scale=vectors(4, numbers()),
    bias=vectors(4, numbers()),
    uv_scale=vectors(2, numbers()),
    uv_rotation=numbers(),
    uv_translation=vectors(2, numbers()),
)

channels = st.sampled_from(("r", "g", "b", "a"))

procedurals = st.builds(
    kinds.Procedural,
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
    focal_length=positive | changing(positive),
    horizontal_aperture=positive | changing(positive),
    vertical_aperture=positive,
    horizontal_offset=numbers() | changing(numbers()),
    vertical_offset=numbers(),
    near=numbers(),
    far=positive,
)

settings_fields = optional(
    start=st.integers(-1000, 10),
    end=st.integers(11, 5000),
    time_codes_per_second=st.floats(1e-3, 1e6),
    meters_per_unit=st.floats(1e-6, 1e6),
    up_axis=st.sampled_from(kinds.AXES),
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

    domains = [kinds.SmokeDomain(path=path(), **draw(boxes), **draw(domain_fields)) for _ in some()]
    # Prims come back in the order in which they are first written.
    roles = sorted(draw(st.lists(st.sets(st.sampled_from("ecs"), min_size=1), max_size=3)), key=first_written)
    materials = [kinds.Material(path=path(), **draw(material_fields)) for _ in some()]
    if draw(st.booleans()):
        data = {
            field: kinds.Texture(file=str(picture), **draw(textures), channel=draw(channels))
            for field in draw(st.sets(st.sampled_from(("height_texture", "roughness_texture"))))
        }
        look = {
            "diffuse_texture": kinds.Texture(file=str(picture), **draw(textures)),
            "normal_texture": kinds.Texture(file=str(picture), **(draw(textures) | directions)),
        }
        materials.append(kinds.Material(path=path(), **look, **data, **draw(material_fields)))
    emitters, colliders, surfaces = [], [], []
    for role in roles:
        place = {"path": path(), "transform": draw(transforms), "mesh": draw(meshes())}
        if "e" in role:
            emitters.append(kinds.Emitter(**place, **draw(emitter_fields)))
        if "c" in role:
            colliders.append(kinds.Collider(**place, **draw(optional(thickness=not_negative, friction=numbers(0, 1)))))
        if "s" in role:
            receiver = kinds.Receiver(path=place["path"], **draw(receiver_fields)) if draw(st.booleans()) else None
            visible = draw(st.just(True) | changing(st.booleans()))
            material = draw(st.sampled_from([None, *materials]))
            surfaces.append(kinds.Surface(**place, material=material, visible=visible, receiver=receiver))
    lights = [
        *(kinds.DistantLight(path=path(), **draw(optional(angle=not_negative, **light_fields))) for _ in some(1)),
        *(kinds.PointLight(path=path(), **draw(optional(**point_fields)), **draw(falloffs)) for _ in some(1)),
        *(kinds.SpotLight(path=path(), **draw(optional(**spot_fields)), **draw(falloffs)) for _ in some(1)),
    ]
    camera = kinds.Camera(path=path(), **draw(camera_fields)) if draw(st.booleans()) else None
    return kinds.Scene(
        domains=domains,
        emitters=emitters,
        colliders=colliders,
        surfaces=surfaces,
        lights=lights,
        camera=camera,
        **draw(settings_fields),
    )
