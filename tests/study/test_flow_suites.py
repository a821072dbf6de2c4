"""The suites advection, pressure and flow: known orders hold, and wrong schemes are caught."""

from dataclasses import replace

import numpy as np
import pytest
from study_rows import make_row

from warp_smoke.fluid.advection import SemiLagrangian
from warp_smoke.fluid.maccormack import MacCormack
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.study import advection, flow, measure, pressure
from warp_smoke.study.case import panel_error
from warp_smoke.study.measure import measure_case
from warp_smoke.study.suites import SUITES, load_suite


def _rows(launcher, cases):
    rows = [measure_case(launcher, case, 10.0) for case in cases]
    assert [row.failure for row in rows] == [None] * len(rows)
    return rows


class _Late(MacCormack):
    """Traces a tenth too short."""

    def trace(self, velocity, step):
        super().trace(velocity, 0.9 * step)


class _Doubled(MacCormack):
    """Adds the whole error instead of taking half of it off."""

    def advect_scalar(self, field, ambient):
        old = field.numpy().copy()
        new = super().advect_scalar(field, ambient)
        new.assign(new.numpy() + 0.2 * (new.numpy() - old))
        return new


def _hill(launcher, scheme, made):
    sizes = (32, 64, 128)
    cases = [advection.turning_case(advection.HILL, scheme, made, n, 1.0) for n in sizes]
    return _rows(launcher, cases)


@pytest.mark.parametrize("scheme", ADVECTION_SCHEMES | advection.UNLIMITED)
def test_hill_has_the_known_orders(launcher, scheme):
    """Nothing is unexpected about any scheme on the turning hill, and its mass and range are reported."""
    rows = _hill(launcher, scheme, (ADVECTION_SCHEMES | advection.UNLIMITED)[scheme])
    assert advection.unexpected(rows) == []
    assert all({"mass_drift", "least", "most"} <= row.errors.keys() for row in rows)


@pytest.mark.parametrize("wrong", [_Late, _Doubled, SemiLagrangian])
def test_wrong_schemes_are_caught(launcher, wrong):
    """A scheme with a mistake, and one of order 1 in the place of one of order 2, give a line that says so."""
    assert advection.unexpected(_hill(launcher, "maccormack", wrong))


def test_leaving_the_range_is_caught(launcher):
    """Negative smoke is as good as none without limits, and a mistake with them."""
    name = "maccormack, unlimited"
    rows = _hill(launcher, name, advection.UNLIMITED[name])
    assert min(row.errors["least"] for row in rows) < 0
    assert advection.unexpected([replace(rows[0], method="maccormack")])


def test_small_steps_make_semi_lagrangian_worse(launcher):
    """Its error grows as its steps shrink, as its many interpolations smear: like h²/Δt."""
    errors = []
    for courant in (4.0, 2.0, 1.0):
        case = advection.turning_case(advection.STEPS, "semi_lagrangian", SemiLagrangian, 64, courant)
        errors.append(_rows(launcher, [case])[0].errors["relative_l2"])
    assert errors == sorted(errors)


def test_known_pressure_has_order_two(launcher):
    """The error against the manufactured pressure falls with order 2; one that stops falling is caught."""
    cases = [case for case in pressure.cases(False) if case.problem == pressure.MANUFACTURED]
    rows = _rows(launcher, [case for case in cases if case.method in ("spectral", "multigrid")])
    assert pressure.unexpected(rows) == []
    assert list(pressure.order(rows).values()) == pytest.approx([2.0, 2.0], abs=0.05)
    off = [replace(row, errors=row.errors | {"relative_l2": row.errors["relative_l2"] + 0.01}) for row in rows]
    assert len(pressure.unexpected(off)) == 2


def test_solvers_reach_what_they_are_asked_for(launcher):
    """Around pockets, walls and a sphere, multigrid leaves what its tolerance says by an independent residual."""
    problems = ("sphere", "thin walls", "pockets")
    rows = _rows(launcher, [pressure.projecting_case(name, "multigrid", 24, {"tolerance": 1e-3}) for name in problems])
    assert pressure.unexpected(rows) == []
    assert all(0 < row.errors["residual"] <= 1e-3 for row in rows)
    lazy = replace(rows[0], errors=rows[0].errors | {"residual": 2e-3})
    assert pressure.unexpected([lazy])


def test_what_does_not_fit_in_memory_says_so(launcher, monkeypatch):
    """A full study offers 256³ cells; where there is less memory than they need, each of these rows says how much."""
    large = [case for case in pressure.cases(True) if case.resolution == 256]
    assert {case.method for case in large} == {"spectral", "multigrid", "spectral_conjugate_gradient"}
    monkeypatch.setattr(launcher, "available_bytes", lambda: 2**31)
    failures = {measure_case(launcher, case, 10.0).failure for case in large}
    assert failures == {"MemoryError: 256³ cells need 4.0 GiB; 2.0 GiB are free"}
    assert not [case for case in pressure.cases(False) if case.resolution > 64]


def test_vortex_has_the_known_orders(launcher):
    """MacCormack steps have order 2, and first-order ones passed off as it are caught."""
    rows = _rows(launcher, [flow.vortex_case("maccormack", n) for n in (8, 16, 32)])
    assert flow.unexpected(rows) == []
    first = _rows(launcher, [flow.vortex_case("semi_lagrangian", n) for n in (8, 16, 32)])
    assert flow.unexpected(first) == []
    assert flow.unexpected([replace(row, method="maccormack") for row in first])


def test_a_cavity_that_does_not_converge_is_caught():
    """Half of a cell has to halve the deviation from Ghia's velocity, until it is as small as that is exact."""

    def found(*errors):
        sizes = (32, 64, 128)
        rows = [
            make_row(problem="cavity, Re 400", method="maccormack", resolution=n, errors={"linf": error})
            for n, error in zip(sizes, errors, strict=True)
        ]
        return flow.unexpected(rows)

    assert found(0.08, 0.04, 0.02) == found(0.03, 0.012, 0.013) == []
    assert found(0.08, 0.04, 0.03) == [
        "cavity, Re 400: the error goes from 0.040 on 64² to 0.030 on 128² cells; expected to fall like the cells' size"
    ]


@pytest.mark.parametrize("name", SUITES)
@pytest.mark.parametrize("full", [False, True])
def test_cases_are_well_formed(name, full):
    """Every case of a suite has a key of its own and names the suite."""
    cases = load_suite(name).cases(full)
    assert len({case.key for case in cases}) == len(cases) > 0
    assert {case.suite for case in cases} == {name}


@pytest.mark.slow
@pytest.mark.parametrize("name", SUITES)
def test_quick_suites_are_as_known_answers_ask(launcher, name, monkeypatch):
    """A whole quick suite: no failure, nothing unexpected, the errors of its panels are there, two sentences."""
    monkeypatch.setattr(measure, "REPEATS", 1)  # errors are asked for, not times
    suite = load_suite(name)
    rows = _rows(launcher, suite.cases(False))
    assert suite.unexpected(rows) == []
    for row in rows:
        error, _ = panel_error(suite, row.problem)
        assert np.isfinite(row.errors[error])
    assert len(suite.explain(rows)) > 80
