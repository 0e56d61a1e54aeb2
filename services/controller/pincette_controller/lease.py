"""The supervisor's lease: how long a program plays on while nobody is heard of; pure.

It is counted on the clock that the step is given. Its end is a question that the controller asks
of itself, and tells as one, so that a replay, which has no such clock, finds it in the record.
"""

from dataclasses import dataclass

from pincette.messages import Act, Lease

CAUSE = "lease"
STOPS = ("stop", "let_go", "retract")
STOPPED = "stopped"
"""Outcome of a program that has been stopped: there is nothing left to stop."""


@dataclass(frozen=True, slots=True)
class Running:
    """A lease that runs, and the time at which it was granted last."""

    lease: Lease
    heard_s: float


def objection(lease: Lease, epoch: int, *, playing: bool, ended: bool) -> str:
    """Why a lease is not granted; empty where it is.

    Parameters
    ----------
    epoch
        That of the controller.
    ended
        Whether the lease of this epoch has come to its end.
    """
    if lease.epoch != epoch:
        return f"lease of epoch {lease.epoch}, the controller is in {epoch}"
    if not playing:
        return "nothing plays: a lease has nothing to go on with"
    if ended:
        return "the lease of this epoch has ended: arm anew"
    if lease.length_s <= 0.0:
        return f"lease of {lease.length_s:g} s: not above 0 s"
    if lease.then not in STOPS:
        return f"lease ends with {lease.then!r}; there are {', '.join(STOPS)}"
    return ""


def end(running: Running | None, outcome: str, now: float) -> Act | None:
    """How a program is stopped whose lease has ended; None where it runs, or nothing is to do."""
    if running is None or outcome == STOPPED:
        return None
    silent_s, length_s = now - running.heard_s, running.lease.length_s
    if silent_s <= length_s:
        return None
    reason = (
        f"{CAUSE}: nothing heard from the supervisor for {silent_s:.1f} s, limit {length_s:g} s"
    )
    return Act(running.lease.then, reason=reason)
