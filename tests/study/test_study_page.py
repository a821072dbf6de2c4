"""The page and the diagrams."""

import re
from io import BytesIO

import numpy as np
from PIL import Image
from study_rows import FakeSuite, make_row

from warp_smoke.study.page import results_page
from warp_smoke.study.plot import LIGHT, draw_diagram, picture, varying

SUITE = FakeSuite({})
ROWS = [
    make_row(method="a", resolution=8, median=1.0, errors={"l2": 0.1, "linf": 0.4}),
    make_row(method="a", resolution=16, median=8.0, errors={"l2": 0.02, "linf": 0.1}),
    make_row(method="b<c", resolution=8, median=2.0, errors={"l2": 0.3, "linf": 0.9}),
    make_row(method="d", key="failed", median=None, errors={}, failure="ValueError: <b>no</b>"),
]


def _page() -> str:
    return results_page({"device": "cpu", "commit": None}, {"fake": SUITE}, {"fake": ROWS}, "a machine")


def test_page_is_self_contained():
    """Nothing is loaded: pictures are in the file, and there is no address of another one."""
    page = _page()
    sources = re.findall(r'(?:src|srcset|href)="([^"]*)"', page)
    assert len(sources) == 3  # a link to the section, and its diagram in light and dark
    assert all(source.startswith(("data:image/svg+xml;base64,", "#")) for source in sources)
    assert not re.search(r"https?:|@import|url\(|<script", re.sub(r'"data:[^"]*"', "", page))


def test_dominated_rows_are_grey():
    """The two rows that nothing beats are not grey, the third one is, and the failure says why."""
    rows = re.findall(r'<tr(?: class="(\w+)")?><td>(.*?)</td><td>', _page())
    assert [row for row in rows if row[0] in ("front", "beaten")] == [
        ("front", "a"),
        ("beaten", "b&lt;c"),
        ("front", "a"),
    ]
    assert "failed: ValueError: &lt;b&gt;no&lt;/b&gt;" in _page()


def test_page_says_how_to_read_it():
    """The suite's sentences stand above its diagram."""
    page = _page()
    assert page.index("Read it so. It says that.") < page.index("<picture>")


def test_effects_cost_what_they_save():
    """An effect without which a frame takes 6 ms instead of 10 ms costs 4 ms, 40 % of it."""
    whole = make_row(problem="effects", method="everything", median=0.010, errors={"l2": 0.0}, passes={"bake": 0.002})
    without = make_row(problem="effects", method="wind", median=0.006, errors={"l2": 0.25})
    suite = FakeSuite({})
    suite.TABLES = {"effects": "all of it"}
    page = results_page({}, {"fake": suite}, {"fake": [whole, without]}, "")
    assert re.search(r'<td>wind</td><td class="n">4 ms</td><td class="n">40 %</td>.*?<td class="n">25 %</td>', page)
    assert re.search(r'<td>bake</td><td class="n">2 ms</td>', page)
    assert "<picture>" not in page


def test_what_varies_is_written_at_the_points():
    """Along a line of resolutions the resolution, although the step changes with it; along one of tolerances these."""
    rows = [make_row(resolution=n, dt=1 / n, parameters={"tolerance": 0.1}) for n in (8, 16)]
    assert varying(rows) == ["resolution"]
    rows = [make_row(key=str(t), parameters={"tolerance": t}) for t in (0.1, 0.01)]
    assert varying(rows) == ["tolerance"]


def test_diagram_takes_what_cannot_be_drawn_on_logarithmic_axes():
    """An error of 0, a single point, and a panel in which every run failed."""
    rows = [*ROWS, make_row(problem="exact", errors={"l2": 0.0}), make_row(problem="none", failure="no", errors={})]
    figure = draw_diagram(SUITE, rows, title="t", note="n")
    image = np.asarray(Image.open(BytesIO(picture(figure, "png", 50))))
    assert image.shape[0] > 100
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert "every run failed" in texts
    assert any("no error" in text for text in texts)


def test_labels_hide_neither_points_nor_each_other():
    """The labels of twelve points close together do not overlap."""
    rows = [
        make_row(method=method, resolution=n, median=0.1 * n * (1 + 0.1 * m), errors={"l2": (1 + 0.2 * m) / n})
        for m, method in enumerate("abc")
        for n in (8, 16, 32, 64)
    ]
    figure = draw_diagram(SUITE, rows, LIGHT)
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.axes[0].texts if text.get_text().isdigit()]
    assert len(boxes) == 12
    assert not any(a.overlaps(b) for n, a in enumerate(boxes) for b in boxes[:n])
