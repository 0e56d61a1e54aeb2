"""Documents that the supervisor adds to a record: picture, request, result, report, manifest."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any, cast

from pincette.api.job_kinds import JobKind, job_kinds
from pincette.api.jobs import DESCRIPTION
from pincette.api.live import LoopTiming
from pincette.api.results import confirmations
from pincette.api.states import OUTCOMES
from pincette.core.files import make_folder
from pincette.core.messages import Recorded
from pincette.core.units import bare, unit_of
from pincette.records import folder as files
from pincette.records.record_times import END, SAMPLE_0, UNCERTAINTY
from pincette.records.timings import rows
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.plugin import Planned
from pincette_supervisor.plugin.drawing import Picture

# A job as one page that needs no other file: figures, picture, curves, model; pure. Names in the
# result carry their units, and the page reads the units from them; so a new figure of a result
# appears in the report without further changes.

ABSENT = "–"
TITLES = {
    "limits_acted": "Limits that acted",
    "assumptions": "Assumptions",
}
"""Explanations of result parts whose names are not self-explanatory, by name."""
WORDS = {
    "sliding_in_band": (
        "samples in which the law's sliding function is within its band (outside the band, the "
        "law moves it back)"
    )
}
"""Explanations of result values whose names are not self-explanatory, by name."""
SHARES = frozenset({"sliding_in_band"})
"""Values from 0 to 1 that are shown in percent."""
DECIMALS = {"µm": 3, "mN": 2, "V": 4, "s": 2, "%": 2, "mN/µm": 2}
"""Number of decimals by unit: a tenth of the instruments' resolution. Other values have four
digits."""
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #22282f; background: #fff;
       max-width: 64rem; margin: 2rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.5rem; margin: 0; } h2 { font-size: 1.05rem; margin: 2rem 0 .5rem; }
p.whose { color: #5a646e; margin: .2rem 0 1.2rem; } img { width: 100%; height: auto; }
p.verdict { font-size: 1.1rem; margin: .6rem 0 .2rem; }
p.missing { border-left: 4px solid #b3261e; background: #fbeceb; padding: .6rem .9rem; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid #e3e7eb;
         vertical-align: top; overflow-wrap: anywhere; }
th { font-weight: 600; } td.number { font-variant-numeric: tabular-nums; }
.columns { columns: 2; column-gap: 2.5rem; } .columns tr { break-inside: avoid; }
@media print { body { margin: 0; max-width: none; } h2 { break-after: avoid; } }
@media (max-width: 40rem) { .columns { columns: 1; } }
"""


def report(
    *,
    kind: JobKind,
    values: Mapping[str, Any],
    result: Mapping[str, Any],
    picture: bytes,
    whose: Mapping[str, str],
    state: Mapping[str, bool | str],
    timing: LoopTiming | None = None,
) -> str:
    """Write the report page.

    Parameters
    ----------
    kind
        Kind of the job.
    values
        Values of the job: the request, completed by the rig file.
    result
        Result as it is stored and sent.
    picture
        Picture as PNG.
    whose
        Names of job, rig and model, and the time; see ``archive.about``.
    state
        Whether the record is complete, and why not.
    timing
        Timing of the programs; None if it was not measured.
    """
    outcome = str(result.get("outcome", "")).replace("_", " ")
    title = f"{kind.name}: {outcome}"
    job, rig = whose.get("job", ""), whose.get("rig", "")
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="verdict">{escape(verdict(kind, result))}</p>',
        f'<p class="whose">{escape(_whose(whose, job, rig))}</p>',
        _missing(state),
        _statement(result),
        picture_of(picture, f"{title}, over time"),
        section("Requested", pairs(_scalars(values), exact=True)),
        section("Figures", pairs(_figures(kind, result))),
    ]
    for name, value in result.items():
        if isinstance(value, Sequence) and not isinstance(value, str):
            heading = TITLES.get(name, name.replace("_", " ").capitalize())
            parts.append(section(heading, listing(cast("Sequence[Any]", value))))
    if timing is not None:
        parts.append(section("Timing", listing([*rows(timing)])))
    parts.append(section("Made with", pairs(whose.items())))
    return page(f"{title} · {job}", parts)


def page(title: str, parts: Iterable[str]) -> str:
    """Return an HTML page that needs no other file; empty parts are left out."""
    body = "\n".join(part for part in parts if part)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


def picture_of(png: bytes, about: str) -> str:
    """Return a picture with its description, as a part of a page."""
    encoded = base64.b64encode(png).decode()
    return f'<img alt="{escape(about)}" src="data:image/png;base64,{encoded}">'


def verdict(kind: JobKind, result: Mapping[str, Any]) -> str:
    """Return the outcome of the job and its most important values, in one line."""
    outcome = str(result.get("outcome", ""))
    told = [OUTCOMES.get(outcome, outcome.replace("_", " "))]
    for figure in kind.figures_of(result):
        value, spread = result.get(figure.name), result.get(figure.uncertainty)
        if figure.main and isinstance(value, int | float) and not isinstance(value, bool):
            digits = figure.digits
            more = f" ± {spread:.{digits}f}" if isinstance(spread, float) else ""
            told.append(f"{figure.label} {value:.{digits}f}{more} {figure.unit}".rstrip())
    told += [": ".join(filter(None, found)) for found in confirmations(result)]
    return "; ".join(told)


def _whose(whose: Mapping[str, str], job: str, rig: str) -> str:
    """Return sample, operator, job and rig of a record, in words."""
    parts = [f"{name} {whose[name]}" for name in ("sample", "batch", "operator") if whose.get(name)]
    by = whose.get("requested_by", "")
    return ", ".join(
        [
            *parts,
            f"job {job} on rig {rig}",
            *([f"requested by {by}"] if by else []),
            *_times(whose),
        ]
    )


def _times(whose: Mapping[str, str]) -> list[str]:
    """Return when the samples were recorded, and when the job was requested."""
    names = ("created_at", SAMPLE_0, END, UNCERTAINTY)
    asked, begin, end, spread_s = (whose.get(name) for name in names)
    certain = f" (begin ± {spread_s} s)" if spread_s else ""
    return [
        *([f"recorded from {begin} to {end}{certain}"] if begin and end else []),
        *([f"requested at {asked}"] if asked else []),
    ]


def _missing(state: Mapping[str, bool | str]) -> str:
    if state.get("complete"):
        return ""
    why = str(state.get("detail", ""))
    return f'<p class="missing">The record is not complete: {escape(why)}</p>'


def _statement(result: Mapping[str, Any]) -> str:
    statement = result.get("statement")
    return f"<p>{escape(str(statement))}</p>" if statement else ""


def section(heading: str, content: str) -> str:
    """Return a heading with its content; empty without content."""
    return f"<h2>{escape(heading)}</h2>\n{content}" if content else ""


def _scalars(
    tree: Mapping[str, Any], but: Sequence[str] = (), before: str = ""
) -> list[tuple[str, Any]]:
    """Return every value that is neither list nor map; the name of a nested value includes the name
    of its map.
    """
    found: list[tuple[str, Any]] = []
    for name, value in tree.items():
        if name in but:
            continue
        if isinstance(value, Mapping):
            unit = unit_of(name)
            inner = cast("Mapping[str, Any]", value)
            for key, item in _scalars(inner, before=f"{before}{bare(name)}_"):
                known = unit_of(key) or not isinstance(item, float)
                found.append((key if known else f"{key}{_end(name, unit)}", item))
        elif not isinstance(value, Sequence) or isinstance(value, str):
            found.append((f"{before}{name}", value))
    return found


def _figures(kind: JobKind, result: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return every value of a result, beginning with those that the kind names."""
    first = [figure.name.partition(".")[0] for figure in kind.figures_of(result)]
    ordered = {name: result[name] for name in (*first, *result) if name in result}
    return _scalars(ordered, but=("outcome", "statement"))


def _end(name: str, unit: str) -> str:
    """Return the suffix of a name that states the unit of its content."""
    return name.removeprefix(bare(name)) if unit else ""


def pairs(given: Iterable[tuple[str, Any]], *, exact: bool = False) -> str:
    """Return a table of names and values; empty without any."""
    rows = [
        f"<tr><th>{escape(_words(name))}</th>{_told(name, value, exact=exact)}</tr>"
        for name, value in given
    ]
    return f'<div class="columns"><table>{"".join(rows)}</table></div>' if rows else ""


def listing(items: Sequence[Any]) -> str:
    """Return a table for items with names, otherwise a list."""
    if not items:
        return "<p>none</p>"
    if not all(isinstance(item, Mapping) for item in items):
        return f"<ul>{''.join(f'<li>{escape(_text(item))}</li>' for item in items)}</ul>"
    rows = [dict(_scalars(item)) for item in items]
    names = list(dict.fromkeys(name for row in rows for name in row))
    head = "".join(f"<th>{escape(_headed(name))}</th>" for name in names)
    lines = [
        "".join(_cell(row.get(name), "", of=unit_of(name) or "-") for name in names) for row in rows
    ]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _words(name: str) -> str:
    return WORDS.get(name, bare(name).replace("_", " "))


def _headed(name: str) -> str:
    unit = unit_of(name)
    return f"{_words(name)} / {unit}" if unit else _words(name)


def _told(name: str, value: Any, *, exact: bool) -> str:
    """Return a table cell of a value; requested values are shown as requested."""
    if name in SHARES and isinstance(value, float):
        return f'<td class="number">{100.0 * value:.0f} %</td>'
    return _cell(value, unit_of(name), exact=exact)


def _cell(value: Any, unit: str, *, exact: bool = False, of: str = "") -> str:
    text = _text(value, "" if exact else of or unit)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    shown = f"{text} {unit}" if unit and value is not None else text
    return f'<td class="number">{escape(shown)}</td>' if number else f"<td>{escape(shown)}</td>"


def _text(value: Any, unit: str = "") -> str:
    if value is None or value == "":
        return ABSENT
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float):
        return str(value)
    if not unit:
        return f"{value:.5g}"
    decimals = DECIMALS.get(unit)
    # A value that rounding would reduce to 0 keeps its first digits.
    if decimals is None or 0.0 < abs(value) < 10.0 ** (1 - decimals):
        return f"{value:.{4 if decimals is None else 2}g}"
    return f"{value:.{decimals}f}"


LABEL = "label "
"""Prefix of the names of labels in a manifest, and in the metadata of sample files."""
NOT_RECORDED = "no recorder has reported its record"


def completeness(recorded: Recorded | str) -> dict[str, bool | str]:
    """Return the manifest's statement whether a record is complete, and why not."""
    if isinstance(recorded, str):
        return {"complete": False, "detail": recorded}
    return {"complete": recorded.complete, "detail": recorded.detail}


def write_documents(
    folder: Path,
    job: JobRow,
    planned: Planned,
    *,
    result: Mapping[str, Any],
    picture: Picture,
    whose: Mapping[str, str],
    recorded: Recorded | str,
) -> None:
    """Write all files except the samples, which the recorder writes; raises OSError."""
    make_folder(folder)
    kind, state = job_kinds()[planned.plan.kind], completeness(recorded)
    whose = {**whose, **files.times(folder)}
    files.write_bytes(folder / kind.plot, picture.png)
    for end, content in picture.vector.items():
        files.write_bytes((folder / kind.plot).with_suffix(end), content)
    request = {"request": job.request, "values": planned.values, "plan": job.plan}
    files.write_json(folder / files.REQUEST, request)
    files.write_json(folder / files.RESULT, result)
    page = report(
        kind=kind,
        values=planned.values,
        result=result,
        picture=picture.png,
        whose=whose,
        state=state,
        timing=_timing(folder),
    )
    files.write_bytes(folder / files.REPORT, page.encode())
    files.write_manifest(folder, {**whose, **state})
    files.pin(folder, pinned=job.pinned)


def said_of(job: JobRow) -> dict[str, str]:
    """Return the annotations of a job as its files contain them, without empty ones."""
    texts = {
        **{name: str(getattr(job, name)) for name in DESCRIPTION},
        **{f"{LABEL}{name}": text for name, text in job.labels.items()},
    }
    return {name: text for name, text in texts.items() if text}


def restate(folder: Path, job: JobRow) -> None:
    """Update a job's annotations in report and manifest; raises OSError.

    Files of samples are never rewritten: they contain the annotations of the time at which they
    were written.
    """
    kind = job_kinds().get(job.kind)
    manifest = files.read_manifest(folder)
    if not manifest:
        return
    state = {name: manifest.pop(name) for name in ("complete", "detail") if name in manifest}
    manifest.pop("files", None)
    whose: dict[str, str] = said_of(job) | {
        name: value
        for name, value in manifest.items()
        if name not in DESCRIPTION and not name.startswith(LABEL)
    }
    picture, written = folder / (kind.plot if kind else ""), set[str]()
    if kind is not None and job.result is not None and picture.is_file():
        page = report(
            kind=kind,
            values=job.plan.get("values", {}),
            result=job.result,
            picture=picture.read_bytes(),
            whose=whose,
            state=state,
            timing=_timing(folder),
        )
        files.write_bytes(folder / files.REPORT, page.encode())
        written = {files.REPORT}
    files.write_manifest(folder, {**whose, **state}, written)


def _timing(folder: Path) -> LoopTiming | None:
    """Return the programs' loop_timing messages that the recorder has stored."""
    with suppress(OSError, ValueError):
        return LoopTiming.model_validate_json((folder / files.TIMING).read_bytes())
    return None
