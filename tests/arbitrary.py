"""Hypothesis strategies: a small scene with anything in it changed, to whatever is allowed."""

from dataclasses import replace
from itertools import product

import numpy as np
from hypothesis import strategies as st
from scenes import at, floor, shining

import warp_smoke as ws
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
    SURFACE_BAKES,
)


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    """Positive numbers, as likely in each decade from 10^low to 10^high, the ends now and then."""
    spread = st.floats(low, high).map(lambda power: 10.0**power)
    return st.sampled_from([10.0**low, 10.0**high]) | spread | spread


def _over_time(values: st.SearchStrategy) -> st.SearchStrategy:
    """A value, or one that changes in time."""
    times = st.sampled_from([[1.0, 2.0], [0.0, 1.5], [1.25, 1.75]])
    changing = st.builds(lambda at, pair: ws.Samples(np.array(at), np.array(pair)), times, st.tuples(values, values))
    return values | changing


amounts = st.just(0.0) | powers(-3, 3) | powers(-9, 6)
signed = st.builds(lambda sign, size: sign * size, st.sampled_from([-1.0, 1.0]), amounts)
vectors = st.tuples(signed, signed, signed)
shares = st.floats(0.0, 1.0)
tints = st.tuples(shares, shares, shares)
colors = tints | st.tuples(amounts, amounts, amounts)
places = st.tuples(*[st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0]) | st.floats(-2.0, 2.0)] * 3)
switches = st.booleans()


@st.composite
def _placements(draw, straight: bool = False) -> np.ndarray:
    """Where something is: turned, scaled, mirrored, moved and, unless it must stay `straight`, flattened or sheared."""
    matrix = at(*draw(places))
    if draw(switches):
        axes = np.eye(3)[list(draw(st.permutations(range(3))))]
    else:
        axes = np.linalg.qr(np.array([draw(places), draw(places), draw(places)]) + np.eye(3))[0]
    matrix[:3, :3] = np.array(draw(st.tuples(*[powers(-1, 1)] * 3)))[:, None] * axes
    if not straight and draw(st.integers(0, 4)) == 0:
        matrix[0, :3] = draw(st.sampled_from([matrix[1, :3], matrix[0, :3] + matrix[2, :3], np.zeros(3)]))
    return matrix


straight = _over_time(_placements(straight=True))
placements = _over_time(_placements())
_clouds = st.lists(places, min_size=1, max_size=6).map(lambda points: np.array(points, np.float32))
_soups = st.builds(
    lambda points, triangles: ws.Mesh(points, np.array(triangles) % len(points)),
    _clouds,
    st.lists(st.tuples(*[st.integers(0, 5)] * 3), min_size=1, max_size=6),
)
meshes = st.sampled_from([ws.Mesh.box(1.0), ws.Mesh.sphere(0.5, 8), ws.Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2))])
meshes = meshes | _soups
_blobs = st.builds(lambda p, width: ws.Points(p, np.full(len(p), width)), _clouds, st.just(0.0) | powers(-3, 1))

LIGHT = {
    "color": colors,
    "intensity": _over_time(amounts | powers(-38, 38)),
    "normalize": switches,
    "enabled": _over_time(switches),
    "illuminates": st.none() | st.just(()) | st.just(("/World/Floor",)),
    "shadowed_by": st.none() | st.just(()) | st.just(("/World/Cube", "/World/Smoke")),
    "shadow_enable": switches,
    "shadow_bias": st.none() | amounts,
    "shadow_slope_bias": st.none() | amounts,
    "shadow_map_size": st.integers(1, 16),
    "shadow_near": st.none() | powers(-9, -1),
    "shadow_far": st.none() | powers(0, 38),
    "shadow_filter": st.sampled_from(SHADOW_FILTERS),
    "shadow_softness": st.none() | amounts,
    "shadow_cull_front": switches,
    "smoke_shadow": st.sampled_from(SMOKE_SHADOWS),
    "smoke_shadow_size": st.none() | st.integers(1, 16),
    "smoke_shadow_layer": st.none() | st.integers(1, 8),
    "smoke_diffusion": st.just(0.0) | powers(-9, 3),
    "smoke_diffuser": st.sampled_from(SMOKE_DIFFUSERS),
    "smoke_sweeps": st.integers(1, 8),
    "smoke_projection": st.sampled_from(SMOKE_PROJECTIONS),
    "smoke_compositing": st.sampled_from(SMOKE_COMPOSITINGS),
}
POINT = LIGHT | {
    "transform": placements,
    "radius": amounts,
    "falloff_model": st.sampled_from(FALLOFF_MODELS),
    "falloff_start": st.floats(0.0, 1.0),
    "falloff_end": powers(1, 38),
    "attenuation": st.tuples(powers(-9, 6), amounts, amounts),
}
# Two opposite sides of a domain: periodic together.
_SIDES = st.sampled_from([pair for pair in product(BOUNDARIES, repeat=2) if pair.count("periodic") in (0, 2)])
# By kind of record: what its fields may be, small enough to be quick.
ALLOWED = {
    ws.SmokeDomain: {
        "transform": straight,
        "lower": st.tuples(*[powers(-8, 3).map(lambda x: -x)] * 3),
        "upper": st.tuples(*[powers(-8, 3)] * 3),
        "resolution": st.integers(1, 7),
        "boundary": st.none() | st.tuples(*[_SIDES] * 3).map(lambda pairs: sum(pairs, ())),
        "time_scale": powers(-9, 6),
        "max_courant": powers(-1, 6),
        "buoyancy_density": signed,
        "buoyancy_temperature": signed,
        "ambient_temperature": signed,
        "vorticity": amounts,
        "turbulence": amounts,
        "turbulence_scale": st.none() | powers(-9, 6),
        "viscosity": amounts,
        "wind": vectors,
        "density_diffusion": amounts,
        "temperature_diffusion": amounts,
        "density_dissipation": amounts,
        "temperature_cooling": amounts,
        "extinction": amounts,
        "extinction_color": colors,
        "albedo": tints,
        "density_scale": powers(-9, 6),
        "grids": st.lists(st.sampled_from(GRIDS), max_size=4),
        "active_box": switches,
        "advection": st.sampled_from(ADVECTION_SCHEMES),
        "pressure_solver": st.sampled_from(PRESSURE_SOLVERS),
        "pressure_tolerance": powers(-9, 0),
        "diffusion_solver": st.sampled_from(DIFFUSION_SOLVERS),
        "diffusion_sweeps": st.integers(1, 20),
    },
    ws.Emitter: {
        "transform": placements,
        "mesh": meshes | _blobs,
        "density": _over_time(amounts),
        "temperature": _over_time(signed),
        "rate": st.none() | _over_time(amounts),
        "velocity": _over_time(vectors),
        "inherit_velocity": signed,
        "source": st.sampled_from(SOURCES),
        "noise": shares,
        "noise_scale": st.none() | powers(-9, 6),
        "turbulence": amounts,
        "enabled": _over_time(switches),
    },
    ws.Collider: {
        "transform": placements,
        "mesh": meshes,
        "thickness": st.just(0.0) | powers(-3, 2),
        "friction": shares,
    },
    ws.Receiver: {
        "bake": st.lists(st.sampled_from(BAKES), max_size=len(BAKES)),
        "texture_size": st.integers(1, 9),
        "texture_bits": st.sampled_from((8, 16)),
        "receive_smoke": switches,
        "receive_shadow": switches,
    },
    ws.Surface: {
        "transform": placements,
        "mesh": meshes,
        "visible": _over_time(switches),
        "material": st.builds(
            ws.Material, diffuse_color=colors, fresnel_r0=colors, roughness=shares, emissive_color=colors
        ),
    },
    ws.PointLight: POINT,
    ws.SpotLight: POINT
    | {"transform": straight, "cone_angle": st.floats(1e-3, 180.0), "cone_softness": shares, "focus": amounts},
    ws.DistantLight: LIGHT | {"transform": straight, "angle": st.just(0.0) | powers(-3, 2)},
    ws.Camera: {
        "transform": placements,
        "focal_length": _over_time(powers(-9, 6)),
        "horizontal_aperture": powers(-9, 6),
        "vertical_aperture": powers(-9, 6),
        "horizontal_offset": signed,
        "vertical_offset": signed,
        "near": amounts,
        "far": powers(-9, 38),
    },
    ws.Scene: {
        "ambient": colors,
        "time_codes_per_second": powers(-6, 6),
        "meters_per_unit": powers(-9, 6),
        "up_axis": st.sampled_from(AXES),
    },
}
_FLOOR = floor(2.0, texture_size=8)
# Without texture coordinates it is baked at its points, as float32: in a picture NaN would be black.
_CUBE = ws.Surface(
    path="/World/Cube",
    mesh=replace(ws.Mesh.box(0.3), uvs=None),
    transform=at(0.6, 1.5, 0.0),
    receiver=ws.Receiver(path="/World/Cube", bake=SURFACE_BAKES),
)
_BALL = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 8), transform=at(0.0, 1.2, 0.0))
_SMOKE = ws.SmokeDomain(path="/World/Smoke", transform=at(0.0, 1.0, 0.0), resolution=5)
_SOURCE = ws.Emitter(path="/World/Source", mesh=ws.Mesh.sphere(0.4, 8), transform=at(0.0, 0.5, 0.0))
_CAMERA = ws.Camera(path="/World/Camera", transform=at(0.0, 1.0, 6.0))
_LIGHTS = [
    ws.PointLight(path="/World/Lamp", transform=at(1.5, 3.5, 1.0), shadow_map_size=16, falloff_end=100.0),
    ws.SpotLight(path="/World/Spot", transform=at(0.5, 0.5, 3.0), shadow_map_size=16, falloff_end=100.0),
    ws.DistantLight(path="/World/Sun", transform=shining((-0.4, -1.0, 0.2)), shadow_map_size=16),
]
# One of each kind, before anything is changed.
RECORDS = [_SMOKE, _SOURCE, _BALL, _FLOOR, _FLOOR.receiver, *_LIGHTS, _CAMERA, ws.Scene(end=2)]


@st.composite
def _changed(draw, record, most: int):
    """The record with up to so many fields changed."""
    allowed = ALLOWED[type(record)]
    names = draw(st.lists(st.sampled_from(list(allowed)), max_size=most, unique=True))
    return replace(record, **{name: draw(allowed[name]) for name in names})


@st.composite
def scenes(draw) -> ws.Scene:
    """Two frames of a few cells and texels, in which smoke, solids, lights and surfaces mostly meet."""
    surfaces = [replace(_FLOOR, receiver=draw(_changed(_FLOOR.receiver, 2))), _CUBE]
    scene = ws.Scene(
        domains=[draw(_changed(_SMOKE, 5))],
        emitters=[draw(_changed(_SOURCE, 4))],
        colliders=draw(st.just([]) | _changed(_BALL, 3).map(lambda ball: [ball])),
        surfaces=[draw(_changed(surface, 2)) for surface in surfaces],
        lights=[draw(_changed(light, 4)) for light in _LIGHTS if draw(st.integers(0, 2))],
        camera=draw(st.none() | _changed(_CAMERA, 2)),
        end=2,
    )
    scene = draw(_changed(scene, 1))
    return moved(scene, 10.0 ** draw(st.integers(1, 8))) if draw(st.integers(0, 3)) == 0 else scene


def moved(scene: ws.Scene, distance: float) -> ws.Scene:
    """The scene, with everything moved along each axis."""
    shift = at(distance, distance, distance)

    def move(prim):
        transform = prim.transform
        if isinstance(transform, ws.Samples):
            return replace(prim, transform=ws.Samples(transform.times, transform.values @ shift))
        return replace(prim, transform=transform @ shift)

    kinds = ("domains", "emitters", "colliders", "surfaces", "lights")
    changes = {kind: [move(prim) for prim in getattr(scene, kind)] for kind in kinds}
    return replace(scene, camera=scene.camera and move(scene.camera), **changes)
