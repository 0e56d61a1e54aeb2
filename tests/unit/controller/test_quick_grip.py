"""A quick grip: through the contact without a stop, and along the contact line as it is
identified."""

from itertools import pairwise

import pytest
from msgspec.structs import replace

from pincette.control.planning.program import Program
from pincette.control.planning.segments import Move, Press
from pincette_controller.actions import pause, resume, stop
from pincette_controller.touching import load_rate

from .bench import ARM, X_E_UM, Bench, program
from .ideal_arm import K_E, PROGRAM, TRACK, Arm, T, line_of

SPEED = 40.0
LOAD = 3


def quick(from_: Program = PROGRAM, load_s: float = 0.36) -> Program:
    """Return the grip of the other tests as a quick one: 40 µm/s until the contact."""
    zero, approach, contact, load, *others = from_.segments
    return replace(
        from_,
        segments=(
            zero,
            replace(approach, guarded=True),
            replace(contact, to_um=(18.0,), duration_s=8.0 / SPEED + 0.05, run_up_s=0.1),
            replace(load, duration_s=load_s, follows=True),
            *others,
        ),
    )


QUICK = quick()


def test_a_quick_grip_goes_through_every_phase_and_ends_gripped() -> None:
    arm = Arm(program=QUICK)
    arm.until()
    assert arm.phases == ["zero", "approach", "contact", "load", "hold", "unload", "retreat"]
    assert arm.player.outcome == "gripped"


def test_the_load_starts_no_faster_than_the_seek_and_ends_at_rest() -> None:
    arm = Arm(program=QUICK)
    arm.until("load")
    touch, x_um = arm.player, [arm.player.entry.ref.x_um, arm.player.ref.x_um]
    assert touch.entry.ref.force_rate_mN_per_s == pytest.approx(K_E * SPEED)
    forces_mN = [touch.entry.ref.force_mN, touch.ref.force_mN]
    while arm.player.segment.phase == "load":
        arm.tick()
        x_um.append(arm.player.ref.x_um)
        forces_mN.append(arm.player.ref.force_mN)
    rates = [(b - a) / T for a, b in pairwise(x_um)]
    # On the line of the stiffest part, three times as stiff as the planned one.
    assert rates[0] == pytest.approx(SPEED / 3.0, rel=0.02)
    # It catches up if the part turns out to be softer.
    assert max(rates) < 1.7 * SPEED
    assert rates[-2] < 0.05 * SPEED
    assert max(forces_mN) <= 20.0 + 1e-9
    assert arm.estimate().force_mN <= 20.0 + 1e-9


@pytest.mark.parametrize("program", [PROGRAM, QUICK, TRACK], ids=["gentle", "quick", "track"])
@pytest.mark.parametrize("share", [0.5, 0.8, 1.0, 1.2, 2.0, 3.0])
def test_the_references_of_a_load_assume_at_least_the_stiffness_of_the_part(
    program: Program, share: float
) -> None:
    stiffness = share * K_E
    arm = Arm(stiffness=stiffness, contact_um=11.0, program=program)
    arm.until("load")
    assert line_of(arm.player).K_e_mN_per_um == pytest.approx(3.0 * K_E)
    while arm.player.segment.phase == "load":
        player = arm.player
        line = line_of(player)
        assert line.K_e_mN_per_um >= stiffness * (1.0 - 1e-6)
        if program is QUICK:
            on_line_um = line.x_e_um + player.ref.force_mN / line.K_e_mN_per_um
            assert player.ref.x_um == pytest.approx(on_line_um)
        assert arm.estimate().force_mN <= 20.0 + 1e-6
        if player.ticks * T > 0.2:
            assert line.K_e_mN_per_um == pytest.approx(stiffness, rel=0.01)
            assert line.x_e_um == pytest.approx(11.0, abs=0.05)
        arm.tick()


@pytest.mark.parametrize("stiffness", [0.5 * K_E, 2.0 * K_E])
def test_a_part_far_from_the_plan_is_loaded_as_planned_and_released(stiffness: float) -> None:
    arm = Arm(stiffness=stiffness, program=QUICK)
    forces_mN: list[float] = []
    while not arm.player.ended:
        arm.tick()
        forces_mN.append(arm.estimate().force_mN)
    assert max(forces_mN) < 21.0
    assert arm.player.outcome == "wrong_stiffness"
    assert "hold" not in arm.phases


def test_the_rate_of_the_load_does_not_overshoot_its_end() -> None:
    load = QUICK.segments[LOAD]
    assert isinstance(load, Press)
    assert load_rate(load, 4.0, 80.0) == 80.0
    assert load_rate(load, 12.0, 80.0) == pytest.approx(2.5 * 8.0 / 0.36)
    assert load_rate(load, 21.0, 80.0) == 0.0


def test_a_pause_at_the_touch_waits_for_the_end_of_the_load() -> None:
    arm = Arm(program=QUICK)
    arm.until("load")
    arm.player = pause(arm.player)
    for _ in range(30):
        arm.tick()
    assert arm.player.pause.active
    assert arm.player.segment.phase == "load"
    assert arm.player.ref.force_mN == pytest.approx(20.0)
    arm.player = resume(arm.player)
    arm.until()
    assert arm.player.outcome == "gripped"


def test_a_stop_during_the_load_holds_the_present_force() -> None:
    arm = Arm(program=QUICK)
    arm.until("load")
    for _ in range(4):
        arm.tick()
    force_mN = arm.estimate().force_mN
    arm.player = stop(arm.player)
    for _ in range(40):
        arm.tick()
        assert arm.estimate().force_mN == pytest.approx(force_mN, abs=0.5)
    assert arm.player.held
    assert arm.player.segment.phase == "stopped"


@pytest.mark.parametrize("contact_um", [2.0, 5.0, 8.0])
def test_a_part_nearer_than_planned_is_detected_on_the_approach(contact_um: float) -> None:
    arm = Arm(contact_um=contact_um, program=QUICK)
    forces_mN: list[float] = []
    while not arm.player.ended:
        arm.tick()
        forces_mN.append(arm.estimate().force_mN)
    assert arm.player.outcome == "contact"
    assert arm.phases == ["zero", "approach", "retreat"]
    # Share of the planned 20 mN.
    assert max(forces_mN) < 12.0
    assert forces_mN[-1] == 0.0


def test_a_slowly_growing_force_on_the_approach_is_not_detected_as_a_part() -> None:
    """The force that the free response causes may be wrong by more than stated, but changes
    slowly."""
    arm = Arm(program=QUICK)
    arm.until("approach")
    begun = arm.seq
    plain = arm.estimate

    def drifting() -> object:
        found = plain()
        if not isinstance(arm.player.segment, Move) or found.zero_age_s is None:
            return found
        return replace(found, force_mN=found.force_mN + 0.15 * (arm.seq - begun))

    arm.estimate = drifting  # type: ignore[method-assign, assignment]
    arm.until("contact")
    assert arm.player.outcome == ""


def test_the_voltage_of_the_law_has_no_jump_at_a_touch() -> None:
    """The controller's step with an arm that satisfies (4): the voltage continues to rise as
    before."""
    bench = Bench(quick(program()))
    bench.until("load")
    touch = len(bench.ticks)
    before_V = (
        bench.ticks[-1].estimate.arms[0].applied_V - bench.ticks[-2].estimate.arms[0].applied_V
    )
    bench.until("hold")
    voltages_V = [tick.command.arms[0].voltage_V for tick in bench.ticks[touch - 3 :]]
    steps_V = [b - a for a, b in pairwise(voltages_V)]
    # Free, x = d_p·u; in contact u rises by 1 + s_p·K_e as much for the same speed.
    most_V = SPEED * T / 19.0 * (1.0 + 0.46 * K_E)
    assert before_V > 0.0
    assert min(steps_V[:6]) > 0.0
    assert max(steps_V) < 1.35 * most_V
    assert bench.ticks[-1].estimate.arms[0].force_mN == pytest.approx(20.0, abs=0.3)
    assert bench.ticks[-1].estimate.arms[0].x_um == pytest.approx(X_E_UM + 10.0, abs=0.2)
    assert ARM.k > 0.0
