"""Starts several programs on this machine, watches them, and ends them together."""

import errno
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import monotonic
from urllib.parse import urlsplit

from pincette.config import RigFile
from pincette.core.listening import bound
from pincette.core.topics import LOOP
from pincette.engine import log_files, logs
from pincette.engine.process import READY
from pincette.engine.start_progress import StartProgress, demand_s

STOP_S = 5.0
LOOK_S = 1.0
"""Time between two checks of the progress of starting programs, in s."""
ROUTER_S = 2.0
NEEDED_FIRST = ("router", "upstream", "rig")
"""Programs that must run before the others start."""
Say = Callable[[str, str], None]
"""Function that is called with a program's name and one line about it."""
LOG_STAMP = re.compile(r"^\d{4}-\d\d-\d\d [\d:,]+ \w+ ")


class FleetError(Exception):
    """Error if a program could not be started; the text contains its name, the reason and the
    remedy.
    """


@dataclass
class Child:
    """One program of the fleet."""

    name: str
    process: "subprocess.Popen[str]"
    log: Path
    extra: tuple[str, ...] = ()
    """Further command line arguments."""
    ready: threading.Event = field(default_factory=threading.Event)
    line: str = ""

    log_begin: int = 0
    """Length of the log file when the program was started, in bytes."""

    def tail(self) -> str:
        """Return the last lines that the program has logged since its start."""
        with self.log.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(self.log_begin if self.log_begin <= size else 0)
            lines = file.read().decode(errors="replace").splitlines()
        told = "\n".join(LOG_STAMP.sub("  ", line) for line in lines[-12:])
        if told:
            return told
        left = os.statvfs(self.log.parent).f_bavail
        why = "" if left else ", since its disk is full: free space there and start it again"
        return f"  it has logged nothing; its log is {self.log}{why}"

    def logged(self) -> int:
        """Return the length of the log file, in bytes."""
        try:
            return self.log.stat().st_size
        except OSError:
            return 0


def ports(rig: RigFile) -> dict[int, str]:
    """Return the ports that a rig's programs need on the loop's machine, and their purposes."""
    wanted = {rig.bus.port + 1 + index: name for index, name in enumerate(LOOP)}
    if not rig.joins:
        wanted = {rig.bus.port: "router", **wanted}
    if not (rig.joins or rig.bus.served_upstream):
        wanted[rig.supervisor.port] = "supervisor"
    if rig.simulation is not None:
        for arm in rig.arms:
            for name, url in (("position sensor", arm.sensor.url), ("output", arm.output.url)):
                port = urlsplit(url).port if url.startswith("socket://") else None
                if port is not None:
                    wanted[port] = f"simulated {name}"
    return wanted


def check_ports(rig: RigFile) -> None:
    """Raise FleetError if a port is taken, before anything is started."""
    for port, purpose in ports(rig).items():
        host = rig.supervisor.host if purpose == "supervisor" else rig.bus.host
        try:
            bound(host, port).close()
        except OSError as error:
            again = (
                ". Is this rig running already? Then use it: stopping it releases a held part"
                if error.errno == errno.EADDRINUSE
                else ""
            )
            raise FleetError(
                f"rig {rig.rig.name!r}, {purpose}: {error.strerror}{again}. The rig file "
                "names host and port"
            ) from error


def check_router(rig: RigFile) -> None:
    """Raise FleetError if a rig uses another rig's router and that router is not running."""
    if not rig.joins:
        return
    try:
        with socket.create_connection(rig.bus.router_at, ROUTER_S):
            pass
    except OSError as error:
        raise FleetError(
            f"rig {rig.rig.name!r}: no router at {rig.bus.router} ([bus] router): "
            f"{error.strerror or error}. First start the rig that the router belongs to"
        ) from error


class Fleet:
    """The programs of one rig as child processes that end with this one."""

    def __init__(
        self,
        rig: RigFile,
        path: Path,
        data: Path,
        say: Say,
        *,
        server: bool = False,
        log_format: logs.Form | None = None,
    ) -> None:
        """``server`` True: only the programs that run beside an upstream router."""
        self._server = server
        self.members: dict[str, Child] = {}
        self._rig = rig
        self._arguments = ["--rig", str(path), "--data", str(data), "--exit-with-parent"]
        if rig.bus.pki is not None:
            self._arguments += ["--pki", rig.bus.pki]
        if log_format is not None:
            self._arguments += ["--log-format", log_format]
        self._logs = rig.home(data) / "logs"
        log_files.make_folder(self._logs)
        self._say = say

    def names(self) -> list[str]:
        """Return the programs that `pincette up` starts for this rig on this machine."""
        if self._server:
            return [
                "upstream",
                *(("recorder", "supervisor") if self._rig.bus.served_upstream else ()),
            ]
        rig = ["rig"] if self._rig.simulation is not None else []
        if self._rig.bus.served_upstream:
            return ["router", *rig, *self._rig.programs]
        own = [*rig, *self._rig.programs, "recorder"]
        return own if self._rig.joins else ["router", *own, "supervisor"]

    def start(self, names: Iterable[str]) -> None:
        """Start programs at the same time, and wait until all of them are ready."""
        self.start_each(dict.fromkeys(names, ()))

    def start_each(self, programs: Mapping[str, Iterable[str]]) -> None:
        """Start programs, each with additional arguments, and wait until all of them are ready."""
        started = [self._spawn(name, extra) for name, extra in programs.items()]
        progress = {
            one.name: StartProgress(partial(demand_s, one.process.pid), one.logged)
            for one in started
        }
        for member in started:
            looked_s = monotonic()
            while not member.ready.wait(0.05):
                # A program for which others wait may have ended.
                ended = [one for one in started if one.process.poll() is not None]
                if ended:
                    raise FleetError(
                        "\n".join(
                            f"{one.name} did not start ({_status(one.process.returncode)}):\n"
                            f"{one.tail()}"
                            for one in ended
                        )
                    )
                if monotonic() - looked_s < LOOK_S:
                    continue
                looked_s = monotonic()
                # A program may wait for a slow one; therefore the start counts as stalled only if
                # none makes progress.
                still = [one for one in started if not one.ready.is_set()]
                whys = {one.name: progress[one.name].why_given_up() for one in still}
                if all(whys.values()) or any("ready" in why for why in whys.values()):
                    raise FleetError(
                        "\n".join(f"{one.name} {whys[one.name]}:\n{one.tail()}" for one in still)
                    )
                news = progress[member.name].news()
                if news:
                    self._say(member.name, news)
            self._say(member.name, member.line)

    def _spawn(self, name: str, extra: Iterable[str]) -> Child:
        log, extra = self._logs / f"{name}.log", tuple(extra)
        with log_files.open_to_append(log) as stream:
            begin = log.stat().st_size
            process = subprocess.Popen(
                [sys.executable, "-m", "pincette", "run", name, *self._arguments, *extra],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stream,
                encoding="utf-8",
                errors="replace",
                start_new_session=True,
            )
        member = Child(name, process, log, extra, log_begin=begin)
        self.members[name] = member
        threading.Thread(target=_listen, args=(member,), daemon=True).start()
        return member

    def revive(self, name: str) -> Child:
        """Start an ended program again with the same arguments, without waiting.

        Its log continues.
        """
        before = self.members[name]
        for stream in (before.process.stdin, before.process.stdout):
            if stream is not None:
                stream.close()
        return self._spawn(name, before.extra)

    def up(self) -> None:
        """Start all programs, first those that others need."""
        if not self._server:
            check_ports(self._rig)
            check_router(self._rig)
        names = self.names()
        first = [name for name in names if name in NEEDED_FIRST]
        self.start(first)
        self.start([name for name in names if name not in first])

    def bound_logs(self) -> None:
        """Rotate the log files that are full."""
        for member in self.members.values():
            log_files.rotate_if_full(member.log)

    def ended(self) -> list[Child]:
        """Return the programs that have ended on their own."""
        return [member for member in self.members.values() if member.process.poll() is not None]

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to one program."""
        os.kill(self.members[name].process.pid, number)

    def down(self) -> None:
        """End every program: the supervisor, then the loop, the recorder, and the others."""
        first = ["supervisor"], list(self._rig.programs), ["recorder"]
        others = [name for name in self.members if not any(name in stage for stage in first)]
        for stage in (*first, others):
            _end([self.members[name] for name in stage if name in self.members])


def _status(number: int) -> str:
    """Return, as text, how a process has ended."""
    if number < 0:
        return f"ended by {signal.Signals(-number).name}"
    return f"exit status {number}"


def _end(members: list[Child]) -> None:
    for member in members:
        if member.process.poll() is None:
            member.process.send_signal(signal.SIGCONT)
            member.process.terminate()
    deadline = monotonic() + STOP_S
    for member in members:
        try:
            member.process.wait(max(0.1, deadline - monotonic()))
        except subprocess.TimeoutExpired:
            member.process.kill()
            member.process.wait()
        for stream in (member.process.stdin, member.process.stdout):
            if stream is not None:
                stream.close()


def _listen(member: Child) -> None:
    stream = member.process.stdout
    if stream is None:
        return
    try:
        for line in stream:
            if line.startswith(READY):
                member.line = line.removeprefix(READY).strip()
                member.ready.set()
    except ValueError:
        return
