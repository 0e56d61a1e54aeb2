"""Rules for the voltage: range, slew rate, sweeps, and the ramp to the safe value."""

from dataclasses import dataclass, replace
from math import isfinite

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.voltage_range import VoltageRange

VOLTAGE_MAX, VOLTAGE_MIN, SLEW_UP, SLEW_DOWN = 1, 2, 4, 8
"""Bits of the voltage limits, set if the limit has acted."""
ABSURD_SPANS = 10.0
"""Distance of a voltage from the range of the output, as a multiple of the range. A voltage that is
further away is refused as an error."""


@dataclass(frozen=True, slots=True)
class VoltageLimits:
    """Limits of the output, at the amplifier's input."""

    min_V: float
    max_V: float
    slew_V: float
    """Largest change between two commands, per control period, in V."""
    sweep_V: float
    """Largest amplitude of a sweep, in V, to which the slew limit does not apply."""
    step_V: float = 0.0
    """Voltage step of the output, in V; only its multiples can be output; 0 if not known."""


def within(limits: VoltageLimits, planned: VoltageRange | None, present_V: float) -> VoltageLimits:
    """Return the limits narrowed to those of the plan; unchanged without a plan.

    A voltage outside the plan, for example from an earlier job, may only change towards the planned
    range.
    """
    if planned is None:
        return limits
    low_V, high_V = planned.from_voltage(present_V)
    return replace(limits, min_V=max(limits.min_V, low_V), max_V=min(limits.max_V, high_V))


def slewing_s(period_s: float, since_s: float) -> float:
    """Return the time since the last change of the output for which the slew limit allows motion,
    in s.

    It is at most one period, so that a command after a pause may change the voltage no more than
    any other command. It is rounded to 1 µs, so that records contain the exact value.
    """
    return round(min(max(since_s, 0.0), period_s), 6)


def limited(
    limits: VoltageLimits, present_V: float, wanted_V: float, share: float = 1.0
) -> tuple[float, int]:
    """Return the voltage limited in range and slew, in V, and the bits of the limits that acted.

    u = clip(clip(wanted, min, max), present - share·slew, present + share·slew), where share is the
    fraction of a period since the last change.
    """
    flags, slew_V = 0, share * limits.slew_V
    if wanted_V > limits.max_V:
        wanted_V, flags = limits.max_V, VOLTAGE_MAX
    elif wanted_V < limits.min_V:
        wanted_V, flags = limits.min_V, VOLTAGE_MIN
    if wanted_V > present_V + slew_V:
        wanted_V, flags = present_V + slew_V, flags | SLEW_UP
    elif wanted_V < present_V - slew_V:
        wanted_V, flags = present_V - slew_V, flags | SLEW_DOWN
    if limits.step_V <= 0.0 or slew_V < limits.step_V:
        return wanted_V, flags
    return _stepped(limits, present_V, wanted_V, slew_V), flags


def _stepped(limits: VoltageLimits, present_V: float, wanted_V: float, slew_V: float) -> float:
    """Return the multiple of the step nearest to a voltage, within the limits."""
    steps = round(wanted_V / limits.step_V)
    nearest_V = steps * limits.step_V
    if nearest_V > limits.max_V or nearest_V > present_V + slew_V:
        return (steps - 1) * limits.step_V
    if nearest_V < limits.min_V or nearest_V < present_V - slew_V:
        return (steps + 1) * limits.step_V
    return nearest_V


def put_out(limits: VoltageLimits, said_V: float) -> float:
    """Return the true voltage, in V, of an output whose read-back is rounded."""
    if limits.step_V <= 0.0:
        return said_V
    return round(said_V / limits.step_V) * limits.step_V


def absurd(limits: VoltageLimits, wanted_V: float) -> Fault | None:
    """Return the reason why a voltage is refused rather than limited; None if it is not refused."""
    if not isfinite(wanted_V):
        return fault(FaultCode.VOLTAGE_NOT_FINITE, voltage_V=wanted_V)
    room_V = ABSURD_SPANS * (limits.max_V - limits.min_V)
    if limits.min_V - room_V <= wanted_V <= limits.max_V + room_V:
        return None
    return fault(
        FaultCode.VOLTAGE_ABSURD,
        voltage_V=wanted_V,
        minimum_V=limits.min_V,
        maximum_V=limits.max_V,
    )


def too_wide(limits: VoltageLimits, about_V: float, amplitude_V: float) -> Fault | None:
    """Return the reason why a sweep cannot be played; None if it can."""
    if not amplitude_V <= limits.sweep_V:
        return fault(FaultCode.SWEEP_TOO_WIDE, amplitude_V=amplitude_V, limit_V=limits.sweep_V)
    low_V, high_V = about_V - amplitude_V, about_V + amplitude_V
    if low_V < limits.min_V or high_V > limits.max_V:
        return fault(
            FaultCode.SWEEP_OUT_OF_RANGE,
            low_V=low_V,
            high_V=high_V,
            minimum_V=limits.min_V,
            maximum_V=limits.max_V,
        )
    return None


def ramp(from_V: float, safe_V: float, share: float) -> float:
    """Return the voltage of a ramp, in V, at the fraction ``share`` of its duration.

    u = u_0 + clip(share, 0, 1)·(u_safe - u_0): the voltage is never outside the range from u_0 to
    u_safe, even if the clock jumps.
    """
    return from_V + min(max(share, 0.0), 1.0) * (safe_V - from_V)
