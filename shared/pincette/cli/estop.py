"""``pincette estop``: stops rigs over REST and directly at their actuators, simultaneously.

The command starts without Typer and without the models of a rig file, whose import would take
longer than the stop. Everything that the stop does not need is optional: the rig file, the key, the
certificates, a home folder, an output stream. The command reports what it cannot use, and stops the
rigs by the remaining routes.
"""

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from threading import Event, Thread
from time import CLOCK_BOOTTIME, clock_gettime, monotonic
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

from pincette.bus.stopping import REPLY_S, ROUTED, StopAttempts, joined, trip_at, trip_each
from pincette.cli import PKI, RIG_VARIABLE, CliError, Exit, chosen
from pincette.cli.credentials import (
    AUTHORITY,
    AUTHORITY_HELP,
    DEFAULT_URL,
    KEY_HELP,
    authority_of,
    find_key,
    operator,
)
from pincette.cli.plain import Option, parser_of, read_options
from pincette.core.rest_stop import RestStop, RestStopError, is_same_place, stop_over_rest
from pincette.core.streams import drop, prepare_streams

if TYPE_CHECKING:
    from pincette.config import RigFile
    from pincette.config.stop_file import StopFile

REST_S, LIMIT_S = 2.0, 3.0
"""Time limits, in s, for a reply over REST, and for all routes together."""
FOUND_S = 0.5
"""Time limit for reading a key or a rig file, in s; either may be on a network share that hangs."""
HEAD_START_S = 0.1
"""Time by which the direct route to an actuator starts before the route through the router, in
s.
"""
MARGIN_S, LOOK_S = 0.3, 0.02
"""Time before ``LIMIT_S`` at which a confirmation over plain HTTP is judged even if the actuator
has not confirmed, and the interval of the checks for the actuator's confirmation, in s.
"""
ENDED_S = 4.0
"""Time limit for routes that have not ended after ``LIMIT_S``, for example on a heavily loaded
machine; and for threads that are inside the bus after the result was printed; in s.
"""
POWER = "switch off the amplifier's power, unless you know that the rig is not running"
URL = "PINCETTE_URL"
ACTUATOR = "actuator"
SUPERVISOR, STRAIGHT = "through the supervisor", "at the actuator"
T = TypeVar("T")

ABOUT = "stop every rig at once, or one: over REST and directly at the actuators"
OPTIONS = (
    Option("--rig", "FILE", "rig file"),
    Option("--json", "", "answer in JSON on standard output"),
    Option(
        "--url",
        "URL",
        f"of the supervisor; if not given, ${URL} unless --rig is given, else as the rig file says",
    ),
    Option("--key", "KEY", KEY_HELP),
    Option("--authority", "FILE", AUTHORITY_HELP),
    Option("--rig-name", "RIG", "the only rig to stop; every one if not given"),
)


def main(arguments: Sequence[str]) -> int:
    """Trip the actuators over REST and directly at the same time; return the exit status.

    Status 0: all rigs have confirmed. Status 1: some have. Status 3: none has.
    """
    prepare_streams()
    given = read_options(parser_of("estop", ABOUT, OPTIONS), OPTIONS, arguments)
    rig = Path(given.rig) if given.rig else None
    authority = given.authority or os.environ.get(AUTHORITY)
    stop = EmergencyStop(given.rig_name)
    stop.url_given = bool(given.url)
    stop.file_given = rig is not None or bool(os.environ.get(RIG_VARIABLE))
    stop.start_over_rest(
        given.url or (None if rig else os.environ.get(URL)),
        given.key,
        Path(authority) if authority else None,
    )
    stop.start_past_supervisor(lambda: chosen(rig))
    try:
        stop.attempts.wait(LIMIT_S, stop.is_complete)
        stop.wait_for_late_confirmations()
        return stop.report(as_json=given.json)
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    finally:
        stop.attempts.join(ENDED_S)


class EmergencyStop:
    """Emergency stop: the known rigs, and those that have confirmed."""

    def __init__(self, only: str | None) -> None:
        """Prepare an emergency stop; ``only`` is the name of the only rig to stop, or None for
        all.
        """
        self.only = only
        self.attempts = StopAttempts()
        self.file: RigFile | StopFile | None = None
        self.file_given = self.url_given = False
        """True if the caller has named a rig file, and an address, respectively."""
        self.notes: list[str] = []
        """Inputs that could not be used, each with the reason."""
        self.found: set[str] = set()
        """Names of rigs that the supervisor serves, or that have an actuator on the router."""
        self.absent: set[str] = set()
        """Names of rigs with a liveliness token on the router but no actuator; see
        ``AbsentError``.
        """
        self.answered = False
        """True once the supervisor has stopped all rigs that it serves."""
        self.is_unreachable = False
        """True if no program listens at the actuator's port."""
        self._limit_s = LIMIT_S
        """Time limit for the routes, in s."""
        self._until_s = monotonic() + LIMIT_S
        self._file_read, self._direct_ended, self._routed_ended = Event(), Event(), Event()

    def is_complete(self) -> bool:
        """Return whether nothing is left to wait for."""
        confirmed = self.attempts.confirmed
        if self.only is not None:
            return self.only in confirmed
        own = self._file_read.is_set() and (self.file is None or self.file.rig.name in confirmed)
        return self.answered and own and not self.missing()

    def missing(self) -> list[str]:
        """Return the unconfirmed targets: names of rigs, or a description if a name is not
        known.
        """
        confirmed = self.attempts.confirmed
        if self.only is not None:
            return [] if self.only in confirmed else [self.only]
        wanted, unknown = set(self.found), list[str]()
        if self.file is not None and (self.file_given or not self.answered):
            wanted.add(self.file.rig.name)
        if not self.answered and (self.file is None or (self.url_given and not self.file_given)):
            unknown.append("every rig of that supervisor")
        if self.file is None and self.file_given and not self.url_given:
            unknown.append("the rig of the rig file")
        return [*sorted(wanted - confirmed.keys() - self.absent), *unknown]

    # Over REST.

    def start_over_rest(self, url: str | None, key: str | None, authority: Path | None) -> None:
        """Send the stop to the supervisor: at the given address, else the rig file's, else the
        default.
        """

        def attempt() -> None:
            address = url or self._file_url()
            headers = {"X-Operator": quote(operator() or "", safe=" ")} if operator() else {}
            known = within(FOUND_S, lambda: find_key(key), None, self.notes)
            if known is not None and known.isascii() and known.isprintable() and " " not in known:
                headers["Authorization"] = f"Bearer {known}"
            elif known is not None:
                self.notes.append("the key cannot be sent: it is omitted, since a stop needs none")
            self._over_rest(address, headers, authority)

        self.attempts.start(SUPERVISOR, attempt)

    def _file_url(self) -> str:
        self._file_read.wait(FOUND_S + REST_S)
        return DEFAULT_URL if self.file is None else self.file.supervisor.url

    def _over_rest(self, url: str, headers: Mapping[str, str], authority: Path | None) -> None:
        pki = os.environ.get(PKI)
        if authority is None and not pki and url.lower().startswith("https:"):
            self._file_read.wait(FOUND_S)
            pki = None if self.file is None else self.file.bus.pki
        reply = stop_over_rest(url, self.only, headers, authority_of(authority, pki), REST_S)
        self.notes += reply.notes
        self.found |= {*reply.stopped, *reply.unconfirmed}
        doubts = [f"{rig} not confirmed" for rig in reply.unconfirmed]
        self._file_read.wait(FOUND_S)
        own = None if self.file is None else self.file.rig.name
        for rig in sorted(reply.stopped, key=lambda rig: rig == own):  # own rig last: it may wait
            if doubt := "" if reply.proven else self._doubt(rig, url, reply):
                doubts.append(doubt)
            else:
                self.attempts.confirm(rig, SUPERVISOR)
        if doubts:
            raise RestStopError(f"{url}: {'; '.join(doubts)}")
        self.answered = True

    def _doubt(self, rig: str, url: str, reply: RestStop) -> str:
        """Return why a confirmation over plain HTTP is not trusted; empty if it counts.

        Another program may use the supervisor's port. For the rig of the rig file, the function
        therefore also waits for the confirmation of the actuator itself. A confirmation that
        nothing contradicts is accepted, with a note.
        """
        file = self.file
        if file is not None and rig == file.rig.name and is_same_place(url, file.supervisor.url):
            while rig not in self.attempts.confirmed and monotonic() < self._until_s - MARGIN_S:
                if self._direct_ended.is_set() and self._routed_ended.wait(LOOK_S):
                    break
                self._direct_ended.wait(LOOK_S)
            if self.is_unreachable and rig not in self.attempts.confirmed:
                return (
                    f"rig {rig} is reported as stopped, but no program listens at its "
                    "actuator's port: another program may have taken the supervisor's port"
                )
        if rig in self.attempts.confirmed:
            return ""
        if reply.foreign_account:
            return (
                f"rig {rig} is reported as stopped, but by a program of the account "
                f"{reply.foreign_account}: plain HTTP does not prove that it is the "
                "supervisor"
            )
        self.notes.append(
            f"rig {rig}: confirmed over plain HTTP only, which does not prove who answers; "
            "[supervisor] tls does"
        )
        return ""

    # Without the supervisor.

    def start_past_supervisor(self, path: Callable[[], Path]) -> None:
        """Start the stop at the actuators of a rig file, and of the rigs on its router."""

        def attempt() -> None:
            try:
                file = self.file = self._read(path)
            except BaseException:
                self._direct_ended.set()
                self._routed_ended.set()
                raise
            finally:
                self._file_read.set()
            self._start(file)

        self.attempts.start("rig file", attempt)

    def _read(self, path: Callable[[], Path]) -> "StopFile":
        from pincette.config.stop_file import read_for_stop

        file = read_for_stop(path())
        self.notes += file.notes
        pki = os.environ.get(PKI)
        return file.secured(Path(pki)) if pki else file

    def past_supervisor(self, file: "RigFile") -> "EmergencyStop":
        """Stop only at the actuators, without the supervisor, and wait for the result."""
        self.file, self.file_given = file, True
        self._file_read.set()
        self._start(file)
        self.attempts.wait(LIMIT_S, lambda: self.only is not None and self.is_complete())
        self.attempts.join(ENDED_S)
        return self

    def _start(self, file: "RigFile | StopFile") -> None:
        """Start the attempts that need the rig file."""
        from pincette.bus.endpoints import direct_endpoint, tool_endpoint
        from pincette.bus.protocol import BusError

        own = file.rig.name
        if self.only in (None, own):

            def direct() -> None:
                try:
                    self._trip(own, STRAIGHT, lambda: direct_endpoint(file, ACTUATOR))
                except BusError as error:
                    self.is_unreachable = isinstance(error.__cause__, ConnectionRefusedError)
                    raise
                finally:
                    self._direct_ended.set()

            self.attempts.start(STRAIGHT, direct)
        else:
            self._direct_ended.set()

        def routed() -> None:
            self._direct_ended.wait(HEAD_START_S)
            try:
                self._trip(self.only or own, ROUTED, lambda: tool_endpoint(file))
            finally:
                self._routed_ended.set()

        self.attempts.start(ROUTED, routed)
        if self.only is None:
            self.attempts.start("on the router", lambda: self._stop_others(file))

    def _trip(self, rig: str, way: str, ends: Callable[[], Any]) -> None:
        from pincette.core.faults import Cause
        from pincette.core.messages import Trip

        if rig not in self.attempts.confirmed:
            trip_at(ends(), rig, Trip(Cause.ESTOP))
            self.attempts.confirm(rig, way)

    def _stop_others(self, file: "RigFile | StopFile") -> None:
        """Stop all other rigs on the router whose actuator is reachable.

        One session serves all of them: since any tool can declare tokens for many rigs, separate
        sessions could be too many.
        """
        from pincette.bus.endpoints import tool_endpoint
        from pincette.bus.protocol import AbsentError, BusError
        from pincette.core.faults import Cause
        from pincette.core.messages import Trip
        from pincette.core.topics import TRIP

        with joined(tool_endpoint(file), file.rig.name) as bus:
            others = {rig for rig, program in bus.alive_everywhere() if program == ACTUATOR}
            others.discard(file.rig.name)
            self.found |= others

            def trip(rig: str) -> None:
                try:
                    bus.call(TRIP, Trip(Cause.ESTOP), REPLY_S, rig=rig)
                except AbsentError:
                    self.absent.add(rig)
                    raise
                self.attempts.confirm(rig, ROUTED)

            missed = trip_each(others - self.attempts.confirmed.keys(), trip)
        if reasons := [why for rig, why in missed.items() if rig not in self.absent]:
            raise BusError("; ".join(reasons))

    # The result.

    def wait_for_late_confirmations(self) -> None:
        """Report immediately which rigs have not confirmed, and wait for the routes that are still
        running.
        """

        def is_confirmed() -> bool:
            return bool(self.attempts.confirmed) and not self.missing()

        if is_confirmed() or not self.attempts.running:
            return
        who = ", ".join(self.missing()) or "any rig"
        text = f"pincette: not confirmed within {LIMIT_S:g} s: {who}: {POWER}; still trying\n"
        written(sys.stderr, lambda: sys.stderr.write(text))
        self._limit_s += ENDED_S
        self.attempts.wait(ENDED_S, is_confirmed)

    def report(self, *, as_json: bool) -> int:
        """Print the result, if output is possible, and return the exit status."""
        ways, missing = dict(self.attempts.confirmed), self.missing()
        elapsed_ms = 1e3 * since_start_s()
        failed = [f"{way}: {error}" for way, error in self.attempts.failed]
        failed += [f"{way}: no reply within {self._limit_s:g} s" for way in self.attempts.running]
        status = Exit.DONE if not missing and ways else Exit.FAILED if ways else Exit.NO_ANSWER
        if as_json:
            answer = {
                "stopped": ways,
                "unconfirmed": missing,
                "elapsed_ms": round(elapsed_ms, 1),
                "failed": failed,
                "notes": self.notes,
            }
            written(sys.stdout, lambda: print(json.dumps(answer, ensure_ascii=False)))
        else:
            lines = [f"rig {rig}: stopped {way}" for rig, way in sorted(ways.items())]
            if status == Exit.DONE:
                every = "every rig is" if self.only is None else f"rig {self.only} is"
                done = f"{every} stopped, {elapsed_ms:.0f} ms after the start of this command"
                lines.append(f"{done}; `pincette reset` clears the latch")
            written(sys.stdout, lambda: print("\n".join(lines)) if lines else None)
        if status != Exit.DONE:
            words = [
                f"not stopped from here: {', '.join(missing) or 'any rig'}: {POWER}"
                + (f"; stopped: {', '.join(ways)}" if ways else ""),
                *(f"  {one}" for one in (*failed, *self.notes)),
            ]
            text = "pincette: " + "\n".join(words)
        else:
            text = "\n".join(f"pincette: {one}" for one in self.notes)
        written(sys.stderr, lambda: sys.stderr.write(f"{text}\n") if text else None)
        return status


def within(limit_s: float, read: Callable[[], T], otherwise: T, notes: list[str]) -> T:
    """Return the result of ``read``, or another value if it fails or takes too long."""
    found = [otherwise]

    def run() -> None:
        try:
            found[0] = read()
        except (CliError, OSError, ValueError) as error:
            notes.append(f"{error}: it is omitted, since a stop needs none")

    thread = Thread(target=run, daemon=True)
    thread.start()
    thread.join(limit_s)
    return found[0]


def written(stream: Any, write: Callable[[], object]) -> None:
    """Write to a stream, and ignore errors."""
    try:
        write()
        stream.flush()
    except (OSError, ValueError):
        drop(stream)


def since_start_s() -> float:
    """Return the time since this process was started, in s."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return clock_gettime(CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")
