"""Charts as SVG within a page. They have classes and no inline style, as the policy of the page demands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from zoneinfo import ZoneInfo

from markupsafe import Markup, escape

from bench.figures.languages import tr
from bench.figures.numbers import decimals, scale_shown
from bench.station.runs.course import Course
from bench.station.runs.findings import FindingView
from bench.station.units.history import PointView, SeriesView

WIDTH, HEIGHT = 220.0, 28.0
ROOM = 0.15  # beside the limits, of their distance
CHART_WIDTH, CHART_HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640.0, 220.0, 92.0, 14.0, 12.0, 34.0


def bullet(finding: FindingView) -> Markup:
    """Bullet chart of a result: the band between its limits, its value and U; empty without limits of the value."""
    if finding.low is None and finding.high is None:
        return Markup("")
    low, high = _span(finding)
    width = high - low

    def x(value: float) -> float:
        return max(1.0, min(WIDTH - 1.0, (value - low) / width * WIDTH))

    begin = x(finding.low) if finding.low is not None else 1.0
    end = x(finding.high) if finding.high is not None else WIDTH - 1.0
    at, left, right = x(finding.value), x(finding.value - finding.expanded), x(finding.value + finding.expanded)
    kind = "bad" if finding.verdict == "FAIL" else "close" if finding.marginal else "usual"
    sides = [side for side, limit in ((begin, finding.low), (end, finding.high)) if limit is not None]
    lines = "".join(f'<path class="limit" d="M{side:.1f} 4V24"/>' for side in sides)
    shape = f"M{at:.1f} 6l7 8-7 8-7-8z" if kind == "bad" else f"M{at - 2.5:.1f} 5h5v18h-5z"
    shown = (
        f'<rect class="between" x="{begin:.1f}" y="8" width="{max(0.0, end - begin):.1f}" height="12"/>{lines}'
        f'<path class="reach" d="M{left:.1f} 14H{right:.1f}M{left:.1f} 10v8M{right:.1f} 10v8"/>'
        f'<path class="value" d="{shape}"/>'
    )
    return _svg(f"bullet {kind}", WIDTH, HEIGHT, tr("value, U and limits"), shown)


def _span(finding: FindingView) -> tuple[float, float]:
    """Range of the chart: the limits with some room; a value far outside is at its edge."""
    low, high = finding.low, finding.high
    reach = finding.value - finding.expanded, finding.value + finding.expanded
    if low is not None and high is not None:
        room = ROOM * (high - low) or abs(high) * ROOM or 1.0
        return low - room, high + room
    limit = low if low is not None else high if high is not None else 0.0
    others = (min(0.0, reach[0]), max(0.0, reach[1])) if high is not None else reach
    first, last = min(limit, others[0]), max(limit, others[1])
    room = ROOM * (last - first) or 1.0
    return first - room, last + room


def strip(course: Course) -> Markup:
    """Timeline of a run: a box for each stretch of steps of one kind."""
    total_s = course.total_s or 1.0
    boxes: list[str] = []
    for passage in course.passages:
        for each in passage.stretches:
            x, end = (part_s / total_s * 1000.0 for part_s in (each.begin_s, each.end_s))
            kind = each.verb if each.verb in ("ramp", "soak", "acquire", "move", "prompt") else "other"
            title = escape(f"{passage.name}: {each.verb}")
            box = f'<rect class="{kind}" x="{x:.2f}" y="0" width="{max(0.6, end - x):.2f}" height="24">'
            boxes.append(f"{box}<title>{title}</title></rect>")
    return _svg("strip", 1000.0, 24.0, tr("timeline of the run"), "".join(boxes), fills=True)


class _Axes:
    """Scales of a chart over time."""

    def __init__(self, series: SeriesView) -> None:
        points = series.points
        self.factor, self.unit = scale_shown(series.quantity, series.unit)
        begin, end = points[0].at.timestamp(), points[-1].at.timestamp()
        self._begin, self._span_s = begin, (end - begin) or 1.0
        self._alone = end == begin
        sides = [each.value + sign * each.expanded for each in points for sign in (-1, 1)]
        if series.chart is not None:
            sides += [series.chart.low, series.chart.high]
        low, high = min(sides), max(sides)
        for limit in (points[-1].low, points[-1].high):  # a limit far away would flatten the values
            if limit is not None and low - 2 * (high - low) <= limit <= high + 2 * (high - low):
                low, high = min(low, limit), max(high, limit)
        room = 0.06 * (high - low) or abs(high) or 1.0
        self.low, self.high = low - room, high + room

    def x(self, at: datetime) -> float:
        """Place of an instant."""
        part = 0.5 if self._alone else (at.timestamp() - self._begin) / self._span_s
        return LEFT + 12.0 + part * (CHART_WIDTH - LEFT - RIGHT - 24.0)

    def y(self, value: float) -> float:
        """Place of a value."""
        return TOP + (self.high - value) / (self.high - self.low) * (CHART_HEIGHT - TOP - BOTTOM)


def history_chart(series: SeriesView, zone: str) -> Markup:
    """Chart of a result over the calibrations of a unit: values with U, limits, and control limits if there are any."""
    axes = _Axes(series)
    parts = [*_grid(axes, series.points, zone), *_limits(axes, series), *_control(axes, series)]
    parts += [_point(axes, each, zone) for each in series.points]
    label = tr("{quantity} over the calibrations of the unit", quantity=series.quantity)
    return _svg("chart", CHART_WIDTH, CHART_HEIGHT, label, "".join(parts))


def _grid(axes: _Axes, points: Sequence[PointView], zone: str) -> Iterator[str]:
    bottom = CHART_HEIGHT - BOTTOM
    digits = decimals((axes.high - axes.low) * abs(axes.factor) / 10)
    for n in range(5):
        value = axes.low + (axes.high - axes.low) * n / 4
        y = axes.y(value)
        yield f'<path class="grid" d="M{LEFT:.0f} {y:.1f}H{CHART_WIDTH - RIGHT:.0f}"/>'
        yield _tick(LEFT - 6, y + 4, f"{value * axes.factor:.{digits}f}", "end")
    first, last = points[0].at, points[-1].at
    shown = [(first, "start")] if first == last else [(first, "start"), (last, "end")]
    for at, anchor in shown:
        yield _tick(axes.x(at), bottom + 22, f"{at.astimezone(ZoneInfo(zone)):%Y-%m-%d}", anchor)
    yield _tick(LEFT - 6, bottom + 22, axes.unit or "1", "end")


def _tick(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text class="tick" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _limits(axes: _Axes, series: SeriesView) -> Iterator[str]:
    last = series.points[-1]
    for limit in (last.low, last.high):
        if limit is not None and axes.low <= limit <= axes.high:
            yield f'<path class="limit" d="M{LEFT:.0f} {axes.y(limit):.1f}H{CHART_WIDTH - RIGHT:.0f}"/>'


def _control(axes: _Axes, series: SeriesView) -> Iterator[str]:
    if series.chart is None:
        return
    for value, kind in ((series.chart.centre, "centre"), (series.chart.low, "control"), (series.chart.high, "control")):
        yield f'<path class="{kind}" d="M{LEFT:.0f} {axes.y(value):.1f}H{CHART_WIDTH - RIGHT:.0f}"/>'


def _point(axes: _Axes, point: PointView, zone: str) -> str:
    x, y = axes.x(point.at), axes.y(point.value)
    low, high = axes.y(point.value - point.expanded), axes.y(point.value + point.expanded)
    kind = "bad" if point.verdict == "FAIL" else "look" if point.signals else "usual"
    shape = (
        f"M{x:.1f} {y - 7:.1f}l6 7-6 7-6-7z"
        if kind != "usual"
        else f"M{x - 4:.1f} {y:.1f}a4 4 0 1 0 8 0a4 4 0 1 0-8 0z"
    )
    there = point.at.astimezone(ZoneInfo(zone))
    title = escape(f"{there:%Y-%m-%d %H:%M} {point.run}{': ' + ', '.join(point.signals) if point.signals else ''}")
    return (
        f'<g class="{kind}"><title>{title}</title>'
        f'<path class="reach" d="M{x:.1f} {low:.1f}V{high:.1f}M{x - 5:.1f} {low:.1f}h10M{x - 5:.1f} {high:.1f}h10"/>'
        f'<path class="value" d="{shape}"/></g>'
    )


def _svg(kind: str, width: float, height: float, label: str, content: str, *, fills: bool = False) -> Markup:
    """An SVG element; `content` has numbers and escaped texts only."""
    ratio = ' preserveAspectRatio="none"' if fills else ""
    opening = f'<svg class="{kind}" viewBox="0 0 {width:g} {height:g}"{ratio} role="img" aria-label="{escape(label)}">'
    return Markup(f"{opening}{content}</svg>")  # noqa: S704  numbers and escaped texts
