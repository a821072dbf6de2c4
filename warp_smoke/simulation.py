"""Runs a plan on one device, frame by frame: fluid, then shadows, then bakes; exactly the plan's passes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_smoke.kernels import kernel_modules
from warp_smoke.launch import Launcher, load_kernels
from warp_smoke.lighting import Lighting
from warp_smoke.plan import DomainPlan, Plan, make_plan
from warp_smoke.record import FieldError, Record
from warp_smoke.scene import Scene
from warp_smoke.timing import Timings

if TYPE_CHECKING:
    from warp_smoke.fluid.solver import SmokeSolver
    from warp_smoke.fluid.step_report import StepReport


@dataclass(frozen=True, eq=False)
class Smoke(Record):
    """One domain's fields at a frame, copied to the host; None for fields that are not exported.

    Attributes:
        density: [nx, ny, nz] float32 at cell centres.
        temperature: [nx, ny, nz] float32 at cell centres.
        velocity: [nx, ny, nz, 3] float32 at cell centres, along the lattice's axes [m/s].
        light: light that the smoke scatters, linear RGB, [nx, ny, nz, 3] float32.
    """

    density: np.ndarray | None
    temperature: np.ndarray | None
    velocity: np.ndarray | None
    light: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Frame(Record):
    """The results of one frame.

    Attributes:
        number: the frame (time code).
        smoke: fields by domain path.
        pictures: those that changed, by receiver path and bake, first row at the top: uint8, or uint16 at 16 bits,
            [h, w], [h, w, 3] or, with opacity, [h, w, 4]; float32 values at points, [n] or [n, 3], for receivers
            without texture coordinates. Shadow maps, uint8, by the light's path and `depth`.
        steps: what the solver did, by domain path; empty at the first frame, which only emits.
    """

    number: int
    smoke: Mapping[str, Smoke]
    pictures: Mapping[tuple[str, str], np.ndarray]
    steps: Mapping[str, "StepReport"]


class Simulation:
    """Runs a scene one frame at a time; fields and pictures can be read, and fields written, between steps.

    On the CPU `.numpy()` of a field is a view, not a copy: what a script writes there is simulated. Advection swaps
    the arrays of the fields, so get them again after each step. Emitters and colliders may be arrays too:
    `ArrayEmitter`, `ArrayCollider`. Results are bit-identical in every run and for any number of threads, provided
    that `on_substep` does the same in every run.

    Attributes:
        plan: the passes that run.
        frame: number of the last finished frame, or None before the first step.
        launcher: the device, with counts of launches and of bytes.
        timings: time of each pass.
        warnings: what the bakes had to leave out.
        on_substep: the script's function called in each substep, or None.
    """

    def __init__(
        self,
        scene: Scene | Plan | str | Path,
        device: str = "cpu",
        threads: int | None = None,
        on_substep: Callable[["SmokeSolver", float, float], None] | None = None,
    ):
        """Makes everything that the plan needs, and nothing else.

        Args:
            scene: a scene, the file of a stage, or a plan made from one.
            device: `cpu`, `cuda` or `cuda:N`.
            threads: CPU threads; all unless given.
            on_substep: called in each substep of each domain after all forces and before the pressure, with the
                domain's solver, the time code at the substep's end and the substep's length [s], for example to add a
                force to `solver.state.velocity`. The first frame is the initial state and has no substeps. With
                `on_substep` the air moves in every domain; a plan made beforehand needs
                `make_plan(scene, "on_substep")` for this.

        Raises:
            FieldError: `on_substep` is given with a plan that leaves the air of a domain still.
            MemoryError: the plan does not fit the device; nothing has been allocated.
        """
        self.plan = scene if isinstance(scene, Plan) else make_plan(scene, "on_substep" if on_substep else "")
        self.on_substep = on_substep
        still = [each.domain.path for each in self.plan.domains if "project_pressure" not in each.passes]
        if on_substep and still:
            allowed = "with a plan from make_plan(scene, 'on_substep'), as the air in this one is still"
            raise FieldError(still[0], "on_substep", "given", allowed)
        self.launcher = Launcher(device, threads)
        self.plan.check_memory(self.launcher.available_bytes(), str(self.launcher.device))
        self.timings = Timings(self.launcher)
        self.frame: int | None = None
        self._still: tuple[wp.array, wp.array, wp.array] | None = None
        with self.timings.measure("load_kernels"):
            load_kernels(kernel_modules(self.plan), device)
        self._solvers = {each.domain.path: self._solver(each) for each in self.plan.domains}
        for solver in self._solvers.values():
            solver.on_substep = on_substep
        self._lighting = Lighting(self.launcher, self.plan, self.timings)
        self.warnings = self._lighting.warnings

    def _solver(self, each: DomainPlan) -> "SmokeSolver":
        from warp_smoke.fluid.solver import SmokeSolver  # not needed without smoke

        return SmokeSolver(self.launcher, each, self.timings)

    def solver(self, path: str | None = None) -> "SmokeSolver":
        """Returns the solver of a domain (the first unless a path is given); its `state` has the fields.

        Raises:
            ValueError: the plan simulates no smoke, or none at this path.
        """
        if not self._solvers:
            why = "; ".join(": ".join((*o.subjects, o.why)) for o in self.plan.left_out if o.name == "simulate")
            raise ValueError(f"the scene calls for no smoke: {why}")
        if path is None:
            path = next(iter(self._solvers))
        if path not in self._solvers:
            raise ValueError(f"domain is {path}; allowed: {', '.join(self._solvers)}")
        return self._solvers[path]

    @property
    def density(self) -> wp.array:
        """The first domain's density at cell centres, [nx, ny, nz], on the device; assign an array to change it."""
        return self.solver().state.density

    @density.setter
    def density(self, values: np.ndarray | wp.array) -> None:
        self._write("density", [self.density], [values])

    @property
    def temperature(self) -> wp.array | None:
        """The first domain's temperature, like `density`; None if neither buoyancy nor an exported grid needs it."""
        return self.solver().state.temperature

    @temperature.setter
    def temperature(self, values: np.ndarray | wp.array) -> None:
        self._write("temperature", [self.temperature], [values])

    @property
    def velocity(self) -> tuple[wp.array, wp.array, wp.array]:
        """The first domain's u, v, w on faces, [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1] [m/s], like `density`.

        If nothing moves the air they are zeros, allocated on first use: values written there have no effect and are
        reset to zero on the next access.
        """
        return self.solver().state.velocity or self._still_air()

    def _still_air(self) -> tuple[wp.array, wp.array, wp.array]:
        if self._still is None:
            shapes = np.add(self.solver().state.density.shape, np.eye(3, dtype=int))
            self._still = tuple(self.launcher.zeros(tuple(map(int, each)), "still_air") for each in shapes)
        for component in self._still:
            component.zero_()
        return self._still

    @velocity.setter
    def velocity(self, values: Sequence[np.ndarray | wp.array]) -> None:
        self._write("velocity", self.solver().state.velocity or [None], values)

    def _write(self, name: str, fields: Sequence[wp.array | None], values: Sequence) -> None:
        """Copies arrays into fields.

        Raises:
            ValueError: the fields are not simulated, or have other shapes.
        """
        path = next(iter(self._solvers))
        if fields[0] is None:
            raise FieldError(path, name, "written", "only where the plan simulates it")
        shapes, wanted = [np.shape(each) for each in values], [each.shape for each in fields]
        if shapes != wanted:
            raise FieldError(path, name, f"of shape {shapes}", f"{wanted}")
        for field, each in zip(fields, values, strict=True):
            field.assign(each)

    def depth_pictures(self) -> dict[str, np.ndarray]:
        """Returns the shadow maps by light path, uint8 (white = far); the six faces of a cube as a cross [3 n, 4 n]."""
        return self._lighting.depth_pictures()

    def step(self) -> Frame:
        """Makes the next frame: the fluid's substeps (at the first frame emission alone), shadows and bakes.

        Frames after the scene's last one may be made too.
        """
        scene = self.plan.scene
        number = scene.start if self.frame is None else self.frame + 1
        steps = {}
        for each in self.plan.domains:
            solver = self._solvers[each.domain.path]
            if self.frame is None:
                solver.begin(number)
            else:
                seconds = each.domain.time_scale / scene.time_codes_per_second
                steps[each.domain.path] = solver.advance(self.frame, number, seconds)
        self.frame = number
        densities = {path: solver.state.density for path, solver in self._solvers.items()}
        pictures = self._lighting.update(number, densities)
        lit = self._lighting.light_volumes(number, densities)
        with self.timings.measure("read_fields"):
            smoke = {each.domain.path: self._smoke(each, lit.get(each.domain.path)) for each in self.plan.domains}
        return Frame(number, smoke, pictures, steps)

    def save(self) -> dict[str, np.ndarray]:
        """Copies everything that later frames depend on to the host, by name; see `load`."""
        return {
            f"{path} {name}": values for path, solver in self._solvers.items() for name, values in solver.save().items()
        }

    def load(self, frame: int, saved: Mapping[str, np.ndarray]) -> None:
        """Restores what `save` returned, before the first step; the frames that follow are bit-identical.

        Args:
            frame: number of the last frame made before `save`.
            saved: the arrays that `save` returned, for the same scene.
        """
        for path, solver in self._solvers.items():
            mine = {name.removeprefix(f"{path} "): each for name, each in saved.items() if name.startswith(f"{path} ")}
            solver.load(mine, self.plan.scene.start, frame)
        densities = {path: solver.state.density for path, solver in self._solvers.items()}
        self._lighting.follow(range(self.plan.scene.start, frame + 1), densities)
        self.frame = frame

    def _smoke(self, each: DomainPlan, light: np.ndarray | None) -> Smoke:
        state = self._solvers[each.domain.path].state
        density = temperature = velocity = None
        if "density" in each.grids:
            density = state.density.numpy().copy()
        if "temperature" in each.grids:
            temperature = state.temperature.numpy().copy()
        if "velocity" in each.grids:
            velocity = np.empty((*each.lattice.shape, 3), np.float32)
            for axis, component in enumerate(state.velocity):
                faces = np.moveaxis(component.numpy(), axis, 0)
                centres = np.moveaxis(velocity[..., axis], axis, 0)
                np.add(faces[1:], faces[:-1], out=centres)
            velocity *= 0.5
        return Smoke(density, temperature, velocity, light)
