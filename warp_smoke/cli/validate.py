"""`warp-smoke validate`: whether every DCC accepts a stage."""

import json
from dataclasses import asdict
from pathlib import Path

from warp_smoke.cli.console import out
from warp_smoke.cli.options import Json
from warp_smoke.usd.find import find_stage

_PARTS = {"stage": "Your stage", "results": "The layers that the run wrote over it"}


def validate(path: Path, *, as_json: Json = False):
    """Check whether every DCC accepts a stage; exit status 1 if it has errors, 0 if it has only warnings.

    For a folder of results, the problems of your stage and those of what the run wrote are listed separately.

    Args:
        path: A USD stage or a folder written by `run`.
        as_json: Print the problems as JSON.
    """
    from warp_smoke.usd.probe import check_readable
    from warp_smoke.usd.validate import validate_stage

    check_readable(find_stage(path))
    problems = validate_stage(path)
    if as_json:
        print(json.dumps([asdict(problem) for problem in problems], indent=2, default=str))
    else:
        for part, title in _PARTS.items():
            of_part = [problem for problem in problems if problem.part == part]
            if of_part and path.is_dir():
                out.print(f"{title}:", highlight=False)
            for problem in of_part:
                out.print(str(problem), soft_wrap=True)
        severities = [problem.severity for problem in problems]
        counts = [f"{severities.count(each)} {each}(s)" for each in dict.fromkeys(severities)]
        out.print(f"{path}: {', '.join(counts) or 'no problems'}", soft_wrap=True, highlight=False)
    return 1 if any(problem.severity == "error" for problem in problems) else 0
