"""The plan: the passes that a scene's outputs need, in order, and why every other pass is left out."""

from warp_smoke.plan.passes import DepthPlan, DomainPlan, LeftOut, LightPlan, Pass, ReceiverPlan, When
from warp_smoke.plan.plan import Plan
from warp_smoke.plan.planner import make_plan

__all__ = ["DepthPlan", "DomainPlan", "LeftOut", "LightPlan", "Pass", "Plan", "ReceiverPlan", "When", "make_plan"]
