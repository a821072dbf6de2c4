"""Work–precision diagrams: error against time, both logarithmic, one panel per problem, one line per method."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from math import hypot
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator, NullFormatter

from warp_smoke.study.case import Row, Suite, panel_error
from warp_smoke.study.front import pareto_front
from warp_smoke.study.words import by_method

_MARKERS = "osD^vPXp"
_DASHES = ("-", (0, (4, 1.5)), (0, (1, 1.5)))
_PANEL = (4.4, 3.6)  # width and height [inch]
_POINTS_PER_INCH = 72
_LABEL_SIZE = 7
# Letters per line of an axis label; most lines in a panel whose points are all labelled, not only the front's.
_LABEL_LETTERS, _MOST_LABELLED = 44, 8
# Ticks in each decade, for axes with fewer decades than the first number.
_TICKS = ((0.5, (1, 1.5, 2, 3, 4, 5, 6, 8)), (1.0, (1, 2, 3, 5, 7)), (2.0, (1, 2, 5)), (np.inf, (1,)))
# Where a label may stand around its point: directions, best first, and distances [points].
_DIRECTIONS = ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0))
_DISTANCES = (5.0, 9.0, 14.0)


@dataclass(frozen=True)
class Theme:
    """Colours of a diagram; those of the lines can be told apart by people with any colour vision.

    M. Okabe, K. Ito, *Color Universal Design*, 2008; lightened on the dark ground.
    """

    ground: str
    ink: str
    faint: str
    lines: tuple[str, ...]


LIGHT = Theme(
    "#ffffff",
    "#1f2328",
    "#d7dade",
    ("#0072b2", "#d55e00", "#009e73", "#b0458a", "#b57e00", "#3ba3dd", "#1f2328"),
)
DARK = Theme(
    "#16191d",
    "#e6e8ea",
    "#3a4047",
    ("#5fb4ee", "#ff8a4c", "#35cfa3", "#e79bc8", "#f0c04f", "#a9d8f5", "#e6e8ea"),
)


def draw_diagram(suite: Suite, rows: Sequence[Row], theme: Theme = LIGHT, *, title: str = "", note: str = "") -> Figure:
    """Draws the diagram of a suite.

    Args:
        suite: names the errors.
        rows: of the suite.
        theme: its colours.
        title: above it.
        note: at its foot.
    """
    problems = list(dict.fromkeys(row.problem for row in rows))
    methods = list(dict.fromkeys(row.method for row in rows))
    styles = {method: _style(index, theme) for index, method in enumerate(methods)}
    columns = min(len(problems), 2 if len(problems) == 4 else 3)
    lines = -(-len(problems) // columns)
    legend = _legend(styles, theme)
    legend_columns = min(len(legend), max(2, 2 * columns))
    above, below = 0.3 * bool(title), 0.3 * bool(note)
    head = above + 0.15 + 0.22 * -(-len(legend) // legend_columns)
    width, height = _PANEL[0] * columns, _PANEL[1] * lines + head + below
    figure = Figure(figsize=(width, height), facecolor=theme.ground, layout="constrained")
    FigureCanvasAgg(figure)
    inner = (0.005, below / height, 0.99, 1 - (head + below) / height)
    figure.get_layout_engine().set(rect=inner, wspace=0.04, hspace=0.06)
    placed = []
    for index, problem in enumerate(problems):
        axes = figure.add_subplot(lines, columns, index + 1)
        placed.append((axes, _draw_panel(axes, suite, [row for row in rows if row.problem == problem], styles, theme)))
    figure.text(0.01, 1 - 0.08 / height, title, va="top", fontsize=12, fontweight="bold", color=theme.ink)
    figure.text(0.01, 0.07 / height, note, va="bottom", fontsize=6.5, color=theme.ink, alpha=0.75)
    figure.legend(
        handles=legend,
        loc="upper left",
        bbox_to_anchor=(0.0, 1 - above / height),
        ncols=legend_columns,
        fontsize=8,
        frameon=False,
        labelcolor=theme.ink,
        handlelength=2.4,
        columnspacing=1.6,
    )
    figure.canvas.draw()
    for axes, labels in placed:
        if labels:
            _place_labels(axes, labels)
    return figure


def _legend(styles: dict[str, dict], theme: Theme) -> list[Line2D]:
    """Explains the lines and the filling of the points."""
    handles = [Line2D([], [], label=method, **style) for method, style in styles.items()]
    for label, face in (
        ("filled: nothing is both faster and better", theme.ink),
        ("hollow: something is", theme.ground),
    ):
        point = {"linestyle": "", "marker": "o", "ms": 5, "color": theme.ink, "markerfacecolor": face}
        handles.append(Line2D([], [], label=label, alpha=0.6, **point))
    return handles


def picture(figure: Figure, kind: str, dots_per_inch: int = 150) -> bytes:
    """Returns a figure as `png` or `svg`, without the date, so that equal figures give equal bytes."""
    stream = BytesIO()
    metadata = {"Software": None} if kind == "png" else {"Date": None, "Creator": None}
    figure.savefig(stream, format=kind, dpi=dots_per_inch, facecolor=figure.get_facecolor(), metadata=metadata)
    return stream.getvalue()


def varying(rows: Sequence[Row]) -> list[str]:
    """Returns the names of the settings that vary along a method's line in a panel."""
    names: dict[str, None] = {}
    for points in by_method(rows).values():
        for name in dict.fromkeys(name for row in points for name in row.labels):
            if len({row.labels.get(name) for row in points}) > 1:
                names[name] = None
    return [name for name in names if name != "dt"] or list(names)


@dataclass(frozen=True)
class _Label:
    text: str
    x: float
    y: float
    color: str


def _style(index: int, theme: Theme) -> dict:
    color = theme.lines[index % len(theme.lines)]
    dashes = _DASHES[index // len(theme.lines) % len(_DASHES)]
    marker = _MARKERS[index % len(_MARKERS)]
    return {"color": color, "linestyle": dashes, "marker": marker, "ms": 5.5, "lw": 1.5, "mew": 1.3}


def _draw_panel(axes: Axes, suite: Suite, rows: Sequence[Row], styles: dict, theme: Theme) -> list[_Label]:
    """Draws the lines; returns the labels, to be placed once the panel's size is known."""
    problem = rows[0].problem
    error, means = panel_error(suite, problem)
    valid = [row for row in rows if row.failure is None]
    names = varying(valid)
    failed = len(rows) - len(valid)
    axes.set_title(
        problem + (f"  ({failed} failed: see the table)" if failed else ""),
        fontsize=10,
        color=theme.ink,
        loc="left",
    )
    beside = f"  (beside the points: {', '.join(name.replace('_', ' ') for name in names)})" if names else ""
    axes.set_xlabel(getattr(suite, "TIME_MEANS", "time of a run") + beside, fontsize=8, color=theme.ink)
    axes.set_ylabel(fill(means, _LABEL_LETTERS), fontsize=8, color=theme.ink)
    _dress(axes, theme)
    if not valid:
        axes.text(0.5, 0.5, "every run failed", transform=axes.transAxes, ha="center", color=theme.ink)
        return []
    positive = [row.errors[error] for row in valid if row.errors[error] > 0]
    floor = 0.4 * min(positive, default=1.0)
    front = {row.key for row in pareto_front(valid, error)}
    crowded, labels = len(by_method(valid)) > _MOST_LABELLED, []
    for method, points in by_method(valid).items():
        style = styles[method]
        y = [max(row.errors[error], floor) for row in points]
        axes.plot([row.median for row in points], y, color=style["color"], linestyle=style["linestyle"], lw=style["lw"])
        for row, height in zip(points, y, strict=True):
            axes.plot([row.quartile_low, row.quartile_high], [height] * 2, color=style["color"], lw=3.5, alpha=0.35)
            face = style["color"] if row.key in front else theme.ground
            marker = {key: style[key] for key in ("color", "marker", "ms", "mew")}
            axes.plot([row.median], [height], markerfacecolor=face, zorder=3, **marker)
            text = ", ".join(row.labels[name] for name in names if name in row.labels)
            text += " (no error)" if row.errors[error] <= 0 else ""
            if row.key in front or not crowded:
                labels.append(_Label(text, row.median, height, style["color"]))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.11)
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom * (bottom / top) ** 0.06, top)  # room for the arrow
    _set_ticks(axes)
    axes.annotate(
        "better",
        (0.015, 0.015),
        (0.075, 0.055),
        xycoords="axes fraction",
        textcoords="axes fraction",
        fontsize=7,
        color=theme.ink,
        alpha=0.7,
        arrowprops={"arrowstyle": "->", "color": theme.ink, "alpha": 0.7, "lw": 0.8},
    )
    return labels


def _dress(axes: Axes, theme: Theme) -> None:
    axes.set_facecolor(theme.ground)
    axes.grid(True, which="major", color=theme.faint, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(colors=theme.ink, labelsize=8, which="both", length=3, width=0.6)
    for name, spine in axes.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(theme.ink)
        spine.set_linewidth(0.6)


def _set_ticks(axes: Axes) -> None:
    """Puts ticks at decades, and the more between them the fewer there are."""
    formats = (EngFormatter(unit="s", sep="\N{NO-BREAK SPACE}"), FuncFormatter(lambda value, _: f"{value:g}"))
    for axis, limits, text in zip((axes.xaxis, axes.yaxis), (axes.get_xlim(), axes.get_ylim()), formats, strict=True):
        decades = np.log10(limits[1] / limits[0])
        between = next(steps for most, steps in _TICKS if decades < most)
        axis.set_major_locator(LogLocator(subs=between, numticks=12))
        axis.set_major_formatter(text)
        axis.set_minor_formatter(NullFormatter())


def _place_labels(axes: Axes, labels: Sequence[_Label]) -> None:
    """Puts each label beside its point, where it hides as little as possible of the lines and the other labels."""
    figure = axes.figure
    renderer, scale = figure.canvas.get_renderer(), figure.dpi / _POINTS_PER_INCH
    frame = axes.get_window_extent(renderer)
    taken = [np.array(text.get_window_extent(renderer).extents) for text in axes.texts if text.get_text() == "better"]
    marks = _marks(axes)
    for label in labels:
        if not label.text:
            continue
        at = axes.transData.transform((label.x, label.y))
        text = axes.annotate(
            label.text, (label.x, label.y), (0, 0), textcoords="offset points", fontsize=_LABEL_SIZE, color=label.color
        )
        extent = text.get_window_extent(renderer)
        best, least = None, np.inf
        for distance in _DISTANCES:
            for direction in _DIRECTIONS:
                away = distance * scale / hypot(*direction)
                anchor = at + away * np.array(direction)
                lower = anchor - [extent.width * (1 - direction[0]) / 2, extent.height * (1 - direction[1]) / 2]
                box = np.array([*lower, lower[0] + extent.width, lower[1] + extent.height])
                cost = 3 * sum(_overlap(box, other) for other in taken) / (extent.width * extent.height)
                cost += 0.3 * np.count_nonzero(((marks > box[:2] - 1) & (marks < box[2:] + 1)).all(axis=1))
                cost += 10 * (box[0] < frame.x0 or box[1] < frame.y0 or box[2] > frame.x1 + 20 or box[3] > frame.y1)
                cost += 0.02 * distance
                if cost < least:
                    best, least = box, cost
        text.set_position(tuple((best[:2] - at) / scale))
        taken.append(best)


def _marks(axes: Axes) -> np.ndarray:
    """Returns closely spaced points on the panel's lines, [n, 2] in pixels."""
    places = []
    for line in axes.lines:
        corners = axes.transData.transform(np.column_stack(line.get_data()))
        for a, b in zip(corners, corners[1:] if len(corners) > 1 else corners, strict=False):
            places.append(a + np.linspace(0, 1, max(2, int(hypot(*(b - a)) / 4)))[:, None] * (b - a))
    return np.concatenate(places)


def _overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Returns the area that two boxes share."""
    return float(np.prod(np.maximum(0.0, np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]))))
