"""Monitors that compare force, following error and position with hard limits in each sample.

The hard limits lie beyond those of the controller's guards, so that the controller's gentler
reaction comes first. A limit trips once it has been exceeded for several consecutive samples. A
sample with an unknown quantity neither increments nor resets the count. The count of the following
error leaks: a sample within the bound decrements it, so that an alternating target is detected too.
"""

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from msgspec.structs import replace

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord
from pincette.control.safety.causes import Cause


@dataclass(frozen=True, slots=True)
class MonitorLimits:
    """Hard limits, and the number of consecutive samples for which each may be exceeded."""

    period_s: float
    force_mN: float
    force_samples: int
    following_um: float
    """Largest |x - x_d| while x_d is constant, in µm."""
    following_s: float
    """Increase of the bound of |x - x_d| per speed of x_d, in µm per µm/s."""
    following_samples: int
    position_min_um: float
    position_max_um: float
    position_samples: int
    fastest_um_per_s: float = inf
    """Speed of the arm at the slew limit, in µm/s. A faster target cannot be planned and does not
    increase the bound further."""


class Watch(FrozenRecord, frozen=True):
    """Number of consecutive samples beyond a limit, and the newest excess."""

    count: int = 0
    newest: Fault | None = None

    def updated(self, excess: Fault | None) -> "Watch":
        """Count a sample; a sample without excess resets the count."""
        return QUIET if excess is None else Watch(self.count + 1, excess)

    def leak(self, excess: Fault | None) -> "Watch":
        """Count a sample; a sample without excess decrements the count."""
        if excess is not None:
            return Watch(self.count + 1, excess)
        return QUIET if self.count <= 1 else Watch(self.count - 1, self.newest)

    def found(self, samples: int) -> Fault | None:
        """Return the fault, with the number of samples, if the limit trips; otherwise None."""
        if self.newest is None or self.count < samples:
            return None
        return self.newest.with_values(samples=self.count)


QUIET = Watch()


class Watches(FrozenRecord, frozen=True):
    """Observations of each quantity, and the last position that the law requested."""

    seq: int = -1
    """Number of the sample of the newest command."""
    force: Watch = QUIET
    following: Watch = QUIET
    position: Watch = QUIET
    aim_seq: int = -1
    aim_um: float | None = None
    """Target position x_d in the newest command that stated one, in µm; None before the first
    one."""


UNSEEN = Watches()


class Finding(NamedTuple):
    """Cause and fault for which the actuator's own monitors trip it."""

    cause: Cause
    fault: Fault


def force_excess(limits: MonitorLimits, force_mN: float) -> Fault | None:
    """Return a fault if a force, positive in compression, exceeds its limit."""
    if force_mN <= limits.force_mN:
        return None
    return fault(FaultCode.FORCE_BEYOND_LIMIT, force_mN=force_mN, limit_mN=limits.force_mN)


def following_excess(
    limits: MonitorLimits, x_um: float, x_d_um: float, speed_um_per_s: float
) -> Fault | None:
    """Return a fault if |x - x_d| > following_um + following_s·min(|dx_d/dt|, fastest_um_per_s).

    The bound grows with the commanded speed, as in machine tools, since a moving arm lags.
    """
    credited_um_per_s = min(speed_um_per_s, limits.fastest_um_per_s)
    bound_um, error_um = limits.following_um + limits.following_s * credited_um_per_s, x_um - x_d_um
    if abs(error_um) <= bound_um:
        return None
    return fault(
        FaultCode.FOLLOWING_BEYOND_LIMIT,
        x_um=x_um,
        x_d_um=x_d_um,
        error_um=abs(error_um),
        limit_um=bound_um,
    )


def position_excess(limits: MonitorLimits, x_um: float) -> Fault | None:
    """Return a fault if a measured position is beyond its limits, or is not a number."""
    low_um, high_um = limits.position_min_um, limits.position_max_um
    if low_um <= x_um <= high_um:
        return None
    return fault(FaultCode.POSITION_BEYOND_LIMITS, x_um=x_um, minimum_um=low_um, maximum_um=high_um)


def watch_position(limits: MonitorLimits, watches: Watches, x_um: float) -> Watches:
    """Update the monitors by a measured sample."""
    excess = position_excess(limits, x_um)
    if excess is None and watches.position is QUIET:
        return watches
    return replace(watches, position=watches.position.updated(excess))


def watch_command(
    limits: MonitorLimits,
    watches: Watches,
    *,
    seq: int,
    x_um: float | None,
    x_d_um: float | None,
    force_mN: float | None,
) -> Watches:
    """Update the monitors by a command's values for its sample; each sample counts once."""
    if seq <= watches.seq:
        return watches
    force, following = watches.force, watches.following
    aim_seq, aim_um = watches.aim_seq, watches.aim_um
    if force_mN is not None:
        force = force.updated(force_excess(limits, force_mN))
    if x_d_um is not None and x_um is not None:
        way_um = 0.0 if aim_um is None else abs(x_d_um - aim_um)
        speed_um_per_s = way_um / ((seq - aim_seq) * limits.period_s)
        following = following.leak(following_excess(limits, x_um, x_d_um, speed_um_per_s))
        aim_seq, aim_um = seq, x_d_um
    return Watches(seq, force, following, watches.position, aim_seq, aim_um)


def finding(limits: MonitorLimits, watches: Watches) -> Finding | None:
    """Return the most serious limit that trips; None if none does."""
    if watches.force is QUIET and watches.position is QUIET and watches.following is QUIET:
        return None
    if found := watches.force.found(limits.force_samples):
        return Finding(Cause.FORCE, found)
    if found := watches.position.found(limits.position_samples):
        return Finding(Cause.POSITION, found)
    if found := watches.following.found(limits.following_samples):
        return Finding(Cause.FOLLOWING_ERROR, found)
    return None
