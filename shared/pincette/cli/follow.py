"""A job followed to its end: a bar in a terminal, a line for each phase elsewhere."""

import sys
from contextlib import AbstractContextManager

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from pincette.api.job_models import Job, Progress
from pincette.api.states import STATES
from pincette.client import JobHandle

POLL_S = 0.2
BAR_WIDTH = 24
COLUMNS = (
    TextColumn("{task.description:<9}"),
    BarColumn(BAR_WIDTH),
    TextColumn("{task.fields[share]:>4}"),
    TextColumn("{task.fields[now]}"),
    TextColumn("{task.fields[left]}"),
)


def follow(job: JobHandle, console: Console) -> Job:
    """Show a job's progress until it has ended, and return it as it is then.

    Where it waits for a person, a terminal asks for the return key and then goes on.
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
    """One line that is drawn anew."""

    def __init__(self, console: Console) -> None:
        self._progress = Bar(*COLUMNS, console=console)
        self._bar = self._progress.add_task("queued", total=None, share="", now="", left="")

    def __enter__(self) -> None:
        self._progress.start()

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, job: Job, live: Progress | None) -> None:
        elapsed_s = 0.0 if live is None else live.elapsed_s
        planned_s = None if live is None else live.planned_s
        if job.state == "succeeded":
            # Where contact comes sooner than planned, the course is shorter.
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

    def show(self, job: Job, live: Progress | None) -> None:
        phase = phase_of(job, live)
        if phase == self._said:
            return
        self._said = phase
        elapsed_s = 0.0 if live is None else live.elapsed_s
        line = f"{elapsed_s:6.2f} s  {phase:<9} {newest(live)}"
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


def phase_of(job: Job, live: Progress | None) -> str:
    """The phase of a job that runs, else its state."""
    if job.state != "running" or live is None:
        return job.state
    return live.phase or job.state


def newest(live: Progress | None) -> str:
    """Newest position and force, of constant width."""
    if live is None or live.x_um is None:
        return ""
    force = " " * 9 if live.force_mN is None else f"{live.force_mN:6.2f} mN"
    return f"{live.x_um:6.2f} µm {force}"


def share(elapsed_s: float, planned_s: float | None) -> str:
    """How much of the planned time has passed."""
    return f"{min(1.0, elapsed_s / planned_s):.0%}" if planned_s else ""


def left(elapsed_s: float, planned_s: float | None) -> str:
    """What is left of the planned time."""
    return f"{max(0.0, planned_s - elapsed_s):4.1f} s left" if planned_s else ""
