"""The suite of smoke shadows: closed forms and orders hold, and wrong splats and sweeps are caught."""

import numpy as np
import pytest

from warp_smoke.shadow import diffusion
from warp_smoke.shadow.splats import SPLATS
from warp_smoke.study import smoke_shadow
from warp_smoke.study.light_answers import difference
from warp_smoke.study.measure import measure_case


def rows_of(launcher, problem, methods=None):
    """The suite's rows of a problem."""
    chosen = [case for case in smoke_shadow.cases(full=False) if case.problem == problem]
    return [measure_case(launcher, case, 10.0) for case in chosen if methods is None or case.method in methods]


def test_keys_are_unique():
    """No two cases are taken for one when a study goes on."""
    for full in (False, True):
        keys = [case.key for case in smoke_shadow.cases(full)]
        assert len(set(keys)) == len(keys)


@pytest.fixture(scope="module")
def blob(launcher):
    """All rows of the Gaussian blob."""
    return rows_of(launcher, "Gaussian blob")


def test_orders_on_the_blob(blob):
    """Second for march, Gaussian, footprint and rays; the published linear opacity does not converge."""
    assert [row.failure for row in blob] == [None] * len(blob)
    assert smoke_shadow.unexpected(blob) == []
    orders = smoke_shadow.order(blob)
    for method in ("march", "gaussian", "footprint", "ray_traced"):
        assert orders["Gaussian blob", method] == pytest.approx(2.0, abs=0.1)
    assert abs(orders["Gaussian blob", "dpd"]) < 0.3
    assert all(row.errors["mass"] < 1e-5 for row in blob if row.method in ("march", *SPLATS))


def test_slab_is_exact(launcher):
    """Under a point light march and footprint are exact on a slab; nearest is not."""
    rows = rows_of(launcher, "slab", ("march", "footprint", "nearest"))
    assert smoke_shadow.unexpected(rows) == []
    worst = {method: max(r.errors["linf"] for r in rows if r.method == method) for method in ("footprint", "nearest")}
    assert worst["footprint"] < 1e-6
    assert worst["nearest"] > 1e-3


@pytest.mark.parametrize(
    ("weigh", "said"),
    [
        (lambda begin, end, a: SPLATS["bilinear"].weigh(begin + 0.5, end + 0.5, a), "order"),
        (lambda begin, end, a: 0.99 * SPLATS["bilinear"].weigh(begin, end, a), "mass"),
    ],
    ids=["half a texel aside", "1 % lost"],
)
def test_wrong_splats_are_caught(launcher, monkeypatch, weigh, said):
    """A splat that lands half a texel aside has the wrong order; one that loses smoke has the wrong mass."""
    monkeypatch.setitem(SPLATS, "gaussian", SPLATS["gaussian"]._replace(weigh=weigh))
    found = smoke_shadow.unexpected(rows_of(launcher, "Gaussian blob", ("gaussian",)))
    assert found
    assert all("Gaussian blob, gaussian" in line for line in found)
    assert any(said in line for line in found)


def test_energy_diffusion(launcher):
    """Substeps and the exact answer diffuse as diffusion does, at second order; the paper's sweep keeps 1/(1 + 4 r)."""
    rows = rows_of(launcher, "Gaussian, diffused")
    assert smoke_shadow.unexpected(rows) == []
    kept = {row.resolution: row.errors["variance_kept"] for row in rows if row.method == "paper"}
    assert kept == pytest.approx({16: 1 / 2, 32: 1 / 5, 64: 1 / 17, 128: 1 / 65}, rel=1e-3)


def test_the_paper_s_sweep_is_no_implicit_step(launcher):
    """For r = 1 the kernel is 1.06 away (L1), and after 32 Jacobi sweeps 7e-4: the table of the sources."""
    rows = rows_of(launcher, "implicit step, r = 1")
    distance = {(row.method, row.parameters.get("sweeps")): row.errors["l1_distance"] for row in rows}
    assert distance["paper", None] == distance["sweeps", 1] == pytest.approx(1.06, abs=0.005)
    assert distance["sweeps", 32] < 1e-3 < distance["sweeps", 16]
    assert smoke_shadow.unexpected(rows) == []


def test_a_wrong_sweep_is_caught(launcher, monkeypatch):
    """Substeps that spread by half of what is asked for do not converge."""
    spread = diffusion.Diffusion.__init__
    monkeypatch.setattr(diffusion.Diffusion, "__init__", lambda self, a, b, r, c, d: spread(self, a, b, 0.5 * r, c, d))
    found = smoke_shadow.unexpected(rows_of(launcher, "Gaussian, diffused", ("exact", "paper")))
    assert any("exact: order" in line for line in found)
    assert any("paper, 64: keeps" in line for line in found)


def test_plume_against_fine_rays(launcher):
    """Finer buffers and shorter steps come nearer to fine rays; the errors are a share of the shadow itself."""
    rows = rows_of(launcher, "plume", ("march", "ray_traced", "dpd"))
    march = [row.errors["relative_l2"] for row in rows if row.method == "march"]
    rays = [row.errors["relative_l2"] for row in rows if row.method == "ray_traced"]
    assert march == sorted(march, reverse=True)
    assert rays == sorted(rays, reverse=True)
    assert rays[-1] < 0.01
    plume = smoke_shadow.plume_frame(launcher.device.alias)
    assert plume.truth.min() < 0.1  # it is dark
    whole = np.sqrt(np.mean((1.0 - plume.truth) ** 2))
    assert difference(np.ones_like(plume.truth), plume.truth, whole)["relative_l2"] == pytest.approx(1.0)
    text = smoke_shadow.explain(rows)
    assert "On the plume ray_traced comes closest" in text
    assert "march with 96 texels" in text


def test_nothing_measured_is_no_claim():
    """Without rows the diagram is explained, and nothing is said of it."""
    assert smoke_shadow.explain([]).endswith("further left is faster.")
    assert smoke_shadow.unexpected([]) == []
