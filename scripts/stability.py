#!/usr/bin/env python
"""Writes docs/stability.md: every hard case that is tested, in how many variants, and the worst figure of each.

Runs tests/stability and the tests named below, slow ones too; figures are what tests give to `record_property`.

    .venv/bin/python scripts/stability.py
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/stability.md"
# Hard cases that are tested beside the part that they try: page section → title and tests.
ELSEWHERE = {
    "test_large_steps": ["fluid/test_solver.py::test_huge_steps_stay_bounded"],
    "test_extreme_values": [
        "fluid/test_diffusion.py::test_any_coefficient_is_stable",
        "fluid/test_solver.py::test_diffusion_is_stable",
    ],
    "test_limiters": ["fluid/test_advection.py::test_stays_within_its_range"],
    "test_confinement": [
        "fluid/test_vorticity.py::test_gain_is_capped",
        "fluid/test_solver.py::test_energy_never_grows_without_a_force",
        "fluid/test_solver.py::test_strength_of_zero_changes_nothing",
    ],
    "test_closed_boxes": [
        "fluid/test_thin_walls.py::test_solid_all_but_one_cell",
        "fluid/test_components.py",
    ],
    "Thin and fast": [
        "fluid/test_thin_walls.py",
        "fluid/test_emitters.py::test_rate_adds_the_same_mass_for_any_number_of_steps",
        "fluid/test_emitters.py::test_moving_ball_adds_its_mass",
        "fluid/test_emitters.py::test_moving_emitter_leaves_no_gaps",
    ],
    "test_shapes_of_domain": ["fluid/test_solver.py::test_thin_domains_run"],
    "Bad numbers": [
        "test_scene.py::test_bad_fields_are_named",
        "test_scene.py::test_frame_range",
        "usd/test_read.py::test_bad_values_are_named_in_one_line",
        "usd/test_read.py::test_bad_settings_are_named_in_one_line",
        "fluid/test_solver.py::test_stops_at_what_is_not_finite",
    ],
    "Rays through edges and vertices": [
        "shadow/test_casters.py::test_closed_mesh_never_leaks",
        "shadow/test_casters.py::test_axis_aligned_rays_hit_from_a_side_of_the_bounds",
    ],
    "test_lights": ["shadow/test_cube.py::test_light_on_or_in_a_mesh"],
    "Seams of cube maps": [
        "shadow/test_cube.py::test_step_across_a_seam",
        "shadow/test_cube.py::test_room_matches_rays_also_at_seams",
    ],
    "test_scale_and_origin": [
        "fluid/test_solver.py::test_mirrored_scene_gives_mirrored_smoke",
        "shadow/test_casters.py::test_far_from_the_origin_nothing_changes",
    ],
    "Reruns and threads": ["test_simulation.py::test_same_bits_for_any_number_of_threads"],
    "test_any_bytes": ["usd/test_read.py::test_noise_never_crashes", "vdb/test_vdb_read.py"],
}
HEAD = """# Hard cases

What must hold where simulations and shadows usually break, each line a test, and the worst figure over all variants.
Written by `scripts/stability.py` from the run of these tests; a figure of 0 is exact. Long runs, checkpoints and full
disks have [a page of their own](long_runs.md).
"""


@dataclass
class Line:
    """One test: what it shows, its variants, and the largest of each figure."""

    shows: str
    passed: int = 0
    failed: int = 0
    figures: dict[str, float] = field(default_factory=dict)


class Recorder:
    """A pytest plugin that collects a line for each test function."""

    def __init__(self):
        self.lines: dict[str, Line] = {}
        self.titles: dict[str, str] = {}

    def pytest_collection_modifyitems(self, items: list[pytest.Function]) -> None:
        """Notes what each test and each file shows."""
        for item in items:
            name = item.nodeid.partition("[")[0]
            self.lines.setdefault(name, Line(item.function.__doc__.strip().splitlines()[0]))
            if item.path.parent.name == "stability":
                self.titles[item.path.stem] = item.module.__doc__.strip().splitlines()[0]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Takes a variant's result and figures."""
        if report.when != "call":
            return
        line = self.lines[report.nodeid.partition("[")[0]]
        line.passed += report.passed
        line.failed += report.failed
        for name, value in report.user_properties:
            line.figures[name] = max(value, line.figures.get(name, value))


def page(lines: dict[str, Line], titles: dict[str, str]) -> str:
    """The page's text."""
    text = [HEAD]
    for section in dict.fromkeys([*ELSEWHERE, *sorted(titles)]):
        own = [name for name in lines if Path(name.partition("::")[0]).stem == section and "/stability/" in name]
        others = [
            name for name in lines if any(name.startswith(f"tests/{each}") for each in ELSEWHERE.get(section, ()))
        ]
        if own or others:
            heading = section.removeprefix("test_").replace("_", " ").capitalize()
            text += [f"## {heading}\n"] + ([f"{titles[section]}\n"] if own else [])
            text += ["| must hold | variants | worst |", "|---|---|---|"]
            text += [_row(lines[name]) for name in dict.fromkeys([*own, *others])] + [""]
    return "\n".join(text)


def _row(line: Line) -> str:
    figures = "; ".join(f"{name} {value:.2g}" for name, value in line.figures.items())
    count = f"{line.passed}" + (f" and {line.failed} that fail" if line.failed else "")
    return f"| {line.shows.replace('|', '∣')} | {count} | {figures} |"


def main(options: Iterable[str]) -> int:
    """Runs the tests and writes the page."""
    recorder = Recorder()
    elsewhere = [str(ROOT / "tests" / each) for tests in ELSEWHERE.values() for each in tests]
    args = [str(ROOT / "tests/stability"), *dict.fromkeys(elsewhere), "-m", "slow or not slow", *options]
    status = pytest.main(["--rootdir", str(ROOT), *args], plugins=[recorder])
    if status in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        PAGE.write_text(page(recorder.lines, recorder.titles), encoding="utf-8")
    return int(status)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
