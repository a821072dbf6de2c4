"""Fixtures for what is drawn: an off-screen plotter, and a small stage with results."""

import numpy as np
import pytest
from scenes import at

import warp_smoke as ws
from warp_smoke.files import write_png
from warp_smoke.lattice import place_lattice
from warp_smoke.preview import opengl
from warp_smoke.usd.volume import VolumeResult, write_volume
from warp_smoke.usd.write import BakeResult, write_results


@pytest.fixture
def open_plotter():
    """Opens off-screen plotters, black and without lights, and closes them."""
    plotters = []

    def open_one(size=(160, 120)):
        plotters.append(opengl.open_off_screen(size))
        plotters[-1].set_background("black")
        return plotters[-1]

    yield open_one
    for plotter in plotters:
        plotter.close()


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """The root layer of two frames: a ball of smoke that grows over a baked floor that darkens, seen by a camera."""
    folder = tmp_path_factory.mktemp("results")
    domain = ws.SmokeDomain(path="/World/Smoke", transform=at(0, 1, 0), resolution=16, extinction=8.0)
    mesh = ws.Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    floor = ws.Surface(path="/World/Floor", mesh=mesh, receiver=ws.Receiver(path="/World/Floor"))
    scene = ws.Scene(
        domains=[domain],
        surfaces=[floor],
        lights=[ws.PointLight(path="/World/Lamp", transform=at(0, 6, 0), intensity=400.0)],
        camera=ws.Camera(path="/World/Eye", transform=at(0, 1, 6), focal_length=20.0),
        start=3,
        end=4,
    )
    lattice = place_lattice(scene, domain)
    for name in ("volumes", "textures"):
        (folder / name).mkdir()
    volumes, pictures = {}, {}
    for frame, radius, grey in ((3, 0.4, 200), (4, 0.8, 100)):
        volumes[frame], pictures[frame] = f"./volumes/{frame}.vdb", f"./textures/{frame}.png"
        write_volume(folder / volumes[frame], domain, lattice, ball(16, radius), None, None)
        write_png(folder / pictures[frame], np.full((8, 8, 3), grey, np.uint8))
    volume = VolumeResult(domain=domain, lattice=lattice, grids=("density",), files=volumes)
    return write_results(folder, "ball", scene, [volume], [BakeResult(surface=floor, bake="lit", files=pictures)])


def ball(cells, radius):
    """Density 1 within a radius of the middle of the box [−1, 1]³, [n, n, n] float32."""
    x, y, z = np.meshgrid(*[(np.arange(cells) + 0.5) * 2 / cells - 1] * 3, indexing="ij")
    return (x**2 + y**2 + z**2 < radius**2).astype(np.float32)
