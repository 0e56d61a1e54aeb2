"""Requests of the jobs of a series, from its values, its grid or its table; pure."""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from io import StringIO
from itertools import chain, product
from random import Random
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from pincette.api.job_kinds import job_kinds
from pincette.api.requests import JobRequest
from pincette.api.series import MOST_JOBS, NUMBER_LABEL, SERIES_LABEL, SeriesRequest
from pincette.core import numerals
from pincette.core.units import unit_of
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.problems import ProblemError, error_entry, unusable

Tree = dict[str, Any]
OF_SERIES = ("rig", "autostart", "queue", "dry_run", "approval_s")
"""Members of a request that the series sets for all its jobs."""
LABEL = "label."
"""Start of the name of a column with a label, as in a table of jobs."""
SEPARATORS = ";\t,"


def requests_of(series: SeriesRequest) -> list[Tree]:
    """Return the requests of all jobs in their order, as they are stored; raises ProblemError."""
    for place, tree in _given(series):
        for name in OF_SERIES:
            if name in tree:
                raise unusable(
                    f"{name} cannot differ between the jobs of a series: leave it out of the job",
                    pointer=f"{place}/{name}",
                )
    rows = [_merged(series.job, row) for row in _rows(series)]
    count = len(rows) * series.repeats
    if count > MOST_JOBS:
        raise unusable(
            f"{len(rows)} jobs, repeated {series.repeats} times, are {count} jobs: a series has "
            f"{MOST_JOBS} at most; divide it",
            pointer="/repeats",
        )
    places = [*range(len(rows))] * series.repeats
    if series.shuffle_seed is not None:
        Random(series.shuffle_seed).shuffle(places)
    for place in dict.fromkeys(places):
        _require_usable(series, place, rows[place])
    return [rows[place] for place in places]


def request_of(tree: Mapping[str, Any], *, series: str = "", number: int = 1) -> JobRequest:
    """Return a stored request as that of a job of a series; raises ValidationError."""
    labels = tree.get("labels", {})
    if isinstance(labels, dict):  # else the request is refused
        labels = {**cast(Tree, labels), SERIES_LABEL: series, NUMBER_LABEL: str(number)}
    whole = {**tree, "labels": labels, "autostart": True, "queue": True}
    return REQUEST.validate_json(json.dumps(whole))


def _given(series: SeriesRequest) -> Iterator[tuple[str, Mapping[str, Any]]]:
    yield "/job", series.job
    yield "/grid", series.grid
    for number, row in enumerate(series.values):
        yield f"/values/{number}", row


def _rows(series: SeriesRequest) -> Sequence[Tree]:
    if series.csv:
        return [*_table(series)]
    if series.grid:
        count = 1
        for values in series.grid.values():
            count *= len(values)
        if count > MOST_JOBS:
            raise unusable(
                f"the grid has {count} combinations: a series has {MOST_JOBS} jobs at most",
                pointer="/grid",
            )
        return [
            dict(zip(series.grid, values, strict=True)) for values in product(*series.grid.values())
        ]
    return series.values or [{}]


def _merged(job: Tree, row: Tree) -> Tree:
    """Return the members common to all jobs, updated by those of one job; labels are merged too."""
    labels: list[Any] = [one["labels"] for one in (job, row) if "labels" in one]
    # Labels that are no map are kept, so that the request is rejected.
    wrong = [one for one in labels if not isinstance(one, dict)]
    both = wrong[0] if wrong else {name: text for one in labels for name, text in one.items()}
    return {**job, **row, **({"labels": both} if labels else {})}


def _require_usable(series: SeriesRequest, place: int, tree: Tree) -> None:
    """Raise ProblemError for a request that no job can have."""
    try:
        request_of(tree)
    except ValidationError as error:
        row = series.values[place] if series.values else series.grid
        source = f"/values/{place}" if series.values else "/csv" if series.csv else "/grid"
        entries: list[dict[str, str]] = []
        for one in error.errors()[:5]:
            entry = error_entry({**one, "loc": ("body", *one["loc"])})
            name = entry["pointer"].split("/")[1] if entry["pointer"] else ""
            if series.csv:
                pointer = "/csv"
            else:
                pointer = f"{source if name in row else '/job'}{entry['pointer']}"
            entries.append({"pointer": pointer, "message": f"job {place + 1}: {entry['message']}"})
        raise ProblemError(
            422,
            "invalid-request",
            "The request cannot be used",
            "; ".join(entry["message"] for entry in entries),
            errors=entries,
        ) from error


def _table(series: SeriesRequest) -> Iterator[Tree]:
    """Yield the members of each job of the table; raises ProblemError with the line."""
    (start, names), *rows = [*_lines(series.csv)] or [(1, [])]
    if not rows:
        raise unusable(
            "csv: give a line with the names of the members, and one line for each job",
            pointer="/csv",
        )
    if len(rows) > MOST_JOBS:
        raise unusable(f"csv: {len(rows)} jobs: a series has {MOST_JOBS} at most", pointer="/csv")
    odd = [name for name in names if not name or names.count(name) > 1 or name in OF_SERIES]
    if odd:
        raise unusable(
            f"csv, line {start}: the column {odd[0]!r} has no name of its own, or one that "
            "the series sets for all jobs",
            pointer="/csv",
        )
    for number, row in rows:
        if len(row) != len(names):
            raise unusable(
                f"csv, line {number}: {len(row)} cells, must be {len(names)} as in the first line",
                pointer="/csv",
            )
        yield _row(series.job, dict(zip(names, row, strict=True)), number)


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of each row with the number of its line, without blank lines and comments.

    A quoted cell may have line breaks. Raises ProblemError.
    """
    lines = enumerate(StringIO(text.removeprefix("\ufeff"), newline=""), start=1)
    separator = ""
    for number, line in lines:
        if not line.strip() or line.startswith("#"):
            continue
        separator = separator or next((sign for sign in SEPARATORS if sign in line), ",")
        whole = chain([line], (more for _, more in lines))
        try:
            row = next(csv.reader(whole, delimiter=separator, strict=True))
        except csv.Error as error:
            raise unusable(f"csv, line {number}: {error}", pointer="/csv") from error
        yield number, [cell.strip() for cell in row]


def _row(job: Mapping[str, Any], cells: Mapping[str, str], line: int) -> Tree:
    given = {name: text for name, text in cells.items() if text}
    kind = job_kinds().get(given.get("kind", str(job.get("kind", ""))))
    variant = "" if kind is None else kind.variant_field
    known = given.get(variant, str(job.get(variant, "")))
    fields: Mapping[str, Any] = {}
    if kind is not None and (not variant or known in kind.variants):
        fields = kind.request_of(known).model_fields
    found: Tree = {}
    labels: dict[str, str] = {}
    for name, text in given.items():
        if name.startswith(LABEL):
            labels[name.removeprefix(LABEL)] = text
            continue
        try:
            found[name] = _value(name, text, fields)
        except ValueError as error:
            unit = unit_of(name)
            raise unusable(
                f"csv, line {line}: {name} = {text!r:.80}{f' {unit}' if unit else ''}: {error}",
                pointer="/csv",
            ) from error
    return _merged(found, {"labels": labels} if labels else {})


def _value(name: str, text: str, fields: Mapping[str, Any]) -> Any:
    """Return the value of a cell, in the type of the member; raises ValueError for no number."""
    if text[0] in "[{":
        try:
            return json.loads(text)
        except RecursionError as error:
            raise ValueError("nested too deeply") from error
    if unit_of(name):
        return numerals.number(text)
    if name in fields:
        with suppress(ValidationError):  # validating the whole request reports it
            read: TypeAdapter[Any] = TypeAdapter(fields[name].annotation)
            return read.dump_python(read.validate_strings(text), mode="json")
    return text
