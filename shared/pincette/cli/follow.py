"""A job followed to its end: a bar in a terminal, a line for each phase elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from pincette.cli.rest import Supervisor

TERMINAL = frozenset({"succeeded", "stopped", "aborted", "failed", "interrupted"})
POLL_S = 0.2
BAR_WIDTH = 24
COLUMNS = (
    TextColumn("{task.description:<9}"),
    BarColumn(BAR_WIDTH),
    TextColumn("{task.fields[share]:>4}"),
    TextColumn("{task.fields[now]}"),
    TextColumn("{task.fields[left]}"),
)


def follow(supervisor: Supervisor, name: str, console: Console) -> dict[str, Any]:
    """Show a job's progress until it has ended, and return it as it is then.

    Where it waits for a person, a terminal asks for the return key and then goes on.
    """
    job: dict[str, Any] = {}
    show = _Bar(console) if console.is_terminal else _Lines(console)
    asked = ""
    with show:
        for job, live in polls(supervisor, name):
            show.show(job, live)
            if "continue" not in job.get("allowed_actions", ()) or live["phase"] == asked:
                continue
            asked = live["phase"]
            if show.ask(name, live["instruction"]):
                supervisor.post(f"/jobs/{name}/actions", {"type": "continue"})
    return job


def polls(supervisor: Supervisor, name: str) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """A job again and again until it has ended, with the newest progress that is known."""
    live: dict[str, Any] = {}
    state = ""
    while state not in TERMINAL:
        job = supervisor.get(f"/jobs/{name}", wait="terminal", timeout_s=POLL_S)
        live, state = job.get("progress") or live, job["state"]
        yield job, live


class _Bar(AbstractContextManager[None]):
    """One line that is drawn anew."""

    def __init__(self, console: Console) -> None:
        self._progress = Progress(*COLUMNS, console=console)
        self._bar = self._progress.add_task("queued", total=None, share="", now="", left="")

    def __enter__(self) -> None:
        self._progress.start()

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, job: dict[str, Any], live: dict[str, Any]) -> None:
        elapsed_s, planned_s = live.get("elapsed_s", 0.0), live.get("planned_s")
        if job["state"] == "succeeded":
            # Where contact comes sooner than planned, the course is shorter.
            planned_s = elapsed_s
        self._progress.update(
            self._bar,
            description=phase_of(job, live),
            total=planned_s,
            completed=elapsed_s,
            share=share(elapsed_s, planned_s),
            now=newest(live),
            left="" if job["state"] in TERMINAL else left(elapsed_s, planned_s),
        )

    def ask(self, name: str, instruction: str) -> bool:
        """Ask for the return key; false where nobody can press it."""
        if not sys.stdin.isatty():
            self._progress.console.print(_order(name, instruction), markup=False)
            return False
        self._progress.stop()
        self._progress.console.input(f"{_what(instruction)}, then press return ")
        self._progress.start()
        return True


class _Lines(AbstractContextManager[None]):
    """A line for each phase, for a file or a pipe."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._said = ""

    def __exit__(self, *_: object) -> None:
        return

    def show(self, job: dict[str, Any], live: dict[str, Any]) -> None:
        phase = phase_of(job, live)
        if phase == self._said:
            return
        self._said = phase
        line = f"{live.get('elapsed_s', 0.0):6.2f} s  {phase:<9} {newest(live)}"
        self._console.print(line.rstrip(), soft_wrap=True, markup=False)

    def ask(self, name: str, instruction: str) -> bool:
        """Say what is waited for, and how to go on."""
        self._console.print(_order(name, instruction), soft_wrap=True, markup=False)
        return False


def _what(instruction: str) -> str:
    """What a person is to do, without how to say so over REST."""
    return instruction.removesuffix(", then POST the action continue")


def _order(name: str, instruction: str) -> str:
    return f"{_what(instruction)}, then `pincette job continue {name}`"


def phase_of(job: dict[str, Any], live: dict[str, Any]) -> str:
    """The phase of a job that runs, else its state."""
    state: str = job["state"]
    return (live.get("phase") or state) if state == "running" else state


def newest(live: dict[str, Any]) -> str:
    """Newest position and force, of constant width."""
    if live.get("x_um") is None:
        return ""
    force_mN = live.get("force_mN")
    force = " " * 9 if force_mN is None else f"{force_mN:6.2f} mN"
    return f"{live['x_um']:6.2f} µm {force}"


def share(elapsed_s: float, planned_s: float | None) -> str:
    """How much of the planned time has passed."""
    return f"{min(1.0, elapsed_s / planned_s):.0%}" if planned_s else ""


def left(elapsed_s: float, planned_s: float | None) -> str:
    """What is left of the planned time."""
    return f"{max(0.0, planned_s - elapsed_s):4.1f} s left" if planned_s else ""
