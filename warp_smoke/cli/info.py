"""`warp-smoke info`: what the package runs on."""

import json

from warp_smoke.cli.console import out
from warp_smoke.cli.options import Json


def info(*, as_json: Json = False):
    """Print versions, devices, threads and the folder of the kernel cache.

    Args:
        as_json: Print as JSON.
    """
    import warp as wp

    from warp_smoke.report import environment

    facts = environment() | {"kernel cache": str(wp.config.kernel_cache_dir)}
    if as_json:
        print(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        out.print(f"{name:14} {value}", soft_wrap=True, highlight=False)
