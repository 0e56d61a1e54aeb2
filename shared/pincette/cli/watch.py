"""``pincette watch``: follow a job to its end, or every event of the rigs."""

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from math import inf
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from pincette.cli import CliError, Exit
from pincette.cli.access import FOLLOWED_S, Target
from pincette.cli.options import Everything
from pincette.cli.readers import integer
from pincette.cli.results import show_result
from pincette.cli.terminal import (
    STATE_COLOURS,
    clock,
    command,
    emit,
    fitted,
    group,
    patience,
    screen,
)

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from pincette.api.events import Event
    from pincette.api.jobs import Job, Progress
    from pincette.client import JobHandle


PASSING = ("progress", "dropped")
ALARMING = ("alarm",)
MAIN = {"action": "type", "alarm": "cause", "result": "outcome"}
"""Name of the main member of an event, for kinds in which it differs from the kind."""
POLL_S = 0.2
BAR_WIDTH = 24
WITH_BAR = 74
"""Smallest terminal width, in characters, at which numbers and bar fit into a line."""

app = group()


@command(app, "watch")
def watch(
    target: Target,
    name: Annotated[
        str | None,
        Argument(metavar="JOB", help="id of the job, or `last`; every event if not given"),
    ] = None,
    after: Annotated[
        int | None,
        Option(
            "--after", parser=integer, metavar="N", help="start with the events after this number"
        ),
    ] = None,
    everything: Everything = False,
) -> int | None:
    """Follow a job, a rig, or all."""
    if name and not target.json:
        job = target.job(name).patient(FOLLOWED_S)
        return followed(job, machine=False, everything=everything)
    if name:
        events = target.job(name).patient(FOLLOWED_S).events(after or 0)
    else:
        doing, events = _of_rigs(target, after)
        if not target.json:
            said = f"{doing}; events are printed as they happen, Ctrl-C ends this\n"
            sys.stderr.write(fitted(said, sys.stderr))
    console = screen()
    for event in events:
        if target.json:
            sys.stdout.write(event.model_dump_json() + "\n")
            sys.stdout.flush()
        elif event.kind not in PASSING:
            console.print(line(event))
    return None


def _of_rigs(target: Target, after: int | None) -> "tuple[str, Iterator[Event]]":
    """Return the present state of the rigs, followed by later events; idle rigs send none.

    Without a name, all rigs are included. The supervisor must reply first.
    """
    supervisor = target.supervisor()
    if target.rig_name is None:
        rigs, events = supervisor.rigs(), supervisor.patient(inf).events(after)
    else:
        rig = supervisor.rig(target.rig_name)
        rigs, events = [rig.state()], rig.patient(inf).events(after)
    doing = [f"job {rig.active_job}" if rig.active_job else rig.standing.state for rig in rigs]
    words = [f"{rig.name}: {does}" for rig, does in zip(rigs, doing, strict=True)]
    return ", ".join(words), events


def line(event: "Event") -> "Text":
    """Format one event as a line: time, job, content."""
    from rich.text import Text

    body = event.body
    state = str(body.get("state", ""))
    colour = "red" if event.kind in ALARMING else STATE_COLOURS.get(state, "default")
    return Text.assemble(
        (clock(event.at)[11:], "dim"),
        f"  {event.job or event.rig:<20}  {event.kind:<7}  ",
        (words(event.kind, body), colour),
    )


def words(kind: str, body: dict[str, Any]) -> str:
    """Return the text of an event: its main member first, then the other non-empty members."""
    main = MAIN.get(kind, kind)
    if kind == "alarm" and "alarm" in body:
        return alarm_words(body)
    first = str(body.get(main, ""))
    rest = [
        _member(name, value)
        for name, value in body.items()
        if name not in (main, "event") and value not in (None, "", False, [], {})
    ]
    return ", ".join([first, *rest] if first else rest)


def alarm_words(body: dict[str, Any]) -> str:
    """Return the state of an alarm, in the terms of the alarm log."""
    about: dict[str, Any] = body["alarm"]
    by = f" by {body['by']}" if body.get("by") and body["did"] == "acknowledged" else ""
    came = f", {about['count']} times" if about.get("count", 1) > 1 else ""
    did = "" if body["did"] == "raised" else f"{body['did']}{by}: "
    return f"{did}{body['words']}{came} (alarm {about.get('id', '?')})"


def _member(name: str, value: object) -> str:
    if value is True:
        return name
    return f"{name} {value:.5g}" if isinstance(value, float) else f"{name} {value}"


def followed(job: "JobHandle", *, machine: bool, everything: bool = False) -> int:
    """Follow a job to its end, and show its result; the exit status shows whether it succeeded."""
    console = screen(machine=machine)
    try:
        follow_recorded(job, console)
    except KeyboardInterrupt:
        raise CliError(
            f"no longer followed, but job {job.id} continues: `pincette job stop {job.id}` "
            "stops it, `pincette estop` stops the rig",
            Exit.INTERRUPTED,
        ) from None
    if machine:
        emit(job.job)
    else:
        show_result(job.job, console, everything=everything)
    return status_of(job.job)


def follow_recorded(job: "JobHandle", console: "Console") -> "Job":
    """Show the progress of a job until it has ended and its record is written."""
    follow(job, console)
    if job.job.artifacts == "being_written":
        with patience("the motion has ended; its record is being written"):
            job.recorded()
    return job.job


def status_of(job: "Job") -> Exit:
    """Return the exit status for the result of a followed job."""
    if job.state != "succeeded":
        return Exit.FAILED
    goal = (job.result or {}).get("goal")
    return Exit.DONE if goal is None or goal["met"] is not False else Exit.GOAL_MISSED


def follow(job: "JobHandle", console: "Console") -> "Job":
    """Show the progress of a job until it has ended, and return its final state.

    If the job waits for a person and there is a terminal, ask for the return key, then continue the
    job.
    """
    show = _Bar(console) if console.is_terminal else _Lines(console)
    asked = ""
    with show:
        live = job.job.progress
        show.show(job.job, live)
        while not job.ended:
            job.refresh(POLL_S)
            live = job.job.progress or live
            show.show(job.job, live)
            if live is None or "continue" not in job.job.allowed_actions or live.phase == asked:
                continue
            asked = live.phase
            if show.ask(job.id, live.instruction):
                job.proceed()
    return job.job


class _Bar(AbstractContextManager[None]):
    """Progress as one line that is redrawn."""

    def __init__(self, console: "Console") -> None:
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as Bar

        self._progress = Bar(
            TextColumn("{task.description:<9}"),
            *([BarColumn(BAR_WIDTH)] if console.width >= WITH_BAR else []),
            TextColumn("{task.fields[share]:>4}"),
            TextColumn("{task.fields[now]}"),
            TextColumn("{task.fields[left]}"),
            console=console,
        )
        self._bar = self._progress.add_task("queued", total=None, share="", now="", left="")

    def __enter__(self) -> None:
        self._progress.start()

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, job: "Job", live: "Progress | None") -> None:
        from pincette.api.states import STATES

        elapsed_s = 0.0 if live is None else live.elapsed_s
        planned_s = None if live is None else live.planned_s
        if job.state == "succeeded":
            # The motion is shorter if contact occurs earlier than planned.
            planned_s = elapsed_s
        self._progress.update(
            self._bar,
            description=phase_of(job, live),
            total=planned_s,
            completed=elapsed_s,
            share=share(elapsed_s, planned_s),
            now=newest(live),
            left="" if STATES[job.state].terminal else left(elapsed_s, planned_s),
        )

    def ask(self, name: str, instruction: str) -> bool:
        """Ask for the return key; returns False if there is no terminal."""
        if not sys.stdin.isatty():
            self._progress.console.print(_order(name, instruction), markup=False)
            return False
        self._progress.stop()
        self._progress.console.input(f"{instruction}, then press return ")
        self._progress.start()
        return True


class _Lines(AbstractContextManager[None]):
    """Progress with one line per phase, for a file or a pipe."""

    def __init__(self, console: "Console") -> None:
        self._console = console
        self._shown = ""

    def __exit__(self, *_: object) -> None:
        return

    def show(self, job: "Job", live: "Progress | None") -> None:
        phase = phase_of(job, live)
        if phase == self._shown:
            return
        self._shown = phase
        elapsed_s = 0.0 if live is None else live.elapsed_s
        line = f"{elapsed_s:6.2f} s  {phase:<9} {newest(live)}"
        self._console.print(line.rstrip(), markup=False)

    def ask(self, name: str, instruction: str) -> bool:
        """Print what the job waits for, and how to continue."""
        self._console.print(_order(name, instruction), markup=False)
        return False


def _order(name: str, instruction: str) -> str:
    return f"{instruction}, then `pincette job continue {name}`"


def phase_of(job: "Job", live: "Progress | None") -> str:
    """Return the phase of a running job, otherwise its state."""
    if job.state != "running" or live is None:
        return job.state
    return live.phase or job.state


def newest(live: "Progress | None") -> str:
    """Return the newest position and force, with constant width."""
    if live is None or live.x_um is None:
        return ""
    force = " " * 9 if live.force_mN is None else f"{live.force_mN:6.2f} mN"
    return f"{live.x_um:6.2f} µm {force}"


def share(elapsed_s: float, planned_s: float | None) -> str:
    """Return the elapsed fraction of the planned time, as text."""
    return f"{min(1.0, elapsed_s / planned_s):.0%}" if planned_s else ""


def left(elapsed_s: float, planned_s: float | None) -> str:
    """Return the remaining planned time, as text."""
    return f"{max(0.0, planned_s - elapsed_s):4.1f} s left" if planned_s else ""
