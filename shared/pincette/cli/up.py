"""Every program of a rig on this machine: `pincette up` and `pincette demo`."""

import argparse
import re
import signal
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import sleep
from types import FrameType

from rich.console import Console
from rich.text import Text

from pincette.cli import options, security_made
from pincette.cli.exit_status import of_job
from pincette.cli.follow import follow
from pincette.cli.options import Words, does, machine, rigged
from pincette.cli.output import emit, screen
from pincette.cli.rest import CliError, key_of
from pincette.cli.rig_file import PKI, opened
from pincette.cli.show import show_result
from pincette.client import Supervisor
from pincette.config import RigFile
from pincette.runtime.fleet import Fleet, FleetError, Member
from pincette.runtime.logs import Form

UP = "start every program of a rig on this machine; Ctrl-C ends them"
SERVER = "the programs of a laboratory server, which [bus] upstream names; none of the loop"
DEMO = "start a rig, grip its part, show the result, end"
WATCH_S = 0.3
LOG_STAMP = re.compile(r"^\d{4}-\d\d-\d\d [\d:,]+ \w+ ", re.MULTILINE)
"""What a program's log says of time and place, which one person at one screen knows."""
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def add(word: Words) -> None:
    """Add ``up`` and ``demo``."""
    one = rigged(word("up", UP), data=True)
    one.add_argument(
        "--secure",
        action="store_true",
        help=f"over mutual TLS, with certificates in the folder {security_made.PLACE} of --data",
    )
    one.add_argument("--server", action="store_true", help=SERVER)
    options.log_format(one)
    does(one, _up)
    one = machine(rigged(word("demo", DEMO), data=True))
    one.add_argument(
        "--secure", action="store_true", help="over mutual TLS, with certificates for this once"
    )
    does(
        one,
        lambda given: demo(given.rig, given.data, machine=given.json, secure=given.secure),
    )


def _up(given: argparse.Namespace) -> int:
    return up(
        given.rig,
        given.data,
        secure=given.secure,
        server=given.server,
        log_format=given.log_format,
    )


def _end(_number: int, _frame: FrameType | None) -> None:
    """Leave, once; what is ending already is not disturbed again."""
    for number in ENDINGS:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


@contextmanager
def running(
    rig: RigFile,
    rig_path: Path,
    data: Path,
    console: Console,
    *,
    server: bool = False,
    log_format: Form | None = None,
) -> Generator[Fleet]:
    """A rig that is up, and that is down again afterwards whatever happened."""

    def say(name: str, line: str) -> None:
        _say(console, fleet.members[name], "green", line.replace("socket://", ""))

    try:
        fleet = Fleet(rig, rig_path, data, say, server=server, log_format=log_format)
    except OSError as error:
        raise CliError(
            f"folder {data} cannot be made or written ({error.strerror}): name another with --data"
        ) from error
    before = {number: signal.signal(number, _end) for number in ENDINGS}
    try:
        fleet.up()
        yield fleet
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


def up(
    rig_path: Path,
    data: Path,
    *,
    secure: bool = False,
    server: bool = False,
    log_format: Form | None = None,
) -> int:
    """Start all programs, a line each; report what ends; end all on Ctrl-C."""
    console = Console(highlight=False)
    rig = opened(rig_path)
    if server and rig.bus.upstream is None:
        raise CliError(f"rig {rig.rig.name!r} has no [bus] upstream: HOST:PORT of this server")
    if secure:
        pki = security_made.standing(rig, data)
        rig = rig.secured(pki)
        console.print(f"certificates in {pki}; for tools: {PKI}={pki.resolve()}", soft_wrap=True)
    try:
        with running(rig, rig_path, data, console, server=server, log_format=log_format) as fleet:
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


def demo(rig_path: Path, data: Path, *, machine: bool = False, secure: bool = False) -> int:
    """Grip the part of a rig once, from start to end."""
    console = screen(machine=machine)
    rig = opened(rig_path)
    with ExitStack() as stack:
        if secure:
            rig = rig.secured(stack.enter_context(security_made.passing(rig)))
        stack.enter_context(running(rig, rig_path, data, console))
        supervisor = stack.enter_context(Supervisor(_address(rig), key=key_of(None)))
        job = follow(supervisor.rig(rig.rig.name).start("grip"), console)
    if machine:
        emit(job)
    else:
        show_result(job.model_dump(mode="json"), console)
    return of_job(job)
