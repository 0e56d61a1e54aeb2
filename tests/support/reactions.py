"""Reaction of the actuator to a fault, as observed from outside, compared with its limits."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from pincette.config import RigFile
from pincette.core.messages import Applied, GroundTruth
from pincette.core.wording import applied_text
from pincette_actuator.config import configure
from tests.support.rigs import output_step_V
from tests.support.stalls import StallRecorder
from tests.support.witness import Witness

TRIPPED = ("frozen", "ramping")
REACTION_S = 0.060
"""Limit from the fault to the freeze, or to the first step of the ramp, in s: T = 20 ms."""
SAFE_S = 0.100
"""Limit from the fault to the safe voltage with the arm free, in s."""
RAMP_S = SAFE_S - REACTION_S
"""Time that remains for a ramp of 35 ms, in steps of a quarter of a period."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """Times since the fault, and the stalls of the machine until each."""

    reaction_s: float
    reaction_stalls_s: float
    safe_s: float
    safe_stalls_s: float
    cause: str


def within(bound_s: float, took_s: float, what: str) -> None:
    """Fail if a limit is exceeded."""
    assert took_s <= bound_s, f"{what} took {1e3 * took_s:.1f} ms, limit {1e3 * bound_s:.0f} ms"


def await_reaction(
    rig: RigFile, seen: Witness, stalls: StallRecorder, fault_s: float, *, held: bool
) -> Reaction:
    """Wait until the actuator is safe, and check the sequence.

    Held: the voltage of the last good command is kept exactly for ``freeze_s``, then ramped. Free:
    it is ramped at once.
    """
    safe_at, _ = seen.until_state(("latched",), fault_s)
    armed = [echo for _, echo in seen.since(Applied, fault_s - 1.0) if echo.state == "armed"]
    kept_V = armed[-1].arms[0].voltage_V
    tripped = [(at, echo) for at, echo in seen.since(Applied, fault_s) if echo.state in TRIPPED]
    begun_at, first = tripped[0]
    assert first.state == ("frozen" if held else "ramping")
    for _, echo in tripped:
        assert echo.state == "ramping" or echo.arms[0].voltage_V == kept_V
    ramped_at = _check_ramp(rig, seen, begun_at, kept_V)
    if held:
        limit_s = rig.safety.freeze_s
        step_s, frozen_s = configure(rig).age.wake_s, ramped_at - begun_at
        assert frozen_s >= limit_s - step_s
        within(limit_s + rig.rig.period_s, frozen_s, "the freeze")
    else:
        begun_at = ramped_at
    account = seen.account(safe_at, safe_at - ramped_at)
    within(SAFE_S - REACTION_S, safe_at - ramped_at, f"{account}\nthe ramp")
    _check_instrument(rig, seen, begun_at, ramped_at, kept_V)
    return Reaction(
        begun_at - fault_s,
        stalls.between(fault_s, begun_at),
        safe_at - fault_s,
        stalls.between(fault_s, safe_at),
        applied_text(first),
    )


def _check_ramp(rig: RigFile, seen: Witness, begun_at: float, kept_V: float) -> float:
    """Return when the voltage first moved; it must go to the safe voltage and never reverse."""
    echoes = seen.since(Applied, begun_at)
    safe_V = rig.safety.safe_V
    away_V = [abs(echo.arms[0].voltage_V - safe_V) for _, echo in echoes]
    assert away_V == sorted(away_V, reverse=True), "the ramp turned back"
    assert away_V[-1] == 0.0
    return next(at for at, echo in echoes if echo.arms[0].voltage_V != kept_V)


def _check_instrument(
    rig: RigFile, seen: Witness, begun_at: float, ramped_at: float, kept_V: float
) -> None:
    """Check the instrument's output: the last voltage until the ramp, the safe one at the end."""
    step_V, exchange_s = output_step_V(rig), configure(rig).age.wake_s
    put_out = [
        (at, truth.arms[0].voltage_V) for at, truth in seen.since(GroundTruth, begun_at - 1.0)
    ]
    # The last command may have been output just before the ramp, or long before it.
    before = [put_V for at, put_V in put_out if at < ramped_at]
    assert min(abs(put_V - kept_V) for put_V in before[-3:]) <= step_V
    frozen = [put_V for at, put_V in put_out if begun_at < at < ramped_at - exchange_s]
    assert all(abs(put_V - kept_V) <= step_V for put_V in frozen)
    safe_V = rig.safety.safe_V
    seen.until(
        GroundTruth, lambda truth: abs(truth.arms[0].voltage_V - safe_V) <= step_V, ramped_at, 1.0
    )
    assert abs(seen.newest(GroundTruth).arms[0].voltage_V - safe_V) <= step_V


def distribution(name: str, times_s: Sequence[float], bound_s: float, stalls_s: float) -> str:
    """Return one line about the distribution of some times."""
    least, middle, most = min(times_s), median(times_s), max(times_s)
    return (
        f"{name:<34} {len(times_s):>3} times  min {1e3 * least:5.1f}  median {1e3 * middle:5.1f}  "
        f"max {1e3 * most:5.1f}  limit {1e3 * bound_s:5.1f} ms"
        f"  (longest stalls {1e3 * stalls_s:.1f} ms)"
    )
