"""Every program of a rig on this machine: `pincette up` and `pincette demo`."""

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console

from pincette.cli.job import follow, show_result
from pincette.cli.rest import CliError, Supervisor
from pincette.config import ConfigError, RigFile, read_rig
from pincette.runtime.fleet import Fleet, FleetError

WATCH_S = 0.3


def _stop_event() -> threading.Event:
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: stop.set())
    return stop


@contextmanager
def running(rig_path: Path, data: Path, console: Console) -> Generator[tuple[RigFile, Fleet]]:
    """A rig that is up, and that is down again afterwards whatever happened."""
    try:
        rig = read_rig(rig_path)
    except ConfigError as error:
        raise CliError(str(error)) from error

    def say(name: str, line: str) -> None:
        process = fleet.members[name].process.pid
        console.print(f"[green]●[/green] {name:<11} {line}  [dim]process {process}[/dim]")

    fleet = Fleet(rig, rig_path, data, say)
    try:
        fleet.up()
        yield rig, fleet
    except FleetError as error:
        raise CliError(str(error)) from error
    finally:
        fleet.down()


def up(rig_path: Path, data: Path) -> int:
    """Start all programs, a line each; report what ends; end all on Ctrl-C."""
    console = Console(highlight=False)
    stop = _stop_event()
    with running(rig_path, data, console) as (rig, fleet):
        url = f"http://{rig.supervisor.host}:{rig.supervisor.port}"
        console.print(f"rig [bold]{rig.rig.name}[/bold] is up at {url}; Ctrl-C ends it")
        gone: set[str] = set()
        while not stop.wait(WATCH_S):
            for member in fleet.ended():
                if member.name not in gone:
                    gone.add(member.name)
                    console.print(
                        f"[red]●[/red] {member.name:<11} ended with status "
                        f"{member.process.returncode}; its words are in {member.log}"
                    )
        console.print("ending every program")
    console.print("all programs have ended")
    return 0


def demo(rig_path: Path, data: Path) -> int:
    """Grip the bead of a rig once, from start to end."""
    console = Console(highlight=False)
    with running(rig_path, data, console) as (rig, _fleet):
        supervisor = Supervisor(f"http://{rig.supervisor.host}:{rig.supervisor.port}")
        created = supervisor.post("/jobs", {"kind": "grip", "autostart": True})
        job = follow(supervisor, created["id"], console)
        show_result(job, console)
    succeeded = job["state"] == "succeeded"
    return 0 if succeeded else 1
