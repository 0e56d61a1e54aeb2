"""Force, following error and position held against hard limits, sample by sample.

The hard limits lie beyond those that the controller's guards watch, so that its gentle reaction
comes first; a limit acts once it has been exceeded for some samples in a row. A sample of which a
quantity is not known neither counts nor clears. Words name value, unit and limit.
"""

from dataclasses import dataclass

from pincette.control.replacing import replace
from pincette.control.safety.causes import Cause


@dataclass(frozen=True, slots=True)
class MonitorLimits:
    """Hard limits, and for how many samples in a row each may be exceeded."""

    period_s: float
    force_mN: float
    force_samples: int
    following_um: float
    """Largest |x - x_d| while x_d rests, and"""
    following_s: float
    """how much more for each µm/s of x_d."""
    following_samples: int
    position_min_um: float
    position_max_um: float
    position_samples: int


@dataclass(frozen=True, slots=True)
class Watch:
    """Samples in a row beyond a limit, and the words of the newest."""

    count: int = 0
    words: str = ""

    def follow(self, excess: str) -> "Watch":
        """Count a sample; an empty excess begins anew."""
        return Watch(self.count + 1, excess) if excess else QUIET

    def found(self, samples: int) -> str:
        """The words of a limit that acts; empty where it does not."""
        return f"{self.words}, {self.count} samples in a row" if self.count >= samples else ""


QUIET = Watch()


@dataclass(frozen=True, slots=True)
class Watches:
    """What has been seen of each quantity, and where the law wanted the arm last."""

    seq: int = -1
    """The newest command that was seen."""
    force: Watch = QUIET
    following: Watch = QUIET
    position: Watch = QUIET
    aim_seq: int = -1
    aim_um: float | None = None
    """x_d of that sample; None before the first."""


UNSEEN = Watches()


def force_excess(limits: MonitorLimits, force_mN: float) -> str:
    """Words where a force, compressive and positive, is beyond its limit."""
    if force_mN <= limits.force_mN:
        return ""
    return f"{force_mN:.1f} mN, limit {limits.force_mN:.1f} mN"


def following_excess(
    limits: MonitorLimits, x_um: float, x_d_um: float, speed_um_per_s: float
) -> str:
    """Words where |x - x_d| > following_um + following_s·|dx_d/dt|.

    The bound grows with the commanded speed, as that of a machine tool does: a fast arm lags.
    """
    bound_um, error_um = limits.following_um + limits.following_s * speed_um_per_s, x_um - x_d_um
    if abs(error_um) <= bound_um:
        return ""
    return (
        f"the arm is at {x_um:.2f} µm, wanted at {x_d_um:.2f} µm: off by {abs(error_um):.2f} µm, "
        f"limit {bound_um:.2f} µm"
    )


def position_excess(limits: MonitorLimits, x_um: float) -> str:
    """Words where a measured position is beyond its limits, or is no number."""
    low_um, high_um = limits.position_min_um, limits.position_max_um
    if low_um <= x_um <= high_um:
        return ""
    return f"{x_um:.2f} µm, limits {low_um:.2f} µm and {high_um:.2f} µm"


def watch_position(limits: MonitorLimits, watches: Watches, x_um: float) -> Watches:
    """Follow a measured sample."""
    position = watches.position.follow(position_excess(limits, x_um))
    return watches if position is watches.position else replace(watches, position=position)


def watch_command(
    limits: MonitorLimits,
    watches: Watches,
    *,
    seq: int,
    x_um: float | None,
    x_d_um: float | None,
    force_mN: float | None,
) -> Watches:
    """Follow what a command knows of its sample ``seq``; each sample counts once."""
    if seq <= watches.seq:
        return watches
    force, following = watches.force, watches.following
    aim_seq, aim_um = watches.aim_seq, watches.aim_um
    if force_mN is not None:
        force = force.follow(force_excess(limits, force_mN))
    if x_d_um is not None and x_um is not None:
        way_um = 0.0 if aim_um is None else abs(x_d_um - aim_um)
        speed_um_per_s = way_um / ((seq - aim_seq) * limits.period_s)
        following = following.follow(following_excess(limits, x_um, x_d_um, speed_um_per_s))
        aim_seq, aim_um = seq, x_d_um
    return Watches(seq, force, following, watches.position, aim_seq, aim_um)


def finding(limits: MonitorLimits, watches: Watches) -> str:
    """Cause and words of the gravest limit that acts; empty where none does."""
    if words := watches.force.found(limits.force_samples):
        return Cause.FORCE.because(words)
    if words := watches.position.found(limits.position_samples):
        return Cause.POSITION.because(words)
    if words := watches.following.found(limits.following_samples):
        return Cause.FOLLOWING_ERROR.because(words)
    return ""
