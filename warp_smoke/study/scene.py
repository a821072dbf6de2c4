"""A user's own stage at several settings, each against the finest; what its effects cost; and what to choose.

Smoke is simulated over a range of frames, and the last is compared: its density on the cells of the coarser run, its
baked pictures, and its picture through the camera. Shadows are recomputed for that frame and compared with ray-traced
ones.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from warp_smoke.launch import Launcher
from warp_smoke.plan import make_plan
from warp_smoke.plan.fluid import DEFAULT_ADVECTION
from warp_smoke.record import FieldError
from warp_smoke.scene import ADVECTION_SCHEMES, Scene
from warp_smoke.scene import SMOKE_SHADOWS as SMOKE_METHODS
from warp_smoke.study.case import Case, Measured, Row
from warp_smoke.study.front import pareto_front
from warp_smoke.study.outcome import Outcome, differences, light_scene, run_scene
from warp_smoke.study.settings import (
    effects_off,
    with_receivers,
    with_smoke,
    with_smoke_shadows,
    with_surface_shadows,
    with_tolerance,
)
from warp_smoke.study.words import by_problem, duration, percent

SMOKE, PRESSURE = "smoke", "pressure tolerance"
SURFACE_SHADOWS, SMOKE_SHADOWS = "shadows of surfaces", "shadows of smoke"
FINEST, EFFECTS = "the finest run", "effects, one switched off"
EVERYTHING = "everything"

# Cells along a side, as a share of the stage's.
_SHARES, _FULL_SHARES = (0.5, 0.75, 1.0), (0.5, 0.75, 1.0, 1.5)
_FINEST_SHARE, _FULL_FINEST_SHARE = 1.5, 2.0
_QUICK_FRAMES, _QUICK_CELLS = 24, 2**21
_TOLERANCES, _FINE_TOLERANCE = (1e-1, 1e-2, 1e-3, 1e-4), 1e-5
_MAPPED_FILTERS, _TRACED_FILTERS = ("hard", "pcf_grid", "pcf_disk", "pcss"), ("exact", "area")
_MAP_SHARES = (0.25, 0.5, 1.0)
# The fastest setting is recommended whose error is within this factor of the least, or within one code of an 8-bit
# picture.
_GOOD_ENOUGH, _UNSEEN = 1.5, 1 / 255


class SceneStudy:
    """The suite `scene`, for one stage.

    Attributes:
        TITLE, MAIN_ERROR, ERROR_MEANS, PANEL_ERRORS, TIME_MEANS, TABLES: see `Suite`.
    """

    MAIN_ERROR = "density"
    ERROR_MEANS = "relative L2 error of the density"
    PANEL_ERRORS: Mapping[str, tuple[str, str]] = {
        name: ("shadows", "rms error of the baked pictures") for name in (SURFACE_SHADOWS, SMOKE_SHADOWS)
    }
    TIME_MEANS = "time of a frame"
    TABLES: Mapping[str, str] = {FINEST: "the finest run", EFFECTS: "the stage as it is"}

    def __init__(self, scene: Scene):
        """Plans the stage.

        Raises:
            ValueError: there is neither smoke nor a shadow in it.
        """
        name = scene.source.name if scene.source else "scene"
        self.TITLE = f"The stage {name}"
        self._scene, self._plan = scene, make_plan(scene)
        lights = [light for each in self._plan.receivers for light in each.lights]
        self._shadowed = any(light.surface_shadow for light in lights)
        self._smoky = any(light.smoke for light in lights)
        if not (self._plan.domains or self._shadowed):
            allowed = "one with smoke, or with a mesh with SmokeReceiverAPI on which something casts a shadow"
            raise FieldError(name, "stage", "one without anything to study", allowed)
        self._outcomes: dict[str, Outcome] = {}
        self._traced: dict[str, Outcome] = {}

    def cases(self, full: bool) -> list[Case]:
        """Returns resolutions and schemes, tolerances, shadow settings and effects, where the stage has them."""
        frames = self._frames(full)
        made = self._smoke_cases(frames, full) if self._plan.domains else []
        for name, scene in {EVERYTHING: frames, **effects_off(frames, self._plan)}.items():
            made.append(self._run_case(EFFECTS, name, {}, scene, frames))
        if self._shadowed:
            alone = with_receivers(frames, receive_smoke=False)
            traced = with_surface_shadows(alone, "area")
            choices = [(name, share) for name in _MAPPED_FILTERS for share in _MAP_SHARES]
            for name, share in [*choices, *((name, None) for name in _TRACED_FILTERS)]:
                scene = with_surface_shadows(alone, name, share or 1.0)
                texels = max(light.shadow_map_size for light in scene.lights)
                choice = {"map": share} if share else {}
                made.append(self._light_case(SURFACE_SHADOWS, name, choice, texels, scene, traced, frames))
        if self._smoky:
            alone = with_receivers(frames, receive_shadow=False)
            traced, cells = with_smoke_shadows(alone, "ray_traced"), frames.domains[0].resolution
            for name in SMOKE_METHODS:
                scene = with_smoke_shadows(alone, name)
                made.append(self._light_case(SMOKE_SHADOWS, name, {}, cells, scene, traced, frames))
        return made

    def _frames(self, full: bool) -> Scene:
        """Returns the scene with the frames that are run: without smoke only the first."""
        start, end = self._scene.start, self._scene.end
        if not self._plan.domains:
            return replace(self._scene, end=start)
        return self._scene if full else replace(self._scene, end=min(end, start + _QUICK_FRAMES))

    def _smoke_cases(self, frames: Scene, full: bool) -> list[Case]:
        cells, resolution = sum(each.lattice.cells for each in self._plan.domains), frames.domains[0].resolution
        finest = _FULL_FINEST_SHARE if full else _FINEST_SHARE
        if not full:  # a large stage is studied at a coarser resolution than its own
            resolution = min(resolution, int(resolution * (_QUICK_CELLS / cells) ** (1 / 3) / finest))
        best = with_smoke(frames, None, round(resolution * finest))
        made = [self._run_case(FINEST, frames.domains[0].advection or DEFAULT_ADVECTION, {}, best, best)]
        for scheme in ADVECTION_SCHEMES:
            for share in _FULL_SHARES if full else _SHARES:
                scene = with_smoke(frames, scheme, max(1, round(resolution * share)))
                made.append(self._run_case(SMOKE, scheme, {}, scene, best))
        solvers = {each.pressure_solver for each in self._plan.domains} - {"spectral"}
        if solvers:
            coarse = with_smoke(frames, None, resolution)
            for tolerance in _TOLERANCES:
                scene, fine = with_tolerance(coarse, tolerance), with_tolerance(coarse, _FINE_TOLERANCE)
                made.append(self._run_case(PRESSURE, min(solvers), {"tolerance": tolerance}, scene, fine))
        return made

    def _run_case(self, problem: str, method: str, parameters: dict, scene: Scene, finest: Scene) -> Case:
        """A run of all frames, compared with the finest."""

        def measure(launcher: Launcher, repeats: int) -> Measured:
            outcome, measured = run_scene(launcher, scene, repeats)
            if scene is finest:
                self._outcomes[_run_in_words(finest)] = outcome
            return replace(measured, errors=differences(outcome, self._outcome(launcher, finest)))

        resolution = scene.domains[0].resolution if self._plan.domains else 0
        dt = 1 / scene.time_codes_per_second
        return Case("scene", problem, method, parameters, resolution, dt, measure, _run_in_words(finest))

    def _light_case(
        self, problem: str, method: str, parameters: dict, resolution: int, scene: Scene, traced: Scene, frames: Scene
    ) -> Case:
        """The last frame's shadows, compared with ray-traced ones, for the same smoke."""

        def measure(launcher: Launcher, repeats: int) -> Measured:
            volumes = self._outcome(launcher, frames).volumes
            if problem not in self._traced:
                self._traced[problem], _ = light_scene(launcher, traced, volumes, 1)
            outcome, measured = light_scene(launcher, scene, volumes, repeats)
            errors = differences(outcome, self._traced[problem])
            return replace(measured, errors={"shadows": errors["shadows"]})

        reference = f"rays, {_run_in_words(frames)}"
        return Case("scene", problem, method, parameters, resolution, None, measure, reference)

    def _outcome(self, launcher: Launcher, scene: Scene) -> Outcome:
        """Returns the last frame of a reference run, which is made on first use."""
        name = _run_in_words(scene)
        if name not in self._outcomes:
            self._outcomes[name], _ = run_scene(launcher, scene, 0)
        return self._outcomes[name]

    def order(self, rows: Sequence[Row]) -> dict[tuple[str, str], float]:
        """Returns nothing: a stage has no known answer."""
        return {}

    def unexpected(self, rows: Sequence[Row]) -> list[str]:
        """Returns nothing: a stage has no known answer."""
        return []

    def explain(self, rows: Sequence[Row]) -> str:
        """Explains how to read the diagrams, and what to choose."""
        read = (
            "Each point is a setting: how long a frame takes with it, and how far its last frame is from that of the "
            "finest run (smoke), or its shadows and bakes from those traced by rays."
        )
        return f"{read} {self.recommendation(rows)}"

    def recommendation(self, rows: Sequence[Row]) -> str:
        """Returns what to choose, in one line: the fastest setting that is nearly as good as the best."""
        says = []
        for problem, found in by_problem(rows).items():
            if problem in self.TABLES:
                continue
            error, _ = self.PANEL_ERRORS.get(problem, (self.MAIN_ERROR, ""))
            if len(found) > 1 and not any(row.errors[error] for row in found):
                same = "pictures (are they black?)" if problem in self.PANEL_ERRORS else "smoke (is there any?)"
                says.append(f"for {problem} nothing to choose by: all settings give the same {same}")
                continue
            chosen = recommended(found, error)
            times = max(row.median for row in found) / chosen.median
            says.append(
                f"for {problem} {chosen.method} at {chosen.resolution} ({duration(chosen.median)}, "
                f"error {percent(chosen.errors[error])}, {times:.1f} times as fast as the slowest)"
            )
        return f"Recommended: {'; '.join(says)}." if says else "Nothing could be measured."


def recommended(rows: Sequence[Row], error: str) -> Row:
    """Returns the fastest row whose error cannot be seen in a picture, or is not much larger than the least.

    The reference has no error, and is not a choice unless it is the only row.
    """
    front = pareto_front([row for row in rows if row.errors[error] > 0] or rows, error)
    enough = max(_UNSEEN, _GOOD_ENOUGH * front[-1].errors[error])
    return next(row for row in front if row.errors[error] <= enough)


def _run_in_words(scene: Scene) -> str:
    """Describes a run of the stage in words that distinguish it from all others, in this study and in later ones."""
    words = []
    for domain in scene.domains:
        words.append(f"{domain.advection or DEFAULT_ADVECTION} at {domain.resolution}")
        words += [] if domain.pressure_tolerance is None else [f"pressure to {domain.pressure_tolerance:g}"]
    return ", ".join([*words, f"frame {scene.end}"])
