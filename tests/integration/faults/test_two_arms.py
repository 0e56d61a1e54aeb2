"""Kill, hang and cut of every program, and of each instrument of either arm, in virtual time.

After any fault of a rig with two arms, both are frozen or released together: in the same tick by
the actuator, and by the outputs' own watchdogs if the actuator, or one output, is lost.
"""

from functools import cache

import pytest

from pincette.core.messages import Applied, Telemetry
from pincette.core.wording import applied_text
from tests.support.reactions import REACTION_S, SAFE_S, TRIPPED, within
from tests.support.two_arms import FORCE_MN, T, short_grip, two_arm_rig
from tests.support.virtual_loop_catalogue import ECHO_LATE_S, FATAL
from tests.support.virtual_loop_injection import Fault, part_event
from tests.support.virtual_loop_places import view_of
from tests.support.virtual_pair import ARMS, NAMES, VirtualPairLoop

FREEZE_S = 0.12
WATCHDOG_S = 0.5
"""Watchdog time of each output as its driver sets it, in s; it counts in whole ticks of 0.1 s."""
TICK_S = 0.1
ASIDE_S = TICK_S + 2.0 * T
"""Largest delay between the actions of the two outputs' watchdogs, in s."""
MOST_MN = 1.1 * FORCE_MN
STATES = {"approach": 14, "load": 8, "hold": 16}
"""Ticks after the start of the phase, by state."""
HELD = ("load", "hold")
OF_PROGRAMS = tuple(
    fault for fault in FATAL if fault.deed in ("kill", "stop") or "cut" in fault.name
)
OF_SENSORS = tuple(
    Fault(f"{target} {what}", 1, "trip", "bench", target=target, what=what)
    for target, _ in NAMES
    for what in ("off", "garbage", "over_range")
)
OF_OUTPUTS = tuple(
    Fault(f"{target} {what}", 26, "trip", "bench", target=target, what=what)
    for _, target in NAMES
    for what in ("off", "garbage")
)


@cache
def place(state: str) -> VirtualPairLoop:
    """Return a loop in a phase of the grip; it is only forked, never run."""
    rig = two_arm_rig({"safety": {"freeze_s": FREEZE_S}}, time="real")
    loop = VirtualPairLoop(rig)
    loop.run(loop.now_s + 3.0 * T)
    loop.reset()
    loop.arm(short_grip(rig), 7)

    def there() -> bool:
        view = view_of(loop)
        return view is not None and view.phase == state and view.segment_tick >= STATES[state]

    assert loop.run(loop.now_s + 10.0, there), f"{state} is not reached: {view_of(loop)}"
    assert loop.newest.part_held == (state in HELD)
    return loop


def hurt(state: str, fault: Fault, phase: float, seed: int = 1) -> tuple[VirtualPairLoop, float]:
    """Return a fork of the loop with the fault, and the time of the fault."""
    loop = place(state).fork(seed)
    loop.run(loop.now_s + phase * T)
    part_event(loop, fault)
    return loop, loop.now_s


def check_together(loop: VirtualPairLoop, since_s: float, said: str) -> None:
    """Check that from a time on both voltages change at the same instants, to the safe one, and
    never back."""
    moved = [put for put in loop.voltages_put_out if put[0] > since_s]
    ways = [[(at_s, abs(voltage_V)) for at_s, arm, voltage_V in moved if arm == of] for of in ARMS]
    assert [at_s for at_s, _ in ways[0]] == [at_s for at_s, _ in ways[1]], said
    for way in ways:
        away_V = [voltage_V for _, voltage_V in way]
        assert away_V == sorted(away_V, reverse=True), f"{said}: the ramp turned back"
        assert away_V[-1] == 0.0, f"{said}: {away_V[-1]} V away from the safe voltage"


def check_force(loop: VirtualPairLoop, said: str) -> None:
    """Check that no arm presses harder than planned."""
    assert max(loop.pair.true.forces_mN) <= MOST_MN, f"{said}: {loop.pair.true}"


def check_trips(state: str, fault: Fault, phase: float) -> None:
    """Check that the loop trips in time, and that both arms freeze and ramp together."""
    loop, began_s = hurt(state, fault, phase)
    stated, held = f"{fault.name} in {state} at {phase:.2f} T", state in HELD
    late_s = fault.late_s
    over_s = began_s + SAFE_S + late_s + (FREEZE_S + 2.0 * T if held else 0.0)
    while loop.newest.state != "latched" and loop.now_s < over_s:
        loop.run(loop.now_s + T)
        check_force(loop, stated)
    tripped = [(at_s, echo) for at_s, echo in loop.applied if echo.state in TRIPPED]
    assert tripped, f"no trip by {stated}: {loop.newest}"
    reacted_s = tripped[0][0]
    within(REACTION_S + late_s, reacted_s - began_s, f"{stated}: the reaction")
    assert loop.newest.state == "latched", f"{stated}: {loop.newest}"
    frozen = [echo for _, echo in tripped if echo.state == "frozen"]
    assert bool(frozen) == held, stated
    assert len({voltages(echo) for echo in frozen}) <= 1, f"{stated}: a frozen voltage moved"
    assert voltages(loop.newest) == (0.0, 0.0)
    loop.run(loop.now_s + 0.1)
    check_together(loop, reacted_s, stated)
    assert not any(echo.answered for at_s, echo in loop.applied if at_s >= reacted_s), stated
    assert loop.pair.true.forces_mN == (0.0, 0.0)


def voltages(echo: Applied) -> tuple[float, float]:
    """Voltages of both arms."""
    assert len(echo.arms) == 2
    return echo.arms[0].voltage_V, echo.arms[1].voltage_V


def first_safe_s(loop: VirtualPairLoop, since_s: float) -> list[float]:
    """Return the time at which each arm's output reached the safe voltage."""
    put_out = [put for put in loop.voltages_put_out if put[0] > since_s]
    return [next(at_s for at_s, of, u in put_out if (of, u) == (arm, 0.0)) for arm in ARMS]


def test_a_grip_with_both_arms_without_a_fault_succeeds() -> None:
    loop = place("hold").fork(1)
    assert loop.run(loop.now_s + 5.0, lambda: loop.newest.final)
    views = [message for _, message in loop.told or [] if isinstance(message, Telemetry)]
    assert (views[-1].outcome, loop.newest.state) == ("gripped", "idle")
    assert loop.pair.true.forces_mN == (0.0, 0.0)
    # Both arms have carried the part, and it lies where they released it.
    assert [event.what for event in loop.pair.true.events] == ["landed"]


@pytest.mark.parametrize("state", STATES)
def test_both_arms_freeze_or_open_together_after_any_fault_of_a_program(state: str) -> None:
    for number, fault in enumerate(OF_PROGRAMS):
        check_trips(state, fault, (0.37 * number + 0.05) % 1.0)


@pytest.mark.parametrize("state", STATES)
def test_a_lost_sensor_of_either_arm_stops_both_arms(state: str) -> None:
    for number, fault in enumerate(OF_SENSORS):
        # The loop waits for the missing sensor within the tick, so the echo of the tick is later.
        check_trips(state, fault, (0.29 * number + 0.1) % 1.0)


@pytest.mark.parametrize("fault", OF_OUTPUTS, ids=[fault.name for fault in OF_OUTPUTS])
@pytest.mark.parametrize("state", STATES)
def test_a_failing_output_of_one_arm_also_stops_the_other_arm(state: str, fault: Fault) -> None:
    """The output that does not confirm its voltage is left to its watchdog, and the other to its
    own."""
    loop, began_s = hurt(state, fault, 0.4)
    while loop.now_s < began_s + WATCHDOG_S + 6.0 * TICK_S:
        loop.run(loop.now_s + T)
        check_force(loop, fault.name)
    trip = next(echo for _, echo in loop.applied if echo.state in TRIPPED)
    arm = "second" if fault.target.startswith("second") else "first"
    assert (trip.cause, trip.state) == ("device", "frozen" if state in HELD else "ramping")
    assert f"{arm} arm: " in applied_text(trip), applied_text(trip)
    let_go_s = first_safe_s(loop, began_s)
    assert abs(let_go_s[0] - let_go_s[1]) <= ASIDE_S, let_go_s
    assert loop.pair.true.forces_mN == (0.0, 0.0)
    # Until then neither moves, since a write to an output that does not respond would move the
    # other alone.
    after_s = next(at_s for at_s, echo in loop.applied if echo.state in TRIPPED)
    assert [put for put in loop.voltages_put_out if after_s < put[0] < min(let_go_s)] == []


@pytest.mark.parametrize("deed", ["kill", "stop"])
@pytest.mark.parametrize("state", STATES)
def test_both_outputs_release_by_their_watchdogs_if_the_actuator_is_dead(
    state: str, deed: str
) -> None:
    fault = Fault(f"actuator {deed}", 10, "trip", "kill", "actuator")
    if deed == "stop":
        fault = Fault(f"actuator {deed}", 17, "trip", "stop", "actuator", for_s=10.0)
    loop, began_s = hurt(state, fault, 0.6)
    while loop.now_s < began_s + WATCHDOG_S + 3.0 * TICK_S:
        loop.run(loop.now_s + T)
        check_force(loop, fault.name)
    let_go_s = first_safe_s(loop, began_s)
    assert max(let_go_s) - began_s <= WATCHDOG_S + TICK_S
    assert abs(let_go_s[0] - let_go_s[1]) <= ASIDE_S
    assert loop.pair.true.forces_mN == (0.0, 0.0)


def test_a_permanent_loss_of_applied_voltage_messages_trips_both_arms() -> None:
    assert {fault.late_s for fault in OF_PROGRAMS} <= {0.0, ECHO_LATE_S}
