"""What the solver did in one step or frame."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from warp_smoke.fluid.pressure import PressureStatus


@dataclass(frozen=True)
class StepReport:
    """What the solver did in one step or frame.

    Attributes:
        substeps: number of steps.
        courant: largest max|u| dt / h of any advection.
        speed: largest |velocity component| at the end [m/s].
        pressure: status of each step's pressure solve; empty if nothing flows.
        confinement: smallest share of the requested vorticity confinement that its cap on kinetic energy allowed.
        diffusion: largest bound on the error of diffusion, as a share of the change; 0 if diffusion is exact.
    """

    substeps: int = 1
    courant: float = 0.0
    speed: float = 0.0
    pressure: list[PressureStatus] = field(default_factory=list)
    confinement: float = 1.0
    diffusion: float = 0.0


def join_reports(reports: Sequence[StepReport]) -> StepReport:
    """Joins the reports of a frame's steps into that of the frame."""
    return StepReport(
        substeps=len(reports),
        courant=max(report.courant for report in reports),
        speed=reports[-1].speed,
        pressure=[status for report in reports for status in report.pressure],
        confinement=min(report.confinement for report in reports),
        diffusion=max(report.diffusion for report in reports),
    )
