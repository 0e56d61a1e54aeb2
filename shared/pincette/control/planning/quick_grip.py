"""Speeds of a quick grip, in which the load begins at the contact without a stop.

The contact is detected after n samples above the contact force. Until then the voltage continues to
rise, and the force rises with the stiffness K_e/S of part and arm in series:

    F = F_touch + K_e/S·v·n·T,    K_e/S = 1/(1/K_e + s_p),  S = 1 + s_p·K_e

This force must be below half of the planned force for the hardest permitted part, so that the other
half remains for the load. If the part is met earlier than planned, during the approach, the force
may reach three quarters of the planned force: no load follows, and the remaining quarter allows for
the reversal.

After the contact F_r is a quintic that begins with the rate K_e·v and ends at rest. For the
remaining distance ΔF/K_e, the speed decreases smoothly from v to 0 in 2·ΔF/(K_e·v); a quintic
longer than 2.5·ΔF/(K_e·v) would overshoot its end.
"""

from typing import NamedTuple

from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.contact_request import force_at_touch_mN
from pincette.control.planning.feasibility import Violation
from pincette.control.planning.profiles import minimum_duration, move
from pincette.control.planning.touch_force import FORCE_SHARE, LOAD_PERIODS, SafeTouch, short_load

SMOOTH, LONGEST = 2.0, 2.5
"""Durations of a load over the distance d that begins at the speed v, in multiples of d/v: the
duration with a smooth deceleration, and the longest duration without overshoot."""
EARLY_SHARE = 0.75
"""Fraction of the planned force that may act when the contact occurs earlier than planned."""
SLEW_SHARE = 0.6
"""Fraction of the slew limit that an approach uses if no speed is given; the rest is a reserve for
hysteresis."""
HALVINGS = 30


class AskedSpeeds(NamedTuple):
    """Speeds given in a request; None if not given."""

    approach_um_per_s: float | None
    seek_um_per_s: float | None
    load_um_per_s: float | None
    load_s: float | None


class UsualSpeeds(NamedTuple):
    """Speeds in the rig file: upper limits for speeds that are not given in the request."""

    approach_um_per_s: float
    seek_um_per_s: float
    load_um_per_s: float


class QuickSpeeds(NamedTuple):
    """Speeds of a grip, and durations of its load and unload."""

    approach_um_per_s: float
    seek_um_per_s: float
    load_s: float
    unload_s: float
    violations: tuple[Violation, ...]
    """Violations caused by the request itself."""

    def values(self) -> dict[str, float]:
        """Return the speeds and durations as members of a ``GripRequest``."""
        return {
            "approach_um_per_s": self.approach_um_per_s,
            "seek_um_per_s": self.seek_um_per_s,
            "load_s": self.load_s,
            "unload_s": self.unload_s,
        }


def load_duration(way_um: float, speed: float, peak_speed: float) -> float:
    """Return the shortest time in s of a load over ``way_um`` from ``speed`` to rest."""
    longest_s = SMOOTH * way_um / speed
    if peak_speed <= speed:
        return longest_s
    low_s, high_s = way_um / peak_speed, longest_s
    for _ in range(HALVINGS):
        middle_s = 0.5 * (low_s + high_s)
        path = move(0.0, speed, way_um, 0.0, middle_s)
        if max(path.speed(middle_s * place / 32) for place in range(32)) > peak_speed:
            low_s = middle_s
        else:
            high_s = middle_s
    return high_s


def quick_speeds(
    asked: AskedSpeeds, usual: UsualSpeeds, touch: SafeTouch, K_e: float, rig: PlannedRig
) -> QuickSpeeds | None:
    """Choose the speeds of a quick grip; None if no speed is slow enough for the force.

    Parameters
    ----------
    touch
        Limits of the contact, for the stiffness of the hardest permitted part.
    K_e
        Expected stiffness of the part, in mN/µm.

    Raises
    ------
    ValueError
        If a speed or a time is not finite and positive.
    """
    touch = touch._replace(seek_share=FORCE_SHARE, approach_share=EARLY_SHARE)
    if FORCE_SHARE * touch.force_mN <= touch.contact_force_mN:
        return None
    limit, early = touch.limit("seek_um_per_s"), touch.limit("approach_um_per_s")
    least_s = LOAD_PERIODS * rig.period_s
    slew = SLEW_SHARE * rig.limits.slew_V_per_s * rig.piezo_um_per_V
    approach = asked.approach_um_per_s or min(usual.approach_um_per_s, early, slew)
    peak = asked.load_um_per_s or usual.load_um_per_s
    seek = asked.seek_um_per_s or min(usual.seek_um_per_s, peak, limit)
    way_um = _way_um(touch, K_e, seek)
    if asked.seek_um_per_s is None:
        # A longer load, as the request or the period may require, begins at a lower speed.
        seek = min(seek, SMOOTH * way_um / max(asked.load_s or 0.0, least_s))
        way_um = _way_um(touch, K_e, seek)
    load_s = asked.load_s or max(least_s, load_duration(way_um, seek, peak))
    unload_um = touch.force_mN / K_e
    unload_s = asked.load_s or max(least_s, minimum_duration(unload_um, peak))
    longest_s = max(least_s, LONGEST * way_um / seek)
    stated = {
        name: value
        for name in ("approach_um_per_s", "seek_um_per_s")
        if (value := getattr(asked, name)) is not None
    }
    found = list(touch.violations(stated))
    if asked.load_um_per_s is not None and asked.load_um_per_s < seek * (1.0 - 1e-9):
        message = (
            f"load_um_per_s = {asked.load_um_per_s:g} µm/s is below the speed of the seek, "
            f"{seek:g} µm/s, with which the load begins: seek more slowly, or load faster"
        )
        value = asked.load_um_per_s
        found.append(Violation("/load_um_per_s", "speed", value, seek, "µm/s", 0.0, message))
    found.extend(short_load(load_s, rig.period_s))
    if load_s > longest_s * (1.0 + 1e-9):
        message = (
            f"load_s = {load_s:g} s is above {longest_s:.3g} s, beyond which a load that "
            f"begins with {seek:g} µm/s would overshoot: load in less time, seek more "
            'slowly, or grip with profile = "gentle"'
        )
        found.append(Violation("/load_s", "duration", load_s, longest_s, "s", 0.0, message))
    return QuickSpeeds(approach, seek, load_s, unload_s, tuple(found))


def _way_um(touch: SafeTouch, K_e: float, speed: float) -> float:
    """Return the distance from the contact to the planned force, in µm; at least 0.1·F/K_e."""
    begun_mN = force_at_touch_mN(
        touch.contact_force_mN, K_e, touch.compliance_um_per_mN, speed, touch.period_s
    )
    return max(0.1 * touch.force_mN, touch.force_mN - begun_mN) / K_e
