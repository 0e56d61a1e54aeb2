"""A job followed to its end: a bar in a terminal, a line for each phase elsewhere."""

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
    """Show a job's progress until it has ended, and return it as it is then."""
    if not console.is_terminal:
        return _in_lines(supervisor, name, console)
    with Progress(*COLUMNS, console=console) as progress:
        bar = progress.add_task("queued", total=None, share="", now="", left="")
        while True:
            job = _poll(supervisor, name)
            live: dict[str, Any] = job.get("progress") or {}
            over = job["state"] in TERMINAL
            elapsed_s, planned_s = live.get("elapsed_s", 0.0), live.get("planned_s")
            if over:
                # Where contact comes sooner than planned, the course is shorter.
                planned_s = elapsed_s
            progress.update(
                bar,
                description=job["state"] if over else phase_of(job),
                total=planned_s,
                completed=elapsed_s,
                share=share(elapsed_s, planned_s),
                now=newest(live),
                left="" if over else left(elapsed_s, planned_s),
            )
            if over:
                return job


def _in_lines(supervisor: Supervisor, name: str, console: Console) -> dict[str, Any]:
    said = ""
    while True:
        job = _poll(supervisor, name)
        live: dict[str, Any] = job.get("progress") or {}
        phase = phase_of(job)
        if phase != said:
            line = f"{live.get('elapsed_s', 0.0):6.2f} s  {phase:<9} {newest(live)}"
            console.print(line.rstrip(), soft_wrap=True, markup=False)
            said = phase
        if job["state"] in TERMINAL:
            return job


def _poll(supervisor: Supervisor, name: str) -> dict[str, Any]:
    job: dict[str, Any] = supervisor.get(f"/jobs/{name}", wait="terminal", timeout_s=POLL_S)
    return job


def phase_of(job: dict[str, Any]) -> str:
    """The phase of a job that runs, else its state."""
    live: dict[str, Any] = job.get("progress") or {}
    return live.get("phase") or job["state"] if job["state"] == "running" else job["state"]


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
