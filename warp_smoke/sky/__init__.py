"""Pictures of the sky, as dome lights have them: how much light comes from everywhere."""

from warp_smoke.sky.mean import UnsupportedPicture, mean_radiance

__all__ = ["UnsupportedPicture", "mean_radiance"]
