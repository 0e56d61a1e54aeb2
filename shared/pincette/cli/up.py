"""Every program of a rig on this machine: `pincette up` and `pincette demo`."""

import re
import signal
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import sleep
from types import FrameType

from rich.console import Console
from rich.text import Text

from pincette.cli.exit_status import of_job
from pincette.cli.follow import follow
from pincette.cli.options import Words, does, machine, rigged
from pincette.cli.output import emit, screen
from pincette.cli.rest import CliError
from pincette.cli.rig_file import opened
from pincette.cli.show import show_result
from pincette.client import Supervisor
from pincette.config import RigFile
from pincette.runtime.fleet import Fleet, FleetError, Member

UP = "start every program of a rig on this machine; Ctrl-C ends them"
DEMO = "start a rig, grip its part, show the result, end"
WATCH_S = 0.3
LOG_STAMP = re.compile(r"^\d{4}-\d\d-\d\d [\d:,]+ \w+ ", re.MULTILINE)
"""What a program's log says of time and place, which one person at one screen knows."""
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def add(word: Words) -> None:
    """Add ``up`` and ``demo``."""
    does(rigged(word("up", UP), data=True), lambda given: up(given.rig, given.data))
    does(
        machine(rigged(word("demo", DEMO), data=True)),
        lambda given: demo(given.rig, given.data, machine=given.json),
    )


def _end(_number: int, _frame: FrameType | None) -> None:
    """Leave, once; what is ending already is not disturbed again."""
    for number in ENDINGS:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


@contextmanager
def running(rig_path: Path, data: Path, console: Console) -> Generator[tuple[RigFile, Fleet]]:
    """A rig that is up, and that is down again afterwards whatever happened."""
    rig = opened(rig_path)

    def say(name: str, line: str) -> None:
        _say(console, fleet.members[name], "green", line.replace("socket://", ""))

    try:
        fleet = Fleet(rig, rig_path, data, say)
    except OSError as error:
        raise CliError(
            f"folder {data} cannot be made or written ({error.strerror}): name another with --data"
        ) from error
    before = {number: signal.signal(number, _end) for number in ENDINGS}
    try:
        fleet.up()
        yield rig, fleet
    except FleetError as error:
        raise CliError(LOG_STAMP.sub("  ", str(error))) from error
    finally:
        for number in ENDINGS:
            signal.signal(number, signal.SIG_IGN)
        fleet.down()
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(console: Console, member: Member, colour: str, line: str) -> None:
    """One line of status; in a terminal never more than one."""
    text = Text.assemble(
        ("● ", colour), f"{member.name:<10} ", (f"{member.process.pid:>7} ", "dim"), line
    )
    if console.is_terminal:
        text.truncate(console.width, overflow="ellipsis")
    console.print(text, soft_wrap=True)


def up(rig_path: Path, data: Path) -> int:
    """Start all programs, a line each; report what ends; end all on Ctrl-C."""
    console = Console(highlight=False)
    try:
        with running(rig_path, data, console) as (rig, fleet):
            _watch(rig, fleet, console)
    except KeyboardInterrupt:
        console.print("every program has ended")
    return 0


def _watch(rig: RigFile, fleet: Fleet, console: Console) -> None:
    served = ", served" if rig.joins else ""
    console.print(
        f"rig [bold]{rig.rig.name}[/bold] is up{served} at {_address(rig)}; Ctrl-C ends it"
    )
    gone: set[str] = set()
    while True:
        sleep(WATCH_S)
        for member in fleet.ended():
            if member.name not in gone:
                gone.add(member.name)
                status = member.process.returncode
                _say(console, member, "red", f"ended, status {status}; see {member.log}")


def _address(rig: RigFile) -> str:
    return f"http://{rig.supervisor.host}:{rig.supervisor.port}"


def demo(rig_path: Path, data: Path, *, machine: bool = False) -> int:
    """Grip the part of a rig once, from start to end."""
    console = screen(machine=machine)
    with running(rig_path, data, console) as (rig, _fleet), Supervisor(_address(rig)) as supervisor:
        job = follow(supervisor.rig(rig.rig.name).start("grip"), console)
    if machine:
        emit(job)
    else:
        show_result(job.model_dump(mode="json"), console)
    return of_job(job)
