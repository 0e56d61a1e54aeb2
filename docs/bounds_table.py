"""Page of bounds, with their values from the code."""

import json
import re
from collections.abc import Iterator, Sequence

from pincette.api import series
from pincette.engine import log_files
from pincette.records import mcap_file
from pincette_recorder import intake, retention
from pincette_supervisor import metrics, model, plugin, problems, traces
from pincette_supervisor.jobs import bring_up
from pincette_supervisor.journal import access, events, library, store
from pincette_supervisor.journal import series as stored_series
from pincette_supervisor.kinds import track
from pincette_supervisor.planning import dry_run, recorded_jobs
from pincette_supervisor.plugin import model_in_use
from pincette_supervisor.rest import (
    api,
    limits,
    middleware,
    routes_events,
    routes_page,
    server,
    strict_route,
)
from pincette_supervisor.results import history, job_table, run_samples
from pincette_supervisor.rigs import live, observer, places

HEAD = """\
# Bounds

Generated from the constants of the code by `make docs`; a test compares the two. Each row states
what happens beyond a bound. The export of jobs (`GET /jobs/export.…`) has none.

"""
Rows = Sequence[tuple[str, str, str]]
LISTENERS = "503 `too-many-listeners`"


def bounds_page() -> str:
    """Return the page as Markdown."""
    return HEAD + "\n".join(
        line
        for title, rows in (
            ("Lists and streams", _lists()),
            ("Requests", _requests()),
            ("What is kept", _kept()),
            ("Records and figures", _records()),
        )
        for line in _section(title, rows)
    )


def _section(title: str, rows: Rows) -> Iterator[str]:
    yield f"## {title}\n"
    yield "| what | bound | beyond it |"
    yield "| --- | --- | --- |"
    for what, bound, beyond in rows:
        yield f"| {what} | {bound} | {beyond} |"
    yield ""


def _lists() -> Rows:
    return (
        (
            "page of jobs, series, trajectories, calibrations, recipes, learned programs, alarms, "
            "audit entries",
            _page_bound(),
            "`next` names the next page; client and command line fetch all pages",
        ),
        (
            "list of events",
            str(routes_events.MOST),
            "`newest` is above the last number: request the rest with `after`",
        ),
        (
            "events that wait for one listener",
            str(events.CAPACITY),
            "numbered ones are read from the journal; progress is left out, and an event "
            "`dropped` counts it",
        ),
        ("listeners to events", str(events.LISTENERS_MAX), LISTENERS),
        ("listeners of one client to live samples", str(live.LISTENERS_MAX), LISTENERS),
        (
            "live samples",
            f"{live.KEPT_S:g} s, {live.KEPT_PER_S:g} a second",
            "older ones are in the record; of a faster rig evenly spaced ones; `dropped` of a "
            "batch counts what a slow listener missed",
        ),
        (
            "jobs, proposals and alarms that the page shows",
            ", ".join(_shown_by_page(name) for name in ("jobs", "calibrations", "alarms")),
            "the page says so: the search and the command line find older ones",
        ),
        (
            "proposals in which the checklist looks for undecided ones",
            str(bring_up.LOOKED_AT),
            "`GET /calibrations` lists older ones; those in use are always found",
        ),
        ("jobs of a history", str(history.JOBS_MOST), "`left_out` counts the oldest"),
        (
            "rigs in the metrics",
            str(metrics.MOST_RIGS),
            "`pincette_rigs_left_out` counts the others",
        ),
    )


def _shown_by_page(name: str) -> str:
    (most,) = re.findall(r"const MOST = (\d+)", (routes_page.FOLDER / f"js/{name}.js").read_text())
    return most


def _page_bound() -> str:
    operations = [
        one
        for methods in json.loads(api.openapi_document())["paths"].values()
        for one in methods.values()
    ]
    (most,) = {
        parameter["schema"]["maximum"]
        for operation in operations
        for parameter in operation.get("parameters", ())
        if parameter["name"] == "limit" and "maximum" in parameter["schema"]
    }
    return str(most)


def _requests() -> Rows:
    short, long = limits.OF_ONE["short"], limits.OF_ONE["long"]
    return (
        (
            "body",
            f"{limits.SMALL_BYTES} bytes, {limits.LARGE_BYTES} where it may have points, labels or "
            "notes",
            "413 with the limit",
        ),
        (
            "commas, colons and opening brackets of a body",
            str(strict_route.SIGNS_MAX),
            "413 with the limit",
        ),
        ("members of one object", str(strict_route.MEMBERS_MAX), "413 with the limit"),
        ("points of a path", str(track.POINTS_MAX), "422 with the limit"),
        ("levels of a staircase", str(track.LEVELS_MAX), "422 with the limit"),
        (
            "jobs of a series",
            str(series.MOST_JOBS),
            "422 with the limit; its list of jobs is complete",
        ),
        ("query parameters", str(strict_route.PARAMETERS_MAX), "422 with the limit"),
        ("head", f"{server.HEAD_BYTES} bytes, {server.HEADERS_MAX} headers", "400 or 431"),
        (
            "concurrent requests of one client",
            f"{short}, and {long} streams and long polls",
            "429 with `Retry-After`",
        ),
        (
            "concurrent requests of all clients",
            f"{limits.AT_ONCE['short']}, and {limits.AT_ONCE['long']} streams and long polls",
            "503 with `Retry-After`",
        ),
        (
            "errors of one request in `errors`",
            str(problems.ERRORS_MAX),
            "`detail` ends with the number of the others",
        ),
        ("action and detail of an audit entry", f"{middleware.LENGTH} characters", "cut off"),
    )


def _kept() -> Rows:
    return (
        (
            "events",
            f"at least {store.EVENTS_KEPT}",
            "the oldest are deleted; `oldest` names the oldest that is left",
        ),
        ("alarms", f"at least {events.ALARMS_KEPT}", "the oldest go"),
        ("audit entries", f"at least {access.AUDIT_KEPT}", "the oldest go"),
        ("signed-in pages", str(access.SESSIONS_MAX), "the least recently used one is signed out"),
        (
            "recipes, and versions of one",
            f"{library.RECIPES_MAX}, {library.VERSIONS_MAX}",
            "409 `recipe-limit`",
        ),
        (
            "trajectories",
            str(library.TRAJECTORIES_MAX),
            "the oldest are deleted; a request for their digest is answered with 404",
        ),
        (
            "series",
            str(stored_series.KEPT),
            "the oldest are deleted; their jobs are kept, with the label `series`",
        ),
        (
            "sources of places on the bus",
            str(places.SOURCES_MAX),
            "the one that has been silent or unused for longest is forgotten",
        ),
        (
            "newest jobs of a source of places that its difference is the mean of",
            str(places.JOBS_MAX),
            "older ones do not count",
        ),
        ("learned programs of a rig", str(library.LEARNED_MAX), "the oldest go"),
        ("residual tables of a model", str(model_in_use.MOST_TABLES), "the oldest go"),
        ("changes of instruments", str(model.KEPT_CHANGES), "the oldest go"),
        (
            "log file of a program",
            f"{log_files.FULL_BYTES / 1e6:g} MB, and {log_files.KEPT} older files",
            "the oldest go",
        ),
    )


def _records() -> Rows:
    return (
        (
            "index of `job.mcap`",
            f"{mcap_file.INDEXED_CHUNKS} chunks, {_indexed_min():.0f} min",
            "the file has none; tools read it from its start",
        ),
        (
            "rows of holds in the supervisor",
            f"{run_samples.HELD_ROWS}, and {run_samples.EXTREME_ROWS} extremes",
            "evenly spaced; the record has all rows; means, peaks and counts use all of them",
        ),
        (
            "messages that wait in supervisor and recorder",
            f"{observer.CAPACITY}, {intake.ROOM}",
            "`dropped_messages` of the result, and `record_detail`, count the lost ones",
        ),
        (
            "played part of a plan",
            f"{dry_run.LONGEST_S:g} s, {dry_run.LONGEST_SAMPLES} samples",
            "`cut` states why the rest was not played",
        ),
        (
            "events of a job in its trace",
            str(traces.MOST_EVENTS),
            "later ones have no span; the record and the list of events have them",
        ),
        ("points of a plan's curve", str(plugin.CURVE_POINTS), "evenly spaced"),
        (
            "samples of a job for `residual`",
            str(recorded_jobs.MOST_SAMPLES),
            "422: name a job with a shorter hold",
        ),
        (
            "different words of a column of `job list --out FILE --numbers`",
            str(job_table.MOST_WORDS),
            "the column is left out, and the metadata names it",
        ),
        (
            "newest records that `keep_days` and `keep_GB` do not delete",
            str(retention.NEWEST),
            "see [how long records are kept](../how-to/records.md#how-long-records-are-kept)",
        ),
    )


def _indexed_min() -> float:
    return mcap_file.INDEXED_CHUNKS * mcap_file.CHUNK_NS / 6e10


PAGES = {"reference/bounds.md": bounds_page}
