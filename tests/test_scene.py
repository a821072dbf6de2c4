"""Records check themselves, compare by value and cannot be changed."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import plume

import warp_smoke as ws
from warp_smoke.record import FieldError, Samples, value_at

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("make", "field", "bad"),
    [
        (ws.SmokeDomain, "resolution", [0, -1, 1.5, True, 100_000, "64", None]),
        (ws.SmokeDomain, "upper", [(-1, 1, 1), (NAN, 1, 1), (1, 1), "big", (-2, -2, -2)]),
        (ws.SmokeDomain, "boundary", [("open",) * 5, ("shut",) * 6, ("periodic", "open") * 3]),
        (ws.SmokeDomain, "max_courant", [0, -1, NAN, INF]),
        (ws.SmokeDomain, "density_dissipation", [-0.1, NAN]),
        (ws.SmokeDomain, "temperature_diffusion", [-0.1, INF]),
        (ws.SmokeDomain, "advection", ["magic"]),
        (ws.SmokeDomain, "grids", [("heat",)]),
        (ws.SmokeDomain, "transform", [np.zeros((4, 4)), np.eye(3), np.full((4, 4), NAN)]),
        (ws.PointLight, "intensity", [-1.0, NAN, "bright", Samples([1, 2], [1.0, -1.0])]),
        (ws.PointLight, "color", [(1, 1), (1, -1, 1)]),
        (ws.PointLight, "shadow_map_size", [0, -4, 10**6]),
        (ws.PointLight, "falloff_end", [0.0, -1.0]),
        (ws.PointLight, "falloff_model", ["linear", "cubic"]),
        (ws.DistantLight, "transform", [np.diag([1.0, 1.0, 0.0, 1.0])]),
        (ws.SpotLight, "cone_angle", [0.0, 181.0]),
        (ws.Material, "roughness", [-0.1, 1.1, NAN]),
        (ws.Receiver, "texture_size", [0, 10**6]),
        (ws.Receiver, "bake", [("shine",)]),
        (ws.Camera, "focal_length", [0.0, -1.0]),
    ],
)
def test_bad_fields_are_named(make, field, bad):
    """A bad value is refused in one line that names path, field, value and what is allowed."""
    for value in bad:
        with pytest.raises(FieldError) as caught:
            make(path="/World/It", **{field: value})
        message = str(caught.value)
        assert message.startswith("/World/It: ")
        assert "allowed: " in message
        assert "\n" not in message


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: ws.SmokeDomain(path="/It", viscosity=2e9), "viscosity is 2000000000.0; allowed: −1e+09 to 1e+09"),
        (lambda: ws.SmokeDomain(path="/It", time_scale=1e-12), "time_scale is 1e-12; allowed: ≥ 1e-09"),
        (
            lambda: ws.SmokeDomain(path="/It", lower=(0, 0, 0), upper=(1, 1, 1e-12)),
            "a box with sides of at least 1e-09",
        ),
        (lambda: ws.PointLight(path="/It", intensity=1e39), "intensity is 1e+39; allowed: −1e+38 to 1e+38"),
        (
            lambda: ws.Surface(path="/It", mesh=ws.Mesh.box(1e6), transform=np.diag([1e6, 1.0, 1.0, 1.0])),
            "transform is one that takes points to 5e+11; allowed: world coordinates from −1e+09 to 1e+09",
        ),
    ],
)
def test_sizes_that_single_precision_cannot_work_with(make, said):
    """Numbers, boxes and places so large or small that their products would overflow are refused in one line."""
    with pytest.raises(FieldError) as caught:
        make()
    assert said in str(caught.value)


def test_paths():
    """Paths are absolute and unique."""
    with pytest.raises(FieldError, match="absolute prim path"):
        ws.SmokeDomain(path="Smoke")
    domain = ws.SmokeDomain(path="/Smoke")
    with pytest.raises(FieldError, match="unique among the scene's domains"):
        ws.Scene(domains=[domain, domain])


def test_frame_range():
    """A reversed range is refused."""
    with pytest.raises(FieldError, match="end is 3; allowed: whole numbers from 10"):
        ws.Scene(start=10, end=3)


def test_equality_is_by_value():
    """Scenes made twice are equal; any change, in an array too, makes them differ; nothing can be assigned."""
    scene = plume()
    assert scene == plume()
    assert scene != replace(scene, end=9)
    moved = replace(scene.emitters[0], transform=np.eye(4))
    assert scene != replace(scene, emitters=[moved])
    assert scene != replace(scene, lights=scene.lights[::-1])
    with pytest.raises(FrozenInstanceError):
        scene.end = 9
    with pytest.raises(ValueError, match="read-only"):
        scene.emitters[0].transform[0, 0] = 2.0


@given(
    # Of times that are closer together NumPy's slope may be infinite.
    st.lists(st.integers(-(10**8), 10**8).map(lambda n: n / 1e6), min_size=1, max_size=6, unique=True).map(sorted),
    st.floats(-200, 200),
    st.data(),
)
def test_samples_interpolate(times, time, data):
    """Samples agree with NumPy's linear interpolation, constant outside."""
    values = data.draw(st.lists(st.floats(-1e3, 1e3), min_size=len(times), max_size=len(times)))
    sampled = Samples(times, np.array(values))
    # Times as close as a millionth make the slope's rounding visible.
    assert value_at(sampled, time) == pytest.approx(np.interp(time, times, values), abs=1e-6)


def test_switches_hold():
    """Booleans hold their last value until the next sample."""
    switch = Samples([1, 5], [False, True])
    assert [bool(value_at(switch, t)) for t in (0, 1, 4.9, 5, 9)] == [False, False, False, True, True]


def test_the_longest_frame():
    """A frame may take a million seconds and no more: beyond, a rate of a million could not be squared."""
    assert ws.Scene(time_codes_per_second=1e-6).time_codes_per_second == 1e-6
    with pytest.raises(ValueError, match="time_codes_per_second is 9e-07; allowed: ≥ 1e-06"):
        ws.Scene(time_codes_per_second=9e-7)


@pytest.mark.parametrize(("start", "end", "middle"), [(1, 1, 1), (1, 3, 2), (1, 48, 25), (-3, 0, -1)])
def test_the_middle_frame(start, end, middle):
    """Of two frames in the middle the later one."""
    assert ws.Scene(start=start, end=end).middle_frame == middle
