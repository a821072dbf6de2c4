"""What the solver did in one step or frame."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from warp_smoke.fluid.pressure import PressureStatus


@dataclass(frozen=True)
class StepReport:
    """What the solver did in one step or frame.

    Attributes:
        substeps: how many steps.
        courant: largest max|u| dt / h that anything was carried with.
        speed: largest |velocity component| at the end [m/s].
        pressure: how well each step's pressure was solved for; empty where nothing flows.
        confinement: smallest share of the vorticity confinement asked for that its cap on kinetic energy let through.
        diffusion: largest bound on the error of diffusion, as a share of the change; 0 where it is exact.
    """

    substeps: int = 1
    courant: float = 0.0
    speed: float = 0.0
    pressure: list[PressureStatus] = field(default_factory=list)
    confinement: float = 1.0
    diffusion: float = 0.0


def join_reports(reports: Sequence[StepReport]) -> StepReport:
    """Of the steps of a frame, the report of that frame."""
    return StepReport(
        substeps=len(reports),
        courant=max(report.courant for report in reports),
        speed=reports[-1].speed,
        pressure=[status for report in reports for status in report.pressure],
        confinement=min(report.confinement for report in reports),
        diffusion=max(report.diffusion for report in reports),
    )
