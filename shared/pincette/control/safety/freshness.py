"""Age of a command, by the clock and by its sample number, and the allowed standstill.

A command is as old as the sample that it is based on, whose age counts from its arrival here: no
two limits add up, and no clocks of two programs are compared. The clock detects a command that is
late; the numbers detect one that comes out of a queue with the samples of its time.
"""

from dataclasses import dataclass

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord

ARRIVALS_KEPT = 8
"""Number of samples that are kept. A command further ahead has not overtaken its sample; it is
wrong."""


class Arrival(FrozenRecord, frozen=True):
    """A sample that has arrived here."""

    seq: int
    at_s: float
    x_um: tuple[float | None, ...]
    """Position of each arm, in µm; None if it was not measured."""


Arrivals = tuple[Arrival, ...]


@dataclass(frozen=True, slots=True)
class AgeLimits:
    """Limits of the age of a command, and of the time until the first one."""

    limit_s: float
    limit_ticks: int
    grace_s: float
    wake_s: float
    """Interval at which the actuator checks its clock, in s; twice that is a standstill."""
    excused_s: float
    """Time of its own standstill that is subtracted from an age, from one command to the next, in
    s."""


def newest_seq(arrivals: Arrivals) -> int:
    """Return the number of the newest sample; -1 before the first."""
    return arrivals[-1].seq if arrivals else -1


def skipped_seq(arrivals: Arrivals, seq: int) -> int:
    """Return the number before a new sample's, if that sample did not arrive.

    Returns -1 if none is missing.
    """
    newest = newest_seq(arrivals)
    return seq - 1 if 0 <= newest < seq - 1 else -1


def with_sample(
    arrivals: Arrivals, seq: int, at_s: float, x_um: tuple[float | None, ...]
) -> Arrivals:
    """Add a sample; older and equal numbers change nothing."""
    if seq <= newest_seq(arrivals):
        return arrivals
    return (*arrivals[1 - ARRIVALS_KEPT :], Arrival(seq, at_s, x_um))


def arrival_of(arrivals: Arrivals, seq: int) -> Arrival | None:
    """Return the sample of a number; None if it has not arrived, or not recently."""
    for arrival in arrivals:
        if arrival.seq == seq:
            return arrival
    return None


def too_old(limits: AgeLimits, arrivals: Arrivals, sample: Arrival, now: float) -> Fault | None:
    """Return why a command based on ``sample`` is too old; None if it is not too old."""
    age_s = now - sample.at_s
    if age_s > limits.limit_s:
        return fault(FaultCode.COMMAND_TOO_LATE, age_s=age_s, limit_s=limits.limit_s)
    ticks = newest_seq(arrivals) - sample.seq
    if ticks > limits.limit_ticks:
        return fault(
            FaultCode.COMMAND_SAMPLES_TOO_OLD, samples=ticks, limit_samples=limits.limit_ticks
        )
    return None


def standstill_s(limits: AgeLimits, slept_s: float, excused_s: float) -> float | None:
    """Return the time since the actuator's last run that is subtracted from ages, in s, or None.

    During a standstill of the machine a command on its way could not arrive, and a ramp would jump
    after it.
    """
    stood_s = slept_s - limits.wake_s
    if stood_s <= limits.wake_s:
        return None
    return min(stood_s, limits.excused_s - excused_s)
