"""Stops rigs by several routes at once; the first confirmation of each rig counts.

The command line and the supervisor share this module. It imports only the standard library at
first, so that a stop over REST does not wait for the packages of the bus.
"""

import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable
from contextlib import closing, contextmanager
from dataclasses import replace
from socket import create_connection
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pincette.bus.topology import SessionConfig
    from pincette.bus.zenoh_bus import ZenohBus
    from pincette.core.messages import Message, Trip

ROUTED, DIRECT = "through the router", "at the actuator"
"""Routes to an actuator: through the router, and directly."""
CONNECT_S = 1.0
"""Time limit to connect to a port, and to open a session there, in s."""
REPLY_S = 1.0
"""Time limit for the reply of an actuator, in s."""
TRIP_S = 1.2
"""Time limit for all routes together, in s."""
MOST_AT_ONCE = 64
"""Largest number of actuators that are tripped at the same time, among rigs that the supervisor
does not serve.
"""


class StopAttempts:
    """Attempts to stop rigs, each in its own thread, and the rigs that have confirmed a stop.

    An attempt may hang forever; therefore its thread is a daemon, and callers wait with a time
    limit.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._running: Counter[str] = Counter()
        self._threads: list[threading.Thread] = []
        self.confirmed: dict[str, str] = {}
        """Route by which each rig was stopped first."""
        self.failed: list[tuple[str, BaseException]] = []
        """Routes that have failed, each with its error."""

    def start(self, way: str, attempt: Callable[[], object]) -> None:
        """Run an attempt in a thread. The attempt calls ``confirm``, or raises an error if it
        fails.
        """
        with self._changed:
            self._running[way] += 1
        thread = threading.Thread(
            target=self._run, args=(way, attempt), name=f"stop {way}", daemon=True
        )
        try:
            thread.start()
        except RuntimeError:  # no further thread is allowed
            self._run(way, attempt)
        else:
            self._threads.append(thread)

    def _run(self, way: str, attempt: Callable[[], object]) -> None:
        try:
            attempt()
        # A failure of one route, even a panic of the bus, must not end the others.
        except BaseException as error:  # noqa: BLE001
            with self._changed:
                self.failed.append((way, error))
        finally:
            with self._changed:
                self._running[way] -= 1
                self._changed.notify_all()

    def confirm(self, rig: str, way: str) -> None:
        """Note that a rig's actuator has confirmed the stop."""
        with self._changed:
            self.confirmed.setdefault(rig, way)
            self._changed.notify_all()

    def wait(self, timeout_s: float, done: Callable[[], bool] = lambda: False) -> None:
        """Wait until ``done``, until every attempt has ended, or for ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: done() or not self.running, timeout_s)

    @property
    def running(self) -> list[str]:
        """Return the routes whose attempt has not ended."""
        return [way for way, count in self._running.items() if count > 0]

    def join(self, timeout_s: float) -> None:
        """Wait for the threads to end, so that none is inside a library when the process ends."""
        until_s = monotonic() + timeout_s
        for thread in self._threads:
            thread.join(max(0.0, until_s - monotonic()))


def trip_at(config: "SessionConfig", rig: str, trip: "Trip", name: str = "estop") -> "Message":
    """Trip the actuator of a rig in a separate session, and return the acknowledgement.

    Raises
    ------
    BusError
        The address cannot be reached, or the actuator does not confirm.
    """
    from pincette.core.topics import TRIP

    with joined(config, rig, name) as bus:
        return bus.call(TRIP, trip, REPLY_S)


def trip_each(
    rigs: Iterable[str], trip: Callable[[str], object], limit_s: float = TRIP_S
) -> dict[str, str]:
    """Trip several actuators at once, each by a separate call.

    Returns the reason for each rig that has not confirmed within ``limit_s``.
    """
    attempts, wanted, until_s = StopAttempts(), sorted(rigs), monotonic() + limit_s
    waiting, tried, failed = deque(wanted), set[str](), dict[str, str]()

    def trip_in_turn() -> None:
        while monotonic() < until_s:
            try:
                rig = waiting.popleft()
            except IndexError:
                return
            tried.add(rig)
            try:
                trip(rig)
            except Exception as error:  # noqa: BLE001  a rig that fails must not end the others
                failed[rig] = str(error)
            else:
                attempts.confirm(rig, ROUTED)

    for _ in wanted[:MOST_AT_ONCE]:
        attempts.start(ROUTED, trip_in_turn)
    attempts.wait(limit_s)
    late = f"no reply within {limit_s:.1f} s"
    untried = f"not tried: {MOST_AT_ONCE} others: {late}; stop it by name"
    missed = {rig: late if rig in set(tried) else untried for rig in wanted} | dict(failed)
    return {rig: why for rig, why in missed.items() if rig not in attempts.confirmed}


@contextmanager
def joined(config: "SessionConfig", rig: str, name: str = "estop") -> "Generator[ZenohBus]":
    """Open a session at the first address of a configuration; raises BusError if the port is
    closed.
    """
    from pincette.bus.protocol import BusError
    from pincette.bus.topology import address_of
    from pincette.bus.zenoh_bus import ZenohBus

    place = config.connect[0]
    try:
        # A closed port rejects a connection at once; the bus would retry until its time limit.
        create_connection(address_of(place), CONNECT_S).close()
    except OSError as error:
        why = "no program listens" if isinstance(error, ConnectionRefusedError) else str(error)
        raise BusError(f"{why} at {place}") from error
    with closing(ZenohBus(replace(config, connect_s=CONNECT_S), rig, name)) as bus:
        yield bus
