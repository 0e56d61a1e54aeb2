"""``pincette up``: runs the programs of a rig on this machine."""

import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from types import FrameType
from typing import TYPE_CHECKING, Annotated

from typer import Option

from pincette.cli import PKI, CliError, opened
from pincette.cli.options import DATA, DataFolder
from pincette.cli.terminal import RigOption, command, group, lasting_screen
from pincette.engine import logs

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from pincette.config import RigFile
    from pincette.engine.fleet import Child, Fleet
    from pincette.engine.logs import Form


LogFormat = Annotated[
    logs.Form | None,
    Option(
        "--log-format",
        metavar="|".join(logs.FORMS),
        help=(
            f"text, or json with one object per line; the value of {logs.VARIABLE} if not "
            "given, else text"
        ),
    ),
]
NewArm = Annotated[
    bool,
    Option("--new-arm", help="simulate a new arm instead of that of the last run"),
]
WATCH_S = 0.3
FIRST_NEWS_S, NEWS_S = 10.0, 5.0
"""Time in s until the first line about a restarted program that is not yet ready, and between
further lines.
"""
MEASURE_S = "3"
"""Duration of a measurement in s. Together with the start of the measuring programs it takes 5
s.
"""
ENDINGS = (signal.SIGINT, signal.SIGTERM)
IGNORED = (signal.SIGHUP, signal.SIGTTOU)
"""Signals that are ignored: loss of the terminal, and output while in the background. Ending the
rig for them would release a held part.
"""


app = group()


def _end(_number: int, _frame: FrameType | None) -> None:
    """Raise the exception that ends the command, but only once, so that it does not interrupt the
    shutdown.
    """
    for number in ENDINGS:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


@contextmanager
def running(
    rig: "RigFile",
    rig_path: Path,
    data: Path,
    console: "Console",
    *,
    server: bool = False,
    log_format: "Form | None" = None,
) -> "Generator[Fleet]":
    """Keep a rig running within the block, and shut it down afterwards in any case."""
    from pincette.engine.fleet import Fleet, FleetError
    from pincette.engine.realtime.gc_tuning import return_free_memory

    def say(name: str, line: str) -> None:
        _print_status(console, fleet.members[name], "green", line.replace("socket://", ""))

    try:
        fleet = Fleet(rig, rig_path, data, say, server=server, log_format=log_format)
    except OSError as error:
        raise CliError(
            f"folder {data} cannot be made or written ({error.strerror}): name another with --data"
        ) from error
    before = {number: signal.signal(number, _end) for number in ENDINGS}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in IGNORED}
    try:
        fleet.up()
        return_free_memory()
        yield fleet
    except FleetError as error:
        raise CliError(str(error)) from error
    finally:
        for number in ENDINGS:
            signal.signal(number, signal.SIG_IGN)
        fleet.down()
        for number, handler in before.items():
            signal.signal(number, handler)


def _print_status(console: "Console", member: "Child", colour: str, line: str) -> None:
    """Print a status line; in a terminal it replaces the previous one."""
    from rich.text import Text

    text = Text.assemble(
        ("● ", colour), f"{member.name:<10} ", (f"{member.process.pid:>7} ", "dim"), line
    )
    if console.is_terminal:
        text.truncate(console.width, overflow="ellipsis")
    _print(console, text)


def _print(console: "Console", text: "str | Text") -> None:
    """Print a line without markup, since names and paths may contain brackets."""
    console.print(text, markup=False)


def forget_arm(rig: "RigFile", data: Path) -> None:
    """Delete the saved state of the simulated arm, so that the next start begins with a new arm."""
    try:
        rig.simulated_arm(data).unlink(missing_ok=True)
    except OSError as error:
        raise CliError(f"--new-arm: {error}") from error


@command(app, "up")
def up(
    rig: RigOption,
    data: DataFolder = DATA,
    secure: Annotated[
        bool,
        Option(
            "--secure",
            help="over mutual TLS, with certificates in the folder pki of --data",
        ),
    ] = False,
    server: Annotated[
        bool,
        Option(
            "--server",
            help=(
                "start only the programs of a laboratory server, the one that [bus] upstream names"
            ),
        ),
    ] = False,
    log_format: LogFormat = None,
    new_arm: NewArm = False,
    measure: Annotated[
        bool,
        Option("--measure", help="measure the timing of this machine first, in 5 s; see `latency`"),
    ] = False,
) -> None:
    """Start all programs, with one line for each; report programs that end; end all on Ctrl-C."""
    path = rig.path
    file = opened(path)
    if new_arm:
        forget_arm(file, data)
    if server and file.bus.upstream is None:
        raise CliError(f"rig {file.rig.name!r} has no [bus] upstream: HOST:PORT of this server")
    with lasting_screen() as console:
        if secure:
            from pincette.cli import security

            pki = security.made_certificates(file, data)
            file = file.secured(pki)
            _print(console, f"certificates in {pki}; for tools: {PKI}={pki.resolve()}")
        if measure:
            # A separate process, since this program would keep the modules that it loads.
            grid = ["--seconds", MEASURE_S, "--period-s", f"{file.rig.period_s:g}"]
            task = ["latency", *grid, "--rig", str(path), "--data", str(data)]
            subprocess.run([sys.executable, "-m", "pincette", *task], check=False)
        if not file.lockstep and not server:
            for line in machine_words(file, data):
                _print(console, line)
        try:
            with running(file, path, data, console, server=server, log_format=log_format) as fleet:
                _watch(file, fleet, console)
        except KeyboardInterrupt:
            _print(console, "every program has ended")


def _watch(rig: "RigFile", fleet: "Fleet", console: "Console") -> None:
    """Restart programs and rotate log files until a signal ends the rig.

    An error during this is printed and does not end the rig, since that would release a held part.
    """
    from rich.text import Text

    from pincette.engine.revival import Revival

    served = ", served" if rig.joins else ""
    name = Text(rig.rig.name, "bold")
    _print(
        console,
        Text.assemble("rig ", name, f" is up{served} at {rig.supervisor.url}; Ctrl-C ends it"),
    )
    revival = Revival(fleet)
    restarts = Restarts(fleet)
    trouble = ""
    while True:
        sleep(WATCH_S)
        try:
            fleet.bound_logs()
            revival.look(lambda member, line: _print_status(console, member, "red", line))
            restarts.show(lambda member, tone, line: _print_status(console, member, tone, line))
        except Exception as error:  # noqa: BLE001  an error of any kind ends no rig
            text = f"{type(error).__name__}: {error}"
            if text != trouble:
                _print(console, f"pincette up: {text}; the rig stays up")
            trouble = text
        else:
            trouble = ""


class Restarts:
    """Restarted programs of a rig: prints lines of their logs until it reports that they are
    ready.
    """

    def __init__(self, fleet: "Fleet", clock: Callable[[], float] = monotonic) -> None:
        self._fleet, self._clock = fleet, clock
        self._serving = {name: one.process.pid for name, one in fleet.members.items()}
        """Process id of each program that has been reported as ready."""
        self._next_s: dict[int, float] = {}
        """Earliest time of the next line about each process that is not ready yet, in s."""
        self._shown: dict[int, str] = {}
        """Last printed log line of each of these processes."""

    def show(self, say: Callable[["Child", str, str], None]) -> None:
        """Call ``say`` with program, colour and line for every change."""
        now_s = self._clock()
        for name, member in self._fleet.members.items():
            pid = member.process.pid
            if pid == self._serving[name] or member.process.poll() is not None:
                continue
            if member.ready.is_set():
                self._serving[name] = pid
                say(member, "green", member.line)
            elif now_s >= self._next_s.setdefault(pid, now_s + FIRST_NEWS_S):
                last = member.tail().splitlines()[-1].strip()
                if last != self._shown.get(pid):
                    self._next_s[pid], self._shown[pid] = now_s + NEWS_S, last
                    say(member, "yellow", f"does not serve yet; its log: {last}")


def machine_words(rig: "RigFile", data: Path) -> list[str]:
    """Return what this machine supports and what to change, or how to measure it."""
    from pincette.engine.measuring.kept import changes_of, how, kept, words

    known = kept(data)
    if known is None:
        return ["the timing of this machine is not known:", f"  {how(rig)}"]
    return [words(rig, known), *(f"suits it: {one.words()}" for one in changes_of(rig, known))]
