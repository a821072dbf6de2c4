"""What of a bake is computed again and when, and that it is what a bake from scratch gives."""

import numpy as np
import pytest
from lit_floor import LAMP, ORIGIN, SIZE, SUN, floor
from scenes import at

from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import Camera, Material, PointLight, Receiver
from warp_smoke.shading.bake import ReceiverBake


@pytest.mark.parametrize("bits", [8, 16])
def test_texels_out_of_the_smokes_reach_are_kept(launcher, bits):
    """Limited to some texels, every picture has the bytes of one that is not, frame after frame, alpha too."""
    bakes = ["lit", "irradiance", "smokeShadow"]
    receiver = Receiver(path="/Floor", texture_size=SIZE, texture_bits=bits)
    surface = floor(receiver=receiver, material=Material(opacity=0.5))
    options = {"bakes": bakes, "smoke_shadowed": ["/Lamp", "/Sun"], "color_shadowed": ["/Sun"]}
    limited, whole = (ReceiverBake(launcher, surface, [LAMP, SUN], ORIGIN, **options) for _ in range(2))
    rng = np.random.default_rng(4)
    reached = np.flatnonzero(rng.random(SIZE * SIZE) < 0.3)
    for bake in (limited, whole):
        bake.update(1.0)
    limited.limit_smoke(reached)
    assert len(limited.smoke_points) == len(reached)
    shares = {"/Lamp": np.ones((1, SIZE * SIZE), np.float32), "/Sun": np.ones((3, SIZE * SIZE), np.float32)}
    for _ in range(3):
        for path, share in shares.items():
            some = rng.choice(reached, len(reached) // 2)
            share[:, some] = rng.random((len(share), len(some)), np.float32)
            whole.transmittance[path].assign(share)
            limited.transmittance[path].assign(share[:, reached])
        found, expected = limited.pictures(bakes), whole.pictures(bakes)
        for name in bakes:
            np.testing.assert_array_equal(found[name], expected[name])


def test_only_texels_whose_shadow_changes_are_put_together_anew(launcher):
    """Of the texels in the smoke's reach, those alone turn black when light is taken away without saying so."""
    bake = ReceiverBake(launcher, floor(), [SUN], ORIGIN, bakes=["lit"], shadowed=["/Sun"], smoke_shadowed=["/Sun"])
    bake.update(1.0)
    bake.limit_smoke(np.arange(100, 300))
    before = bake.pictures(["lit"])["lit"].reshape(-1, 3)
    assert before.min() > 0
    bake.visibility["/Sun"].fill_(0.0)
    share = np.ones((1, 200), np.float32)
    share[0, 50:90] = 0.5
    bake.transmittance["/Sun"].assign(share)
    after = bake.pictures(["lit"])["lit"].reshape(-1, 3)
    np.testing.assert_array_equal(np.flatnonzero(np.all(after == 0, axis=1)), np.arange(150, 190))
    np.testing.assert_array_equal(np.delete(after, np.s_[150:190], axis=0), np.delete(before, np.s_[150:190], axis=0))


def test_smoke_out_of_reach_of_everything(launcher):
    """Where smoke reaches no texel at all, the picture is that without smoke."""
    bake = ReceiverBake(launcher, floor(), [SUN], ORIGIN, bakes=["lit"], smoke_shadowed=["/Sun"])
    bake.update(1.0)
    whole = bake.picture("lit")
    bake.limit_smoke(np.zeros(0, int))
    np.testing.assert_array_equal(bake.pictures(["lit"])["lit"], whole)


def test_only_what_changed_is_computed(device):
    """Still lights are shaded once; a moving one, the camera or the receiver makes only its own light new."""
    flicker = PointLight(path="/Flicker", transform=at(0, 1, 0), intensity=Samples([1, 2, 3], [1.0, 1.0, 2.0]))
    camera = Camera(path="/C", transform=Samples([3, 4], np.stack([at(0, 1, 3), at(0, 2, 3)])))
    surface = floor(transform=Samples([4, 5], np.stack([at(0, 0, 0), at(0, 0.1, 0)])))
    launcher = Launcher(device)
    bake = ReceiverBake(launcher, surface, [LAMP, SUN, flicker], ORIGIN, bakes=["lit", "visibility"], camera=camera)
    counts = []
    for time in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0):
        before = launcher.launches.copy()
        bake.update(time)
        made = launcher.launches - before
        counts.append((made["_shade_light"], made["_weigh_light"], made["_place_texels"]))
    assert counts == [
        (3, 3, 1),
        (0, 0, 0),
        (1, 1, 0),  # the flickering lamp alone
        (3, 0, 0),  # highlights follow the camera
        (3, 3, 1),
        (0, 0, 0),
    ]


def test_moving_pictures_are_those_of_each_time(launcher):
    """Updating from frame to frame gives the bytes that a fresh bake of that frame gives."""
    light = PointLight(path="/L", transform=Samples([1, 3], np.stack([at(-1, 1, 0), at(1, 1, 0)])), intensity=9.0)
    camera = Camera(path="/C", transform=at(0, 1, 3))

    def fresh():
        return ReceiverBake(launcher, floor(), [light, SUN], ORIGIN, bakes=["lit"], camera=camera)

    bake = fresh()
    pictures = []
    for time in (1.0, 2.0, 3.0):
        bake.update(time)
        pictures.append(bake.picture("lit"))
        other = fresh()
        other.update(time)
        np.testing.assert_array_equal(pictures[-1], other.picture("lit"))
    assert np.any(pictures[0] != pictures[1])


def test_nothing_is_made_that_is_not_asked_for(device):
    """A bake of shadows alone keeps no colours, a lit one no weights, and no shadow means no shares."""
    sizes = {}
    for name, bakes, shadowed in (
        ("lit", ["lit"], []),
        ("shadowed", ["lit"], ["/Lamp"]),
        ("visibility", ["visibility"], []),
    ):
        launcher = Launcher(device)
        bake = ReceiverBake(launcher, floor(), [LAMP], ORIGIN, bakes=bakes, shadowed=shadowed)
        bake.update(1.0)
        bake.picture(bakes[0])
        sizes[name] = launcher.allocated["bake"]
        assert (launcher.launches["_weigh_light"] == 0) == (bakes == ["lit"])
        assert (launcher.launches["_shade_light"] == 0) == (bakes == ["visibility"])
    n = SIZE * SIZE
    assert sizes["shadowed"] - sizes["lit"] == 4 * n
    assert sizes["lit"] - sizes["visibility"] == 2 * 12 * n - 2 * 4 * n + 2 * n  # radiance, lit; weights, shares; codes
