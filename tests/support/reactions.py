"""How the actuator reacted to a fault, as seen from outside, held against its bounds."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from pincette.config import RigFile
from pincette.messages import Applied, Truth
from tests.support.stalls import StallRecorder
from tests.support.witness import Witness

TRIPPED = ("frozen", "ramping")
REACTION_S = 0.060
"""From the fault to the freeze, or to the first step of the ramp: T = 20 ms."""
SAFE_S = 0.100
"""From the fault to the safe voltage with the arm free."""
WAKE_PERIODS = 0.25
"""How often the actuator lets time pass, and so the step of a ramp."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """Times since the fault, and the stalls of the machine until each."""

    reaction_s: float
    reaction_stalls_s: float
    safe_s: float
    safe_stalls_s: float
    cause: str


def within(bound_s: float, took_s: float, stalls_s: float, what: str) -> None:
    """Fail where a bound is exceeded by more than the machine stood still meanwhile."""
    assert took_s <= bound_s + stalls_s, (
        f"{what} took {1e3 * took_s:.1f} ms, limit {1e3 * bound_s:.0f} ms, "
        f"stalls of the machine {1e3 * stalls_s:.1f} ms"
    )


def await_reaction(
    rig: RigFile, seen: Witness, stalls: StallRecorder, fault_s: float, *, held: bool
) -> Reaction:
    """Wait until the actuator is safe, and check how it came to be.

    Held: the voltage of the last good command is kept exactly for ``freeze_s``, then ramped.
    Free: it is ramped at once.
    """
    safe_at, _ = seen.until_state(("latched",), fault_s)
    echoes = seen.since(Applied, fault_s)
    tripped = [(at, echo) for at, echo in echoes if echo.state in TRIPPED]
    taken = [echo for _, echo in seen.since(Applied, fault_s - 1.0) if echo.state == "armed"]
    kept_V, (begun_at, first) = taken[-1].voltage_V, tripped[0]
    ramp = [(at, echo) for at, echo in echoes if echo.state in ("ramping", "latched")]
    assert first.state == ("frozen" if held else "ramping")
    for _, echo in tripped:
        if echo.state == "frozen":
            assert echo.voltage_V == kept_V
    _check_ramp(rig, [echo.voltage_V for _, echo in ramp], kept_V)
    if held:
        moved_at = ramp[0][0]
        step_s = WAKE_PERIODS * rig.rig.period_s
        frozen_s, stood_s = moved_at - begun_at, stalls.between(begun_at, moved_at)
        assert frozen_s >= rig.safety.freeze_s - step_s - stood_s
        within(rig.safety.freeze_s + 2 * step_s, frozen_s, stood_s, "the freeze")
    ramped_at = ramp[0][0]
    ramped_s, ramp_stalls_s = safe_at - ramped_at, stalls.between(ramped_at, safe_at)
    within(SAFE_S - REACTION_S, ramped_s, ramp_stalls_s, "the ramp")
    _check_instrument(rig, seen, begun_at, ramped_at, kept_V, held=held)
    return Reaction(
        begun_at - fault_s,
        stalls.between(fault_s, begun_at),
        safe_at - fault_s,
        stalls.between(fault_s, safe_at),
        first.cause,
    )


def _check_ramp(rig: RigFile, voltages_V: Sequence[float], kept_V: float) -> None:
    safe_V = rig.safety.safe_V
    away_V = [abs(voltage_V - safe_V) for voltage_V in (kept_V, *voltages_V)]
    assert away_V == sorted(away_V, reverse=True), "the ramp turned back"
    assert voltages_V[-1] == safe_V


def _check_instrument(
    rig: RigFile, seen: Witness, begun_at: float, ramped_at: float, kept_V: float, *, held: bool
) -> None:
    """What the instrument put out: the same while frozen, and the safe voltage in the end."""
    assert rig.simulation is not None
    step_V = rig.simulation.output_step_V
    if held:
        before = seen.since(Truth, begun_at - 1.0)
        frozen_V = [truth.voltage_V for at, truth in before if at < ramped_at - 0.002]
        assert abs(frozen_V[-1] - kept_V) <= step_V
        assert not [at for at, _ in before if begun_at < at < ramped_at - 0.01]
    _, last = seen.until(
        Truth, lambda truth: abs(truth.voltage_V - rig.safety.safe_V) <= step_V, ramped_at, 1.0
    )
    assert abs(last.voltage_V - rig.safety.safe_V) <= step_V


def distribution(name: str, times_s: Sequence[float], bound_s: float, stalls_s: float) -> str:
    """One line about some times."""
    least, middle, most = min(times_s), median(times_s), max(times_s)
    return (
        f"{name:<34} {len(times_s):>3} times  min {1e3 * least:5.1f}  median {1e3 * middle:5.1f}  "
        f"max {1e3 * most:5.1f}  limit {1e3 * bound_s:5.1f} ms"
        f"  (longest stalls {1e3 * stalls_s:.1f} ms)"
    )
