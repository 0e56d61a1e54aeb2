"""The lease under which a job's program plays: granted with its arming, renewed while it lives.

A thread of its own renews it, so that neither a slow disk nor a long look at the samples lets it
run out. In lockstep there is none: a machine may take as long as it likes there, and when a renewal
came would decide about the numbers.
"""

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from time import monotonic

from pincette.api.request_models import AnyJobRequest
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.config import RigFile
from pincette.messages import Lease
from pincette.runtime.arming import status
from pincette.topics import LEASE
from pincette_supervisor.running import policies

LEASE_ENDED = "lease"
"""What telemetry says before the stop that the controller made by itself, and how the controller's
own words of it begin."""
RENEWALS = 5.0
"""Within the length of a lease; all but one of them may fail."""
ASK_S, JOIN_S = 1.0, 2.0


def lease_of(rig: RigFile, request: AnyJobRequest, epoch: int) -> Lease | None:
    """What a job's arming is granted; None where the rig has no lease."""
    length_s = rig.safety.lease_s
    if rig.lockstep or not length_s:
        return None
    return Lease(epoch, length_s, policies.stop_act(request).action)


def ended_words(bus: Bus, length_s: float) -> str:
    """Why the controller has stopped by itself: its own words, where it answers."""
    try:
        detail = status(bus, "controller", ASK_S).detail
    except BusError:
        detail = ""
    if detail.startswith(LEASE_ENDED):
        return detail
    return f"{LEASE_ENDED}: nothing heard from the supervisor, limit {length_s:g} s"


class Renewal:
    """Grants one lease again and again, until it is ended or the program has come to its end."""

    def __init__(self, bus: Bus, lease: Lease, clock: Callable[[], float] = monotonic) -> None:
        self.lease = lease
        self._bus, self._clock = bus, clock
        self._heard_s = clock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"lease-{lease.epoch}", daemon=True)

    @property
    def age_s(self) -> float:
        """Since the controller has taken it last."""
        return self._clock() - self._heard_s

    def begin(self) -> None:
        """Renew from here on, in a thread."""
        self._thread.start()

    def end(self) -> None:
        """Renew no more."""
        self._ended.set()
        self._thread.join(JOIN_S)

    def _work(self) -> None:
        every_s = self.lease.length_s / RENEWALS
        while not self._ended.wait(every_s) and self.renew(every_s):
            pass

    def renew(self, timeout_s: float) -> bool:
        """Grant it anew; false where the controller does not take it any more."""
        asked_s = self._clock()
        try:
            self._bus.ask(LEASE, self.lease, timeout_s)
        except RefusalError:
            return False  # the program has come to its end, or was stopped because nobody asked
        except BusError:
            return True
        self._heard_s = asked_s
        return True


@contextmanager
def renewing(renewal: Renewal | None) -> Generator[None]:
    """Renew a lease, where there is one, while something goes on."""
    if renewal is None:
        yield
        return
    renewal.begin()
    try:
        yield
    finally:
        renewal.end()
