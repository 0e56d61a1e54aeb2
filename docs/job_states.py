"""Page with the states of a job, and its drawing; both use the table that the program uses."""

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from pincette.api.rig_states import MOTION, RIG_STATES
from pincette.api.series import SERIES_STATES
from pincette.api.states import BEYOND, EVENTS, HOLDS, NEEDS, STATES, Event, JobState

WIDTH, HEIGHT = 980, 452
BOX = (124, 40)
PLACES: Mapping[JobState, tuple[int, int]] = {
    "proposed": (90, 110),
    "queued": (90, 190),
    "preparing": (90, 270),
    "ready": (90, 350),
    "running": (420, 270),
    "pausing": (560, 180),
    "paused": (420, 90),
    "resuming": (280, 180),
    "awaiting_recovery": (750, 118),
    "stopping": (560, 350),
    "aborting": (560, 420),
    "succeeded": (880, 180),
    "stopped": (880, 350),
    "aborted": (880, 420),
    "failed": (880, 90),
    "interrupted": (880, 30),
}
"""Centre of each box."""
PLAYS: tuple[JobState, ...] = ("running", "pausing", "paused", "resuming")
STILL: tuple[JobState, ...] = ("proposed", "queued", "preparing", "ready")
FRAMES: Mapping[str, tuple[int, int, int, int]] = {
    "nothing has moved": (20, 55, 140, 380),
    "the program plays": (205, 40, 430, 268),
}
EVERYWHERE: tuple[JobState, ...] = ("failed", "interrupted")  # described in the text
INK, FAINT, END, LABEL = "#1f2a33", "#8a97a3", "#eef3f6", "#47545f"

HEAD = """\
# The life of a job

Generated from `pincette.api.states` by `make docs`; a test compares the two. The supervisor, this
page and the tests read the same table; no other state or event is possible.

![States of a job as boxes, the events between them as arrows](../images/job-states.svg)

"""
RULES = """\
## What to rely on

- A job is a resource with a state. Losing the connection to the supervisor loses no job.
- One `Idempotency-Key` creates one job, even over a restart: a second request with the same key
  waits while the first one is planned, and gets its job. If the first is refused, the second is
  planned instead.
- `POST /api/v1/jobs/stop` with the key stops its job, or the request while it is planned.
- A request whose caller hangs up before the job is planned begins nothing, since no client would
  know of the motion. The audit log records this. The request can be sent again with its key.
- A state that ends in -ing has a deadline. When it has passed, the event is `overdue`, which leads
  to `aborting`, and from there to `failed`: no job hangs.
- `pause` acts at the next safe point, where the references are at rest. From then on they stay, the
  law holds force and position, and the guards stay active. `paused` has no deadline.
- `stop` from `paused` does not go through `running`: the controller is only requested to stop, and
  nothing moves.
- A stop keeps a held part, unless the request states `"on_stop": "release"` (unload, and rest
  there) or `"retract"` (unload, and return to rest). A calibration presses to measure: its stop is
  always a `retract`. An abort freezes the voltage for the rig file's `freeze_s`, unless the request
  states `"on_abort": "ramp"`.
- A stopped job that holds a part keeps the rig. Its action `release` releases the part; a job of
  the kind `hold` or `release` takes the part over, also from a running job that holds it until a
  release.
- After a trip with a part held, the actuator is frozen. A reset then keeps the voltage and the
  part, and only jobs of the kinds `hold` and `release` can start.
- With `approval_s` a job is `proposed`: it has neither the rig nor a place in the queue until a
  person [approves](../how-to/approval.md) it. Its approval is refused as a new request would be, if
  the rig is not free or the plan breaks a limit now; the job then stays `proposed`.
- With `"queue": true` a job waits while another has the rig. The next one is planned again with the
  model in use when its turn comes. A job that does not end as `succeeded`, and a restart of the
  supervisor, halt the queue until a person resumes it: `POST /api/v1/rigs/{rig}/queue/actions` with
  `{"type": "resume"}` or `{"type": "clear"}`. A held part, or an emergency stop between two jobs,
  also halts it; no waiting job is lost.
- Jobs with a higher `priority` start first. `{"type": "move", "job": …, "position": 1}` moves a
  waiting job to another position in the queue; its action `stop` removes it.
- `ending` of an ended job states why it ended: a code, with the measured values. `cause` states the
  same in words. The result of an interrupted job is computed from its record.
- The end of a job is published before its files are written: `artifacts` is `none`,
  `being_written`, `ready` or `deleted`. `wait=recorded` waits for the files, and the rig is free
  meanwhile. If the supervisor is killed, the next one completes them.
- A calibration with a free arm that a stall of the machine has tripped is `failed`, and restarts as
  a new job that its `cause` names, until it has started `tries` times.
- A supervisor that is killed leaves its job `interrupted` while the motion program continues. In
  real time the controller stops the program when the lease ends (`[safety] lease_s`, three times
  that for a calibration), as the job states. When a supervisor starts again, it requests the
  controller once to stop; a held part stays held, and a calibration releases it. Nothing resumes
  automatically.
"""


def jobs_page() -> str:
    """Return the page as Markdown."""
    states = [("state", "meaning", "leads to", "deadline", "actions")]
    states += [
        (f"`{name}`", row.meaning, _leads(row.events), _deadline(name), _ticked(row.actions))
        for name, row in STATES.items()
    ]
    events = [("event", "what it is"), *((f"`{name}`", said) for name, said in EVENTS.items())]
    actions = [("action", "offered only while", "holds already in")]
    needed = {"held": "a part is held", "waiting": "the program waits"}
    actions += [
        (f"`{name}`", needed.get(NEEDS.get(name, ""), ""), _ticked(states))
        for name, states in HOLDS.items()
    ]
    rig_states = [("state", "meaning", "a job may start", "the stage may move", "what to do")]
    rig_states += [
        (
            f"`{name}`",
            row.meaning,
            "yes" if row.may_start else "no",
            "yes" if row.may_move else "no",
            row.remedy,
        )
        for name, row in RIG_STATES.items()
    ]
    series = [("state", "meaning", "actions")]
    series += [
        (f"`{name}`", row.meaning, _leads(row.actions)) for name, row in SERIES_STATES.items()
    ]
    motion = [("state", "meaning", "the stage may move")]
    motion += [
        (f"`{name}`", row.meaning, "yes" if row.may_move else "no") for name, row in MOTION.items()
    ]
    return (
        HEAD
        + f"{_everywhere('fail')} {_everywhere('interrupt')}\n\n"
        + "## States\n\n"
        + _table(states)
        + "## Events\n\n"
        + _table(events)
        + "## Actions\n\n"
        + "The job stores each action with its sender, its time and the sample at which it acted.\n"
        + "If the job is already in the requested state, the answer is 200 instead of 202.\n\n"
        + _table(actions)
        + RULES
        + "\n## A series of jobs\n\n"
        + "A [series](../how-to/series.md) starts its jobs one after the other, from "
        + "`pincette.api.series`.\n\n"
        + _table(series)
        + "## The rig\n\n"
        + "`latch.state` and `standing.state` of a rig, from `pincette.api.rig_states`.\n\n"
        + _table(rig_states)
        + "`safe_to_move.state` of a rig, from the same module.\n\n"
        + _table(motion).rstrip("\n")
        + "\n"
    )


def _everywhere(event: Event) -> str:
    """Return the states in which an event is possible, in words."""
    ends = {row.events[event] for row in STATES.values() if event in row.events}
    lacking = [name for name, row in STATES.items() if not row.terminal and event not in row.events]
    (end,) = ends
    but = f" but {_ticked(lacking)}" if lacking else ""
    return f"`{event}` leads to `{end}` from every state that is not final{but}."


def _leads(events: Mapping[Any, str]) -> str:
    return "<br>".join(f"`{event}` → `{state}`" for event, state in events.items()) or "an end"


def _deadline(name: JobState) -> str:
    row = STATES[name]
    if row.deadline_s is None:
        return ""
    beyond = BEYOND[row.beyond]
    return f"{row.deadline_s:g} s" + (f" + {beyond}" if beyond else "")


def _ticked(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _table(rows: list[tuple[str, ...]]) -> str:
    first, *rest = ("| " + " | ".join(row) + " |\n" for row in rows)
    return first + "|" + " --- |" * len(rows[0]) + "\n" + "".join(rest) + "\n"


def states_drawing() -> str:
    """Return the states as boxes and the events as arrows, as SVG."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" height="{HEIGHT}" font-family="system-ui, sans-serif" role="img">',
        "<title>States of a job</title>",
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" '
        f'markerHeight="7" orient="auto"><path d="M0 1 L9 5 L0 9 z" fill="{INK}"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        *(_frame(name, *place) for name, place in FRAMES.items()),
        *(_arrow(start, end, words) for start, end, words in _inner()),
        *_outer(),
        *(_box(name) for name in STATES),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _inner() -> list[tuple[JobState, JobState, str]]:
    """Return the arrows between boxes, except those drawn from a frame."""
    found: dict[tuple[JobState, JobState], list[str]] = {}
    for name, row in STATES.items():
        for event, end in row.events.items():
            told = name in (*PLAYS, *STILL) and end not in (*PLAYS, *STILL)
            told = told or (name == "awaiting_recovery" and end != "succeeded")
            if not told and end not in EVERYWHERE:
                found.setdefault((name, end), []).append(event)
    return [(start, end, ", ".join(words)) for (start, end), words in found.items()]


def _outer() -> list[str]:
    """Return the arrows that start at a frame, for events that (nearly) all boxes in it have."""
    x, y, width, height = FRAMES["the program plays"]
    right, low = x + width, y + height
    left, top = FRAMES["nothing has moved"][0], FRAMES["nothing has moved"][1]
    side, foot = left + FRAMES["nothing has moved"][2], top + FRAMES["nothing has moved"][3]
    return [
        _line(right, 180, _edge("succeeded")[0], 180, _events(PLAYS, "succeeded")),
        _path(
            f"M{right} 118 H{_edge('awaiting_recovery')[0]}",
            right + 4,
            111,
            _events(PLAYS, "awaiting_recovery"),
            anchor="start",
        ),
        f'<text x="664" y="156" font-size="11" fill="{LABEL}">stop, abort: at once</text>',
        _line(560, low, 560, 330, _events(PLAYS, "stopping"), beside=True),
        _path(
            f"M{right} 250 H{right + 60} V{_edge('aborting')[1]} H{_edge('aborting')[0] + BOX[0]}",
            right + 66,
            300,
            _events(PLAYS, "aborting"),
            anchor="start",
        ),
        _path(
            f"M{side} 350 H{_edge('stopping')[0]}", 250, 343, _events(STILL, "stopping"), faint=True
        ),
        _path(
            f"M{side} 420 H{_edge('aborting')[0]}", 250, 413, _events(STILL, "aborting"), faint=True
        ),
        f'<text x="{left}" y="{foot + 13}" font-size="11" fill="{LABEL}">'
        "proposed, queued and ready end at once</text>",
        f'<text x="812" y="64" font-size="12" text-anchor="end" fill="{LABEL}">from nearly '
        "every state</text>",
    ]


def _events(states: tuple[JobState, ...], end: JobState) -> str:
    words: list[str] = []
    for state in states:
        words += [e for e, to in STATES[state].events.items() if to == end and e not in words]
    return ", ".join(words)


def _edge(name: JobState) -> tuple[int, int]:
    """Return the middle of a box's left side."""
    x, y = PLACES[name]
    return x - BOX[0] // 2, y


def _arrow(start: JobState, end: JobState, words: str) -> str:
    (x0, y0), (x1, y1) = PLACES[start], PLACES[end]
    (sx, sy), (ex, ey) = _rim(x0, y0, x1, y1), _rim(x1, y1, x0, y0)
    return _line(sx, sy, ex, ey, words, beside=abs(x1 - x0) < 20)


def _rim(x: int, y: int, to_x: int, to_y: int) -> tuple[int, int]:
    """Return the point where the line from the centre of a box to a point leaves the box."""
    half_x, half_y = BOX[0] / 2, BOX[1] / 2
    share = min(
        half_x / abs(to_x - x) if to_x != x else 1e9, half_y / abs(to_y - y) if to_y != y else 1e9
    )
    return round(x + share * (to_x - x)), round(y + share * (to_y - y))


def _line(x0: int, y0: int, x1: int, y1: int, words: str, *, beside: bool = False) -> str:
    course = f"M{x0} {y0} L{x1} {y1}"
    if beside:
        return _path(course, x0 + 6, y0 + min(40, (y1 - y0) // 2) + 4, words, anchor="start")
    # The label of a horizontal arrow is placed off the middle, where another arrow may cross.
    x = x0 + 2 * (x1 - x0) // 3 if y0 == y1 else (x0 + x1) // 2
    return _path(course, x, (y0 + y1) // 2 - 6 * (y0 == y1) + 4 * (y0 != y1), words)


def _path(
    course: str, x: int, y: int, words: str, *, anchor: str = "middle", faint: bool = False
) -> str:
    ink = FAINT if faint else INK
    return (
        f'<path d="{course}" fill="none" stroke="{ink}" stroke-width="1.4" '
        'marker-end="url(#tip)"/>'
        f'<text x="{x}" y="{y}" font-size="12" text-anchor="{anchor}" fill="{LABEL}" '
        f'stroke="#ffffff" stroke-width="4" paint-order="stroke">{escape(words)}</text>'
    )


def _frame(name: str, x: int, y: int, width: int, height: int) -> str:
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="14" fill="none" '
        f'stroke="{FAINT}" stroke-dasharray="5 5"/>'
        f'<text x="{x + 14}" y="{y + 20}" font-size="12" fill="{LABEL}">{escape(name)}</text>'
    )


def _box(name: JobState) -> str:
    (x, y), (width, height) = PLACES[name], BOX
    end = STATES[name].terminal
    return (
        f'<rect x="{x - width // 2}" y="{y - height // 2}" width="{width}" height="{height}" '
        f'rx="{height // 2 if end else 7}" fill="{END if end else "#ffffff"}" stroke="{INK}" '
        'stroke-width="1.6"/>'
        f'<text x="{x}" y="{y + 5}" font-size="{15 if len(name) < 16 else 13}" '
        f'text-anchor="middle" fill="{INK}">{name}</text>'
    )


PAGES: dict[str, Any] = {
    "explanations/jobs.md": jobs_page,
    "images/job-states.svg": states_drawing,
}
"""Pages by path below docs."""
