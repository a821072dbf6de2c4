"""A small scene with everything on that keeps a memory between frames: what a run that goes on must bring back."""

from dataclasses import replace

import numpy as np
from scenes import at, floor, plume

import warp_smoke as ws
from warp_smoke import Samples


def busy_scene(frames: int = 6, resolution: int = 16, **domain) -> ws.Scene:
    """Two domains, things that move, stop, deform, appear and vanish, and bakes in textures and at points.

    What is said of frames 1 to 6 is stretched over all of them.
    """

    def when(*frames_of_six: int) -> np.ndarray:
        return 1.0 + (np.array(frames_of_six, float) - 1.0) * (frames - 1) / 5.0

    def path(times, *places) -> Samples:
        return Samples(when(*times), np.stack([at(*place) for place in places]))

    effects = {
        "vorticity": 0.4,
        "turbulence": 0.5,
        "viscosity": 0.002,
        "density_diffusion": 0.001,
        "density_dissipation": 0.2,
        "temperature_cooling": 0.3,
        "wind": (0.2, 0.0, 0.1),
        "grids": ("density", "temperature", "velocity", "light"),
        "extinction_color": (1.0, 0.8, 0.6),
    }
    scene = plume(resolution, frames, **effects | domain)
    ball = ws.Mesh.sphere(0.25, 12)
    breathing = Samples(when(1, 3, 5), np.stack([ball.points * size for size in (1.0, 1.3, 1.1)]))
    second = ws.SmokeDomain(
        path="/World/Other", transform=at(3, 1, 0), resolution=12, buoyancy_temperature=3.0, active_box=False
    )
    puffs = ws.Points(
        points=Samples(when(1, 6), np.array([[[0, 0, 0], [0.2, 0, 0]], [[0.3, 0.1, 0], [0, 0.2, 0.1]]])),
        widths=np.array([0.4, 0.3]),
    )
    emitters = [
        ws.Emitter(path="/World/Source", mesh=ball, transform=path([1, 4], (0, 0.4, 0), (0.3, 0.5, 0.1)), noise=0.5),
        ws.Emitter(path="/World/Skin", mesh=replace(ball, points=breathing), transform=at(0.4, 0.4, 0.4), rate=3.0),
        ws.Emitter(path="/World/Puffs", mesh=puffs, transform=at(3, 0.6, 0), source="surface"),
    ]
    colliders = [
        # It stops at frame 3 and goes on at frame 4: what is left behind it matters to the frames after both.
        ws.Collider(
            path="/World/Ball",
            mesh=ball,
            transform=path([1, 3, 4, 6], (-0.5, 1.2, 0), (0.1, 1.3, 0), (0.1, 1.3, 0), (0.5, 1.0, 0.2)),
        ),
        ws.Collider(path="/World/Shelf", mesh=ws.Mesh.box((0.6, 0.05, 0.6)), transform=at(0, 1.6, 0)),
    ]
    shown = Samples(when(1, 3, 5), np.array([True, False, True]))
    bare = replace(ws.Mesh.box(0.4), uvs=None)
    surfaces = [
        floor(texture_size=24),
        ws.Surface(
            path="/World/Bare", mesh=bare, transform=at(1.2, 0.4, 0.3), receiver=ws.Receiver(path="/World/Bare")
        ),
        ws.Surface(path="/World/Card", mesh=ws.Mesh.box((0.5, 0.02, 0.5)), transform=at(0.3, 2.4, 0), visible=shown),
        ws.Surface(
            path="/World/Fan", mesh=ball, transform=path([1, 6], (1.0, 1.0, 1.0), (-1.0, 1.5, 1.0)), visible=True
        ),
        ws.Surface(path="/World/Ball", mesh=ball, transform=colliders[0].transform),
    ]
    lamp, sun = scene.lights
    lights = [
        replace(lamp, transform=path([1, 6], (1.5, 3.5, 1.0), (1.0, 3.6, 1.5)), shadow_map_size=48),
        replace(sun, shadow_map_size=48, smoke_shadow="dpd", smoke_diffusion=0.5),
    ]
    return replace(
        scene,
        domains=[*scene.domains, second],
        emitters=emitters,
        colliders=colliders,
        surfaces=surfaces,
        lights=lights,
    )
