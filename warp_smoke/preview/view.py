"""The drawing of a stage: its set, lights and smoke at a frame, seen through its camera."""

from dataclasses import dataclass

import numpy as np
import pyvista as pv

from warp_smoke.geometry import normalized, transform_points
from warp_smoke.preview.camera import View, box_corners, camera_view, framed_view
from warp_smoke.preview.dress import DressedSurface
from warp_smoke.preview.lights import set_lights
from warp_smoke.preview.live_stage import LiveStage
from warp_smoke.preview.marks import mark_domain, mark_emitter, mark_light
from warp_smoke.preview.slices import SliceActors
from warp_smoke.preview.stage import Frame, PreviewStage
from warp_smoke.preview.volume import SmokeActor
from warp_smoke.record import Record, Samples
from warp_smoke.scene import Emitter, Material

TEXT_COLOR = "#e8e8e8"
EMPTY = "Nothing to see: the stage has no mesh, smoke, emitter or light"
UNMARKED = "Nothing to see yet but marks of domains, emitters and lights: --marks shows them"
BACKGROUND, BACKGROUND_TOP = "#26282b", "#70757b"
# Cosine between a view direction and the stage's up axis beyond which it counts as straight down or up.
STEEPEST = 0.999
DEFAULT = Material()
PLAIN = Material(path="/Plain", diffuse_color=(0.5, 0.5, 0.5))


@dataclass(frozen=True)
class Look:
    """What is drawn of a stage, and how.

    Attributes:
        smoke: whether volumes are drawn.
        baked: whether surfaces show baked light and shadows, else their materials under the stage's lights.
        materials: whether surfaces without baked light show their materials, else plain grey.
        marks: whether lights are marked, and before a run also the domains' boxes and the emitters.
        exposure: in stops: each doubles the light.
    """

    smoke: bool = True
    baked: bool = True
    materials: bool = True
    marks: bool = True
    exposure: float = 0.0


AS_IT_IS = Look()


class StageView:
    """A stage drawn by a plotter.

    Args:
        stage: what is drawn: its `scene`, `lights`, `ambient`, `volumes` and `has_results`.
        plotter: where it is drawn; see `warp_smoke.preview.opengl`.
        step: distance between samples in smoke [voxels].
        look: the initial look.

    Attributes:
        plotter: where it is drawn.
        drawn: the current look; see `restyle`.
        follows_camera: whether the view follows the stage's camera.
    """

    def __init__(self, stage: PreviewStage | LiveStage, plotter: pv.Plotter, step: float, look: Look = AS_IT_IS):
        self._stage, self.plotter, self._step = stage, plotter, step
        start = stage.scene.start
        plotter.set_background(BACKGROUND, top=BACKGROUND_TOP)
        plotter.renderer.GetCullers().GetItemAsObject(0).SetSortingStyleToBackToFront()
        drawn = [surface for surface in stage.scene.surfaces if len(surface.mesh.triangles)]
        self._surfaces = [DressedSurface(surface, stage.ambient, start) for surface in drawn]
        for actor in (actor for surface in self._surfaces for actor in surface.actors):
            self._add(actor)
        self._smoke = [SmokeActor(plotter, step) for _ in range(stage.volumes)]
        self._slices = SliceActors(plotter)
        self._frame: Frame | None = None
        self._off: frozenset[str] = frozenset()
        self.drawn = look
        self._lower, self._upper = self._bounds()
        self._marks: list[pv.Actor] = []
        self.follows_camera = stage.scene.camera is not None
        placed = stage.lights if stage.has_results else (*stage.lights, *stage.scene.emitters)
        self._lights_change = any(map(_changes, placed))
        self._look(start)
        marked = stage.scene.domains or stage.scene.emitters or stage.scene.lights
        if not (drawn or stage.volumes or (marked and look.marks)):
            said = UNMARKED if marked else EMPTY
            plotter.add_text(said, position=(0.02, 0.5), viewport=True, color=TEXT_COLOR, font_size=14, render=False)

    def show(self, frame: Frame) -> None:
        """Draws a frame."""
        self._frame = frame
        time = frame.number
        for surface in self._surfaces:
            surface.place(time)
            self._dress(surface, frame)
        for actor, smoke in zip(self._smoke, frame.smoke, strict=True):
            actor.show(smoke if self.drawn.smoke else None, self.drawn.exposure)
        self._slices.show(frame.quantity, frame.slices if self.drawn.smoke else ())
        if not self._marks or self._lights_change or frame.off != self._off:
            self._off = frame.off
            self._light(time)
        camera = self._stage.scene.camera
        if camera is not None and camera.moves and self.follows_camera:
            self._look(time)
        self.plotter.reset_camera_clipping_range()

    def _dress(self, surface: DressedSurface, frame: Frame) -> None:
        """Draws a surface in the current look."""
        path, look = surface.surface.path, self.drawn
        if look.baked and path in frame.pictures:
            surface.show_picture(frame.pictures[path], look.exposure)
        elif look.baked and path in frame.colors:
            surface.show_colors(frame.colors[path], look.exposure)
        elif look.materials:
            surface.show_own(DEFAULT, self._stage.ambient, look.exposure)
        else:
            surface.show_material(PLAIN, self._stage.ambient, look.exposure)

    def restyle(self, look: Look) -> None:
        """Draws the last frame again in another look."""
        self.drawn = look
        if self._frame is not None:
            self._light(self._frame.number)
            self.show(self._frame)

    def look_through_camera(self, follow: bool) -> None:
        """Looks through the stage's camera from here on, or else frames everything once."""
        self.follows_camera = follow and self._stage.scene.camera is not None
        self._look(self._frame.number if self._frame is not None else self._stage.scene.start)
        self.plotter.reset_camera_clipping_range()

    def leave_camera(self) -> None:
        """Keeps the current viewpoint, upright, even where the stage's camera moves on."""
        self.follows_camera = False
        up, camera = np.asarray(self._stage.scene.up, float), self.plotter.camera
        if abs(up @ camera.direction) < STEEPEST:
            camera.up = up

    def succeeded_by(self, stage: "PreviewStage") -> "StageView":
        """Replaces this view by one of another stage, in the same look, and from the same eye unless it follows one."""
        seen = self.plotter.camera.copy()
        self.plotter.clear()
        view = StageView(stage, self.plotter, self._step, self.drawn)
        if not self.follows_camera:
            view.leave_camera()
            self.plotter.camera = seen
        return view

    def picture(self) -> np.ndarray:
        """Returns what is drawn, [h, w, 3] uint8 sRGB, top row first."""
        self.plotter.render()  # else a screenshot shows what was drawn last
        return self.plotter.screenshot(None, return_img=True)

    def _light(self, time: float) -> None:
        """Places the lights that are on, and the marks, as at a time code."""
        shining = [light for light in self._stage.lights if light.path not in self._off]
        set_lights(self.plotter, shining, time, self.drawn.exposure)
        scene = self._stage.scene
        center, radius = (self._lower + self._upper) / 2, float(np.linalg.norm(self._upper - self._lower)) / 2
        for mark in self._marks:
            self.plotter.remove_actor(mark, reset_camera=False, render=False)
        marks = [mark_light(light, center, radius, time) for light in scene.lights if light.path not in self._off]
        if not self._stage.has_results:
            marks += [mark_domain(domain, scene.start) for domain in scene.domains]
            marks += [mark_emitter(emitter, time) for emitter in scene.emitters if isinstance(emitter, Emitter)]
        self._marks = [mark for mark in marks if mark is not None]
        for mark in self._marks:
            mark.visibility = self.drawn.marks
            self._add(mark)

    def _look(self, time: float) -> None:
        """Sets the view to the stage's camera, or to one that frames everything."""
        width, height = self.plotter.window_size
        scene = self._stage.scene
        if not self.follows_camera:
            view = framed_view(self._lower, self._upper, scene.up, width / height)
        else:
            place = scene.camera.transform_at(time)
            ahead = ((self._lower + self._upper) / 2 - place[3, :3]) @ -normalized(place[2, :3])
            view = camera_view(scene.camera, time, width / height, max(ahead, 1e-3))
        look_from(self.plotter, view)

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the corners of what is framed: the domains with some room, or the set if there are none."""
        scene = self._stage.scene
        points = [
            transform_points(domain.transform_at(scene.start), box_corners(domain.lower, domain.upper))
            for domain in scene.domains
        ] or [
            transform_points(surface.transform_at(scene.start), surface.mesh.points_at(scene.start))
            for surface in scene.surfaces
        ]
        every = np.concatenate([*points, np.zeros((0 if points else 1, 3))])
        lower, upper = every.min(axis=0), every.max(axis=0)
        room = 0.1 * (upper - lower) if scene.domains else 0.0
        return lower - room, upper + room

    def _add(self, actor: pv.Actor) -> None:
        self.plotter.add_actor(actor, reset_camera=False, render=False)


def look_from(plotter: pv.Plotter, view: View) -> None:
    """Sets the plotter's camera."""
    camera = plotter.camera
    camera.position, camera.focal_point, camera.up = view.position, view.target, view.up
    camera.view_angle = view.angle
    camera.SetWindowCenter(*view.shift)
    plotter.camera_set = True  # else the first picture would frame everything


def _changes(record: Record) -> bool:
    return any(
        isinstance(each, Samples) or (isinstance(each, Record) and _changes(each)) for each in vars(record).values()
    )
