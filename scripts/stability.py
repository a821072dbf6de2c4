#!/usr/bin/env python
"""Writes docs/stability.md: every hard case that is tested, its number of variants, and its worst figures.

Runs tests/stability and the tests named below on all processors, slow ones included; figures are those that tests pass
to `record_property`.

    .venv/bin/python scripts/stability.py
"""

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/stability.md"
# Hard cases that are tested next to the part that they exercise: section of the page → names of tests or files.
ELSEWHERE = {
    "test_large_steps": ["test_huge_steps_stay_bounded"],
    "test_extreme_values": ["test_any_coefficient_is_stable", "test_diffusion_is_stable"],
    "test_limiters": ["test_stays_within_its_range"],
    "test_confinement": [
        "test_gain_is_capped",
        "test_energy_never_grows_without_a_force",
        "test_strength_of_zero_changes_nothing",
    ],
    "test_closed_boxes": ["test_solid_all_but_one_cell", "test_components.py"],
    "test_out_of_iterations": ["test_smooth_source_stops_at_round_off", "test_error_falls_in_the_energy_norm"],
    "Thin and fast": [
        "test_plume_under_a_sheet",
        "test_source_in_a_closed_shell",
        "test_fast_walls_take_more_steps",
        "test_rate_adds_the_same_mass_for_any_number_of_steps",
        "test_moving_ball_adds_its_mass",
        "test_moving_emitter_leaves_no_gaps",
    ],
    "test_shapes_of_domain": ["test_thin_domains_run"],
    "Ten thousand steps": ["test_ten_thousand_steps_in_a_closed_box"],
    "Bad numbers": [
        "test_bad_fields_are_named",
        "test_frame_range",
        "test_bad_values_are_named_in_one_line",
        "test_bad_settings_are_named_in_one_line",
        "test_stops_at_what_is_not_finite",
        "test_a_field_that_is_not_finite_keeps_the_checkpoint",
    ],
    "Reruns and threads": [
        "test_same_bits_for_any_number_of_threads",
        "test_the_same_files_for_any_number_of_threads",
        "test_same_scene_same_bytes",
    ],
    "Rays through edges and vertices": [
        "test_closed_mesh_never_leaks",
        "test_axis_aligned_rays_hit_from_a_side_of_the_bounds",
    ],
    "test_lights": ["test_light_on_or_in_a_mesh"],
    "Seams of cube maps": ["test_step_across_a_seam", "test_room_matches_rays_also_at_seams"],
    "test_scale_and_origin": [
        "test_mirrored_scene_gives_mirrored_smoke",
        "test_far_from_the_origin_nothing_changes",
    ],
    "Stopped and killed": [
        "test_a_run_that_goes_on_gives_the_same_files",
        "test_stops_between_frames",
        "test_stops_at_any_moment",
        "test_killed_twenty_times",
        "test_a_checkpoint_of_another_scene_is_refused",
        "test_a_checkpoint_of_another_version_is_refused",
        "test_damage_is_noticed",
        "test_a_second_run_is_refused",
    ],
    "Disk and memory": ["test_full_disk.py", "test_resources.py"],
    "test_any_bytes": [
        "test_missing_references",
        "test_missing_sublayer",
        "test_noise_never_crashes",
        "test_probe.py",
        "test_vdb_read.py",
    ],
}
HEAD = """# Hard cases

What must hold where simulations and shadows usually break, each line a test, and the worst figure over all variants.
Written by `scripts/stability.py` from the run of these tests; a figure of 0 is exact. What happens to a run that is
stopped, killed or out of disk is on [a page of its own](long_runs.md).
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
        """Records what each test and each file shows."""
        for item in items:
            name = item.nodeid.partition("[")[0]
            self.lines.setdefault(name, Line(item.function.__doc__.strip().splitlines()[0]))
            if item.path.parent.name == "stability":
                self.titles[item.path.stem] = item.module.__doc__.strip().splitlines()[0]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Records a variant's result and figures."""
        if report.when != "call":
            return
        line = self.lines[report.nodeid.partition("[")[0]]
        line.passed += report.passed
        line.failed += report.failed
        for name, value in report.user_properties:
            line.figures[name] = max(value, line.figures.get(name, value))


def find(name: str) -> Iterator[str]:
    """Yields the pytest ids of the tests with a name, or of the file with that name, anywhere in tests/."""
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        if file.name == name:
            yield str(file.relative_to(ROOT))
        elif re.search(rf"^def {name}\(", file.read_text(encoding="utf-8"), re.MULTILINE):
            yield f"{file.relative_to(ROOT)}::{name}"


def page(lines: dict[str, Line], titles: dict[str, str]) -> str:
    """Returns the page's text."""
    text = [HEAD]
    for section in dict.fromkeys([*ELSEWHERE, *sorted(titles)]):
        own = [name for name in lines if Path(name.partition("::")[0]).stem == section and "/stability/" in name]
        named = tuple(each for name in ELSEWHERE.get(section, ()) for each in find(name))
        others = [name for name in lines if named and f"{name}::".startswith(tuple(f"{each}::" for each in named))]
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
    tests = [str(ROOT / each) for names in ELSEWHERE.values() for name in names for each in find(name)]
    args = ["--rootdir", str(ROOT), str(ROOT / "tests/stability"), *dict.fromkeys(tests), "-m", "slow or not slow"]
    pytest.main([*args, "--collect-only", "-q", "--no-summary"], plugins=[recorder])
    status = pytest.main([*args, "-n", "auto", "--dist", "worksteal", *options], plugins=[recorder])
    if status in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        PAGE.write_text(page(recorder.lines, recorder.titles), encoding="utf-8")
    return int(status)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
