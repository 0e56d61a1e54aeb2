"""Lease of a job's program: granted with its arming, and renewed by a separate thread."""

# A thread renews it, so that neither a slow disk nor a long evaluation of samples lets it expire.
# There is no lease in lockstep, where a machine may be slow and the time of a renewal would change
# results.

import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from time import monotonic

from pincette.api.job_kinds import JobKind
from pincette.api.requests import JobRequest, OnStop
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.config import RigFile
from pincette.core.faults import ActionCode, FaultCode, LeaseEnd
from pincette.core.messages import Lease, Status
from pincette.core.topics import LEASE
from pincette.core.wording import faults_text
from pincette.engine.arming import status
from pincette_supervisor.plugin import kind_of

RENEWALS = 5.0
"""Number of renewals within the length of a lease; all except one may fail."""
ASK_S, JOIN_S = 1.0, 2.0
STOPS: Mapping[OnStop, LeaseEnd] = {
    "hold": LeaseEnd.STOP,
    "release": LeaseEnd.LET_GO,
    "retract": LeaseEnd.RETRACT,
}
"""How the controller stops a program at the end of a lease, by the request's ``on_stop``."""


def lease_s(request: JobRequest, rig: RigFile) -> float:
    """Return the time for which a program continues without its supervisor, in s; 0 if it continues
    to its end.
    """
    return rig.safety.lease_s * kind_of(request).lease_factor


def lease_end(request: JobRequest) -> LeaseEnd:
    """Return how the controller stops a job, also when its lease has ended."""
    return STOPS[kind_of(request).stop_of(request)]


def interruption(kind: JobKind | None) -> ActionCode:
    """Return how a program is stopped after its supervisor has ended.

    A part stays held regardless of the request's setting for a stop, unless the kind releases it.
    """
    return ActionCode(STOPS["hold" if kind is None else kind.on_stop])


def lease_of(rig: RigFile, request: JobRequest, epoch: int) -> Lease | None:
    """Return the lease of a job's arming; None if the rig has none."""
    length_s = lease_s(request, rig)
    if rig.lockstep or not length_s:
        return None
    return Lease(epoch, length_s, lease_end(request))


def ended_words(bus: Bus, length_s: float) -> str:
    """Return why the controller has stopped at the end of its lease, from its status if it
    replies.
    """
    text = ""
    with suppress(BusError):
        text = ended_text(status(bus, "controller", ASK_S))
    return text or f"lease: nothing received from the supervisor, limit {length_s:g} s"


def ended_text(controller: Status) -> str:
    """Return the controller's text on a lease that has ended; empty if none has."""
    return faults_text([one for one in controller.findings if one.code is FaultCode.LEASE_ENDED])


class Renewal:
    """Renews one lease until it is ended or the program has ended."""

    def __init__(self, bus: Bus, lease: Lease, clock: Callable[[], float] = monotonic) -> None:
        self.lease = lease
        self._bus, self._clock = bus, clock
        self._renewed_at_s = clock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"lease-{lease.epoch}", daemon=True)

    @property
    def age_s(self) -> float:
        """Return the time since the controller last accepted the renewal, in s."""
        return self._clock() - self._renewed_at_s

    def begin(self) -> None:
        """Start renewing in a thread."""
        self._thread.start()

    def end(self) -> None:
        """Stop renewing."""
        self._ended.set()
        self._thread.join(JOIN_S)

    def _work(self) -> None:
        every_s = self.lease.length_s / RENEWALS
        while not self._ended.wait(every_s) and self.renew(every_s):
            pass

    def renew(self, timeout_s: float) -> bool:
        """Renew the lease; return False if the controller no longer accepts it."""
        asked_s = self._clock()
        try:
            self._bus.call(LEASE, self.lease, timeout_s)
        except RefusalError:
            return False  # the program has ended, or was stopped without a lease
        except BusError:
            return True
        self._renewed_at_s = asked_s
        return True


@contextmanager
def renewing(renewal: Renewal | None) -> Generator[None]:
    """Renew a lease, if there is one, within the block."""
    if renewal is None:
        yield
        return
    renewal.begin()
    try:
        yield
    finally:
        renewal.end()
