"""The advection schemes by name; all fields of a domain are advected by the same one."""

from warp_smoke.fluid.advection import SemiLagrangian
from warp_smoke.fluid.bfecc import Bfecc
from warp_smoke.fluid.cubic import CubicSemiLagrangian
from warp_smoke.fluid.maccormack import MacCormack

ADVECTION_SCHEMES = {
    "semi_lagrangian": SemiLagrangian,
    "semi_lagrangian_cubic": CubicSemiLagrangian,
    "maccormack": MacCormack,
    "bfecc": Bfecc,
}
