"""Reading of dome lights' sky pictures, for the mean light from all directions."""

from warp_smoke.sky.mean import UnsupportedPicture, mean_radiance

__all__ = ["UnsupportedPicture", "mean_radiance"]
