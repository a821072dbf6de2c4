"""The results as one self-contained web page, light or dark to match the reader's system."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from string import Template

from warp_smoke.study.case import Row, Suite, panel_error
from warp_smoke.study.front import pareto_front
from warp_smoke.study.plot import DARK, LIGHT, draw_diagram, picture
from warp_smoke.study.summary import effect_costs, never_worth, order_lines, pass_times
from warp_smoke.study.words import duration, percent

# At this scale letters in diagrams are about as large as in tables; they may shrink by this factor.
_REM_PER_INCH, _LEAST_SIZE = 5.6, 0.8

_AS_KNOWN = "All known answers are met. Fitted orders (2: half the cell size quarters the error):"

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>What accuracy costs in time</title>
<style>
  :root { --ground: #ffffff; --ink: #1f2328; --soft: #59636e; --line: #d7dade; --tint: #f3f5f7; --bad: #a40e26; }
  @media (prefers-color-scheme: dark) {
    :root { --ground: #16191d; --ink: #e6e8ea; --soft: #9aa4ae; --line: #3a4047; --tint: #1f242a; --bad: #ff8f8f; }
  }
  body { background: var(--ground); color: var(--ink); font: 16px/1.55 system-ui, sans-serif; margin: 0 auto;
    max-width: 76rem; padding: 2rem 1.25rem 4rem; }
  h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .4rem; }
  h2 { font-size: 1.35rem; margin: 3.2rem 0 .4rem; padding-top: 1.2rem; border-top: 1px solid var(--line); }
  h3 { font-size: 1.05rem; margin: 2rem 0 .4rem; }
  p, ul { max-width: 48rem; }
  nav a { display: inline-block; margin-right: 1.1em; }
  a { color: inherit; }
  img { display: block; height: auto; margin: 1.2rem 0; }
  .soft { color: var(--soft); font-size: .9rem; }
  .bad { color: var(--bad); }
  details { margin: .8rem 0; }
  summary { cursor: pointer; }
  .scroll { overflow-x: auto; }
  table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; margin: .6rem 0; }
  th, td { text-align: left; padding: .22rem .9rem .22rem 0; border-bottom: 1px solid var(--line);
    white-space: nowrap; }
  th { font-weight: 600; vertical-align: bottom; }
  td.n, th.n { text-align: right; }
  td.long { white-space: normal; }
  tr.beaten td { color: var(--soft); opacity: .75; }
  tr.front td:first-child { font-weight: 600; }
  tr.head td { padding-top: 1rem; font-weight: 600; }
  .bar { display: inline-block; height: .6em; background: currentColor; opacity: .45; border-radius: 2px; }
</style>
</head>
<body>
<h1>What accuracy costs in time</h1>
<p class="soft">$where</p>
<nav>$links</nav>
<h2 id="read">How to read the diagrams</h2>
<ul>
<li><b>Across</b> is time and <b>up</b> is error, so the best place is the lower left corner. Both axes are
logarithmic: the same distance is the same factor everywhere.</li>
<li><b>An error</b> of 0.1 is a difference from the right answer that is a tenth as large as that answer, in the root
mean square over all cells or points, unless the axis says otherwise.</li>
<li><b>Each line is a method</b>, each point on it one setting, such as a number of cells; what was set is written
beside it. A line that falls steeply buys much accuracy for its time.</li>
<li><b>A filled point</b> is a fair choice: nothing else in its panel is both faster and more accurate. A hollow point
is beaten by another in both, so there is no reason to take it. The filled points together are the Pareto front.</li>
<li><b>A pale bar</b> through a point spans the middle half of the times that were taken; the point is their median.
Time to compile and to warm up is left out.</li>
</ul>
$sections
<h2 id="machine">Where this was measured</h2>
<table>$facts</table>
<p class="soft">Share of the copy: time to copy one float in memory, over the time for one cell and step.</p>
</body>
</html>
""")


def results_page(
    disclosure: Mapping[str, object], suites: Mapping[str, Suite], rows: Mapping[str, Sequence[Row]], note: str
) -> str:
    """Returns the page.

    Args:
        disclosure: of the machine and the versions.
        suites: by name, in the order of the page.
        rows: of each suite, by suite name.
        note: where it was measured, in one line.
    """
    links = "".join(f'<a href="#{name}">{escape(suite.TITLE)}</a>' for name, suite in suites.items())
    facts = "".join(
        f"<tr><td>{escape(name.replace('_', ' '))}</td><td>{escape(str(value))}</td></tr>"
        for name, value in disclosure.items()
        if value is not None
    )
    return _PAGE.substitute(
        where=escape(note),
        links=links,
        sections="\n".join(_section(name, suite, rows[name]) for name, suite in suites.items()),
        facts=facts,
    )


def _section(name: str, suite: Suite, rows: Sequence[Row]) -> str:
    tables = getattr(suite, "TABLES", {})
    drawn = [row for row in rows if row.problem not in tables]
    parts = [f'<h2 id="{name}">{escape(suite.TITLE)}</h2>']
    parts.append(f"<p>{escape(suite.explain([row for row in rows if row.failure is None]))}</p>")
    parts += _verdict(suite, rows)
    if beaten := never_worth(suite, drawn):
        parts.append(f'<p class="soft">Beaten everywhere here: {escape(" · ".join(beaten))}</p>')
    if drawn:
        parts.append(_diagram(suite, drawn))
        parts.append(_settings(suite, drawn))
    for problem, first in tables.items():
        found = [row for row in rows if row.problem == problem]
        if len(found) > 1 and found[0].failure is None:
            parts.append(_effects(found))
        if found and found[0].passes:
            parts.append(_passes(found[0], first))
    return "\n".join(parts)


def _verdict(suite: Suite, rows: Sequence[Row]) -> list[str]:
    """Returns missed known answers and failures as HTML, or the fitted orders if there are none."""
    lines = [escape(line) for line in suite.unexpected(rows)]
    lines += [escape(f"failed: {_name(row)}: {row.failure}") for row in rows if row.failure is not None]
    if lines:
        return ["<ul>" + "".join(f'<li class="bad">{line}</li>' for line in lines) + "</ul>"]
    orders = "<br>".join(map(escape, order_lines(suite, rows)))
    return [f'<p class="soft">{_AS_KNOWN}<br>{orders}</p>'] if orders else []


def _name(row: Row) -> str:
    return f"{row.problem}, {row.method} ({', '.join(f'{name} {value}' for name, value in row.labels.items())})"


def _diagram(suite: Suite, rows: Sequence[Row]) -> str:
    """Returns the diagram in light and dark, wide enough for its letters; it scrolls sideways on a narrow screen."""
    light, dark = (draw_diagram(suite, rows, theme) for theme in (LIGHT, DARK))
    width = light.get_figwidth() * _REM_PER_INCH
    sources = ["data:image/svg+xml;base64," + b64encode(picture(figure, "svg")).decode() for figure in (light, dark)]
    return (
        f'<div class="scroll"><picture><source media="(prefers-color-scheme: dark)" srcset="{sources[1]}">'
        f'<img style="width: clamp({_LEAST_SIZE * width:.1f}rem, 100%, {width:.1f}rem)" '
        f'alt="Error against time: {escape(suite.TITLE)}" src="{sources[0]}"></picture></div>'
    )


def _settings(suite: Suite, rows: Sequence[Row]) -> str:
    """Tabulates all rows, fastest first in each problem; those not on a front are grey."""
    errors = list(dict.fromkeys(name for row in rows for name in row.errors))
    head = ["method", "chosen", "time", "middle half", "ns per cell and step", "share of the copy", *errors]
    cells = "".join(
        f'<th class="{"" if n < 2 else "n"}">{escape(h.replace("_", " "))}</th>' for n, h in enumerate(head)
    )
    lines, fair = [], 0
    for problem in dict.fromkeys(row.problem for row in rows):
        found = [row for row in rows if row.problem == problem]
        error, _ = panel_error(suite, problem)
        front = {row.key for row in pareto_front(found, error)}
        fair += len(front)
        reference = found[0].reference
        source = f'<span class="soft"> · measured from {escape(reference)}</span>' if reference else ""
        lines.append(f'<tr class="head"><td colspan="{len(head)}">{escape(problem)}{source}</td></tr>')
        for row in sorted(found, key=lambda row: row.median or 0.0):
            chosen = escape(", ".join(f"{name.replace('_', ' ')} {value}" for name, value in row.labels.items()))
            start = f"<td>{escape(row.method)}</td><td>{chosen}</td>"
            if row.failure is not None:
                rest = f'<td class="bad long" colspan="{len(head) - 2}">failed: {escape(row.failure)}</td>'
                lines.append(f"<tr>{start}{rest}</tr>")
                continue
            figures = [duration(row.median), f"{duration(row.quartile_low)} to {duration(row.quartile_high)}"]
            figures += [f"{row.ns_per_cell:.3g}", f"{100 * row.copy_share:.1f} %"] if row.ns_per_cell else ["", ""]
            figures += [f"{row.errors[name]:.3g}" if name in row.errors else "" for name in errors]
            cells_of_row = "".join(f'<td class="n">{escape(figure)}</td>' for figure in figures)
            kind = "front" if row.key in front else "beaten"
            lines.append(f'<tr class="{kind}">{start}{cells_of_row}</tr>')
    return (
        f"<details{' open' if len(rows) <= 24 else ''}><summary>All {len(rows)} settings; grey: something else is both "
        f'faster and more accurate ({fair} are not grey)</summary><div class="scroll"><table><tr>{cells}</tr>'
        f"{''.join(lines)}</table></div></details>"
    )


def _effects(rows: Sequence[Row]) -> str:
    """Tabulates the cost of each effect: the time with everything minus that without it. Row 1 has everything."""
    names = list(dict.fromkeys(name for row in rows for name in row.errors))
    head = "".join(f'<th class="n">changes {escape(name)}</th>' for name in names)
    lines = []
    for cost in effect_costs(rows):
        bar = f'<span class="bar" style="width:{max(0.0, 8 * cost.share):.2f}em"></span>'
        changes = "".join(
            f'<td class="n">{percent(cost.changes[name])}</td>' if name in cost.changes else "<td></td>"
            for name in names
        )
        lines.append(
            f'<tr><td>{escape(cost.effect)}</td><td class="n">{duration(cost.seconds)}</td>'
            f'<td class="n">{percent(cost.share)}</td><td>{bar}</td>{changes}</tr>'
        )
    return (
        "<h3>What each effect costs</h3><p>Each effect was switched off by itself: its cost is the time that a frame "
        "then saves, followed by how much the last frame changes. A cost smaller than the difference between two equal "
        "runs is too small to measure.</p>"
        '<div class="scroll"><table><tr><th>effect</th><th class="n">costs a frame</th><th class="n">share</th>'
        f"<th></th>{head}</tr>{''.join(lines)}</table></div>"
    )


def _passes(row: Row, what: str) -> str:
    """Tabulates where the time of a frame goes."""
    times = pass_times(row)
    longest = max(seconds for _, seconds in times)
    lines = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{duration(seconds)}</td>'
        f'<td><span class="bar" style="width:{8 * seconds / longest:.2f}em"></span></td></tr>'
        for name, seconds in times
    )
    return (
        f"<h3>Time of a frame by pass: {escape(what)}</h3>"
        f'<div class="scroll"><table><tr><th>pass</th><th class="n">time</th><th></th></tr>{lines}</table></div>'
    )
