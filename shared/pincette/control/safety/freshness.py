"""Age of a command, by the clock and by its sample number, and the allowance for stalls.

The age of a command is that of the sample it is based on, counted from the arrival of the sample at
the actuator. So limits do not add up, and clocks of different programs are not compared. The clock
detects a late command. The sample numbers detect a command that was queued together with samples of
the same time.
"""

from dataclasses import dataclass

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord

ARRIVALS_KEPT = 8
"""Number of samples that are kept. A command whose sample number is further ahead cannot simply
have arrived before its sample; it is wrong."""


class Arrival(FrozenRecord, frozen=True):
    """A sample that has arrived at the actuator."""

    seq: int
    at_s: float
    x_um: tuple[float | None, ...]
    """Position of each arm, in µm; None if it was not measured."""


Arrivals = tuple[Arrival, ...]


@dataclass(frozen=True, slots=True)
class AgeLimits:
    """Limits for the age of a command, and for the time until the first one."""

    limit_s: float
    limit_ticks: int
    grace_s: float
    wake_s: float
    """Interval at which the actuator checks its clock, in s. Twice this interval counts as a
    stall."""
    excused_s: float
    """Largest time of its own stalls that is subtracted from ages between two commands, in s."""


def newest_seq(arrivals: Arrivals) -> int:
    """Return the number of the newest sample; -1 before the first one."""
    return arrivals[-1].seq if arrivals else -1


def skipped_seq(arrivals: Arrivals, seq: int) -> int:
    """Return the number before that of a new sample if no sample with that number has arrived.

    Returns -1 if no sample is missing.
    """
    newest = newest_seq(arrivals)
    return seq - 1 if 0 <= newest < seq - 1 else -1


def with_sample(
    arrivals: Arrivals, seq: int, at_s: float, x_um: tuple[float | None, ...]
) -> Arrivals:
    """Add a sample; a sample with an older or equal number changes nothing."""
    if seq <= newest_seq(arrivals):
        return arrivals
    return (*arrivals[1 - ARRIVALS_KEPT :], Arrival(seq, at_s, x_um))


def arrival_of(arrivals: Arrivals, seq: int) -> Arrival | None:
    """Return the sample with a number; None if it has not arrived, or is no longer kept."""
    for arrival in arrivals:
        if arrival.seq == seq:
            return arrival
    return None


def too_old(limits: AgeLimits, arrivals: Arrivals, sample: Arrival, now: float) -> Fault | None:
    """Return the reason why a command based on ``sample`` is too old; None if it is not."""
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
    """Return the time to subtract from ages for a stall before this run, in s; None without a
    stall.

    During a stall of the machine no command can arrive, and without the subtraction a ramp would
    jump after the stall.
    """
    stood_s = slept_s - limits.wake_s
    if stood_s <= limits.wake_s:
        return None
    return min(stood_s, limits.excused_s - excused_s)
