"""Report of a series: requested force and force held, the verdicts, and a table; pure."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, NamedTuple

from pincette.api.series import NUMBER_LABEL, SERIES_LABEL, Series
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.plugin import drawing
from pincette_supervisor.results.documents import listing, page, pairs, picture_of, section

FAILED = "#b3261e"
COLOURS: Mapping[str, str] = {
    "goal met": drawing.TRUE,
    "within U": drawing.TRUE,
    "goal missed": drawing.REFERENCE,
    "beyond U": drawing.REFERENCE,
}
"""Colours of verdicts; all other verdicts have a neutral colour."""
MARKS: Mapping[str, str] = {"goal missed": "s", "beyond U": "s"}
"""Marks that distinguish these verdicts in grey too; all other verdicts have a dot."""


class SeriesPoint(NamedTuple):
    """One job of a series, as the report shows it."""

    number: int
    job: str
    sample: str
    state: str
    verdict: str
    force_mN: float | None
    """Requested force."""
    force_held_mN: float | None
    uncertainty_mN: float | None
    release: str | None
    """Verdict on the release; null if no part was released."""
    tries: int
    """Number of jobs created for this number; the newest one is shown."""
    cause: str


@dataclass(frozen=True, slots=True)
class SeriesReport:
    """A series with what its jobs have found."""

    series: Series
    points: tuple[SeriesPoint, ...]

    @staticmethod
    def of(series: Series, rows: Sequence[JobRow]) -> "SeriesReport":
        """Return the report of a series, from the journal rows of its jobs."""
        known = {row.id: row for row in rows}
        points = [
            _point(one.number, one.tries, known[one.job]) for one in series.jobs if one.job in known
        ]
        return SeriesReport(series, tuple(points))

    @property
    def measured(self) -> list[SeriesPoint]:
        """Return the jobs that had a force to hold, and held one."""
        return [
            one for one in self.points if one.force_mN is not None and one.force_held_mN is not None
        ]


def _point(number: int, tries: int, row: JobRow) -> SeriesPoint:
    result, values = row.result or {}, row.plan.get("values", {})
    asked, held = _number(values.get("force_mN")), _number(result.get("force_held_mN"))
    uncertainty = _number(result.get("force_uncertainty_mN"))
    release: dict[str, Any] = result.get("release") or {}
    return SeriesPoint(
        number,
        row.id,
        row.sample,
        row.state,
        _verdict(row, asked, held, uncertainty),
        asked,
        held,
        uncertainty,
        release.get("verdict"),
        tries,
        row.cause,
    )


def _verdict(
    row: JobRow, asked_mN: float | None, held_mN: float | None, uncertainty_mN: float | None
) -> str:
    """Return the verdict on a job: by its goal, otherwise by its force, otherwise its outcome."""
    result = row.result or {}
    outcome = str(result.get("outcome", "")).replace("_", " ")
    if row.state != "succeeded":
        return outcome or row.state
    goal: dict[str, Any] = result.get("goal") or {}
    met: bool | None = goal.get("met")
    if met is not None:
        return "goal met" if met else "goal missed"
    if asked_mN is None or held_mN is None or uncertainty_mN is None:
        return outcome or row.state
    return "within U" if abs(held_mN - asked_mN) <= uncertainty_mN else "beyond U"


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def drawn(content: SeriesReport) -> bytes:
    """Draw the force held over the requested force, and their difference by number, as PNG."""
    series, points = content.series, content.measured
    sheet = drawing.Sheet()
    above, below = drawing.grid(sheet, 2)
    drawing.prepare(above, "force held / mN", "force asked for / mN")
    drawing.prepare(below, "held − asked for / mN", "number of the job")
    ends = [one.force_mN for one in points if one.force_mN is not None]
    if ends:
        span = [min(ends), max(ends)]
        above.plot(span, span, color=drawing.FAINT, linewidth=0.8)
    drawing.zero_line(below)
    for verdict in dict.fromkeys(one.verdict for one in points):
        these = [one for one in points if one.verdict == verdict]
        style = {
            "fmt": MARKS.get(verdict, "o"),
            "color": COLOURS.get(verdict, drawing.MEASURED),
            "markersize": 5.0,
            "capsize": 3.0,
            "linewidth": 0.0,
            "elinewidth": 1.0,
        }
        asked = [one.force_mN or 0.0 for one in these]
        held = [one.force_held_mN or 0.0 for one in these]
        spread = [one.uncertainty_mN or 0.0 for one in these]
        above.errorbar(asked, held, yerr=spread, label=f"{verdict} ({len(these)})", **style)
        errors = [after - before for after, before in zip(held, asked, strict=True)]
        below.errorbar([one.number for one in these], errors, yerr=spread, **style)
    missed = [one for one in content.points if one.state != "succeeded"]
    if missed:
        label = f"not succeeded ({len(missed)})"
        zeros = [0.0] * len(missed)
        below.plot([one.number for one in missed], zeros, "x", color=FAILED, label=label)
        drawing.legend(below)
    if points:
        drawing.legend(above)
    below.set_xlim(0.0, series.total + 1.0)
    name = f"{series.rig} · series {series.id}"
    sheet.head(drawing.LEFT, series.name or "series", _sum(content), name)
    return sheet.png()


def _sum(content: SeriesReport) -> str:
    counts = Counter(one.verdict for one in content.points)
    summary = [f"{count} {verdict}" for verdict, count in counts.most_common()]
    series = content.series
    return ", ".join([f"{series.ended} of {series.total} jobs ended", *summary])


def report(content: SeriesReport, picture: bytes) -> str:
    """Write the report as a page that needs no other file."""
    series = content.series
    title = series.name or f"series {series.id}"
    about = f"series {series.id} on rig {series.rig}, {series.state}"
    by = f", requested by {series.by}" if series.by else ""
    ended = f", ended at {series.ended_at}" if series.ended_at else ""
    trace = f", trace {series.traceparent.split('-')[1]}" if series.traceparent else ""
    times = f" at {series.created_at}{ended}{trace}"
    request = {
        name: json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else value
        for name, value in series.request.items()
        if name not in ("values", "csv", "name")
    }
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="verdict">{escape(_sum(content))}</p>',
        f'<p class="whose">{escape(about + by + times)}</p>',
        f'<p class="missing">{escape(series.cause)}</p>' if series.cause else "",
        picture_of(picture, "force held over force asked for, and their difference by job"),
        section("Jobs", listing([one._asdict() for one in content.points])),
        section("Requested", pairs(request.items(), exact=True)),
        section(
            "Table",
            f"<p>All figures of all jobs: <code>GET /api/v1/jobs/export.csv?label="
            f"{SERIES_LABEL}={escape(series.id)}</code>, also as Parquet; the label "
            f"<code>{NUMBER_LABEL}</code> is the number.</p>",
        ),
    ]
    return page(f"{title} · {series.id}", parts)
