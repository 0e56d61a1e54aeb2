"""Playing a program: references, guards, actions, in ticks."""

import pytest
from msgspec.structs import replace

from pincette.control.planning.segments import Press
from pincette.core.faults import Fault, FaultCode
from pincette_controller.actions import release, stop
from pincette_controller.player import advance, begin

from .ideal_arm import BLANK, K_E, PROGRAM, SWING, TRACK, Arm, T, line_of

TWO_GRIPS = replace(
    PROGRAM,
    segments=(
        *PROGRAM.segments[:4],
        Press("settle", 0.4),
        *PROGRAM.segments[5:],
        *PROGRAM.segments,
    ),
)


def test_a_grip_goes_through_every_phase_and_ends_gripped() -> None:
    arm = Arm()
    arm.until()
    assert arm.phases == ["zero", "approach", "contact", "load", "hold", "unload", "retreat"]
    assert arm.player.outcome == "gripped"
    assert arm.player.ref.x_um == pytest.approx(0.0)
    assert not arm.player.held


def test_a_program_of_two_grips_fits_the_contact_line_of_each() -> None:
    arm = Arm(program=TWO_GRIPS)
    arm.until("retreat")
    arm.contact_um, arm.stiffness = 11.5, 1.8
    arm.until("hold")
    assert arm.phases.count("load") == 2
    assert line_of(arm.player) == pytest.approx((11.5, 1.8))


@pytest.mark.parametrize(
    ("phase", "change", "outcome", "back"),
    [
        ("contact", {"contact_um": 99.0}, "no_contact", ["contact", "retreat"]),
        ("load", {"stiffness": 0.5}, "wrong_stiffness", ["load", "unload", "retreat"]),
        ("settle", {"lost": True}, "lost", ["settle", "retreat"]),
    ],
)
def test_a_failure_in_the_first_of_two_grips_prevents_the_second(
    phase: str, change: dict[str, float], outcome: str, back: list[str]
) -> None:
    arm = Arm(program=TWO_GRIPS)
    arm.until(phase)
    for name, value in change.items():
        setattr(arm, name, value)
    arm.until()
    assert (arm.player.outcome, arm.phases[-len(back) :]) == (outcome, back)
    assert arm.phases.count("contact") == 1


def test_during_the_hold_position_and_force_agree_on_the_fitted_line() -> None:
    arm = Arm(contact_um=11.5, stiffness=1.8)
    arm.until("hold")
    for _ in range(12):
        arm.tick()
    player = arm.player
    assert line_of(player).K_e_mN_per_um == pytest.approx(1.8)
    assert line_of(player).x_e_um == pytest.approx(11.5)
    assert player.ref.force_mN == pytest.approx(20.0)
    assert player.ref.x_um == pytest.approx(11.5 + 20.0 / 1.8)


def test_references_never_jump() -> None:
    arm = Arm()
    previous = arm.player
    while not arm.player.ended:
        arm.tick()
        step_um = abs(arm.player.ref.x_um - previous.ref.x_um)
        step_mN = abs(arm.player.ref.force_mN - previous.ref.force_mN)
        # The peak speed of the quintic over the longest move, 12 µm in 0.4 s.
        assert step_um < 15 / 8 * 12.0 / 0.4 * T
        # F_r is blended in from the force at contact, and ends with the pressing.
        assert step_mN < 2.0 or isinstance(arm.player.segment, Press) != (
            isinstance(previous.segment, Press)
        )
        previous = arm.player


def test_part_is_held_from_contact_to_the_end_of_the_unload() -> None:
    arm = Arm()
    held: set[str] = set()
    while not arm.player.ended:
        arm.tick()
        if arm.player.held:
            held.add(arm.player.segment.phase)
    assert held == {"load", "hold", "unload"}


def test_without_a_part_the_outcome_is_no_contact() -> None:
    arm = Arm(contact_um=99.0)
    arm.until()
    assert arm.player.outcome == "no_contact"
    assert arm.phases[-1] == "retreat"


@pytest.mark.parametrize("stiffness", [1.2, 3.0])
def test_a_part_whose_stiffness_may_be_right_within_the_uncertainty_is_held(
    stiffness: float,
) -> None:
    arm = Arm(stiffness=stiffness)
    arm.uncertainty_mN = 8.0
    arm.until()
    assert arm.player.outcome == "gripped"


@pytest.mark.parametrize("stiffness", [1.2, 3.0])
def test_a_part_of_another_stiffness_is_released(stiffness: float) -> None:
    arm = Arm(stiffness=stiffness)
    arm.until()
    assert arm.player.outcome == "wrong_stiffness"
    assert "hold" not in arm.phases
    assert line_of(arm.player).K_e_mN_per_um == pytest.approx(stiffness)


def test_a_held_part_is_not_dropped_because_its_force_has_become_uncertain() -> None:
    arm = Arm()
    arm.until("hold")
    arm.uncertainty_mN = 60.0
    arm.tick()
    assert (arm.player.segment.phase, arm.player.outcome) == ("hold", "")


def test_a_grip_ends_before_contact_if_its_uncertainty_equals_the_requested_force() -> None:
    arm = Arm()
    arm.until("contact")
    arm.uncertainty_mN = 20.0
    arm.tick()
    assert arm.player.outcome == "uncertain_force"
    assert arm.player.segment.phase == "retreat"
    assert not arm.player.held


def test_a_load_ends_when_the_force_uncertainty_equals_the_requested_force() -> None:
    arm = Arm()
    arm.until("load")
    arm.uncertainty_mN = 20.0
    arm.tick()
    assert (arm.player.segment.phase, arm.player.outcome) == ("unload", "uncertain_force")
    assert line_of(arm.player).K_e_mN_per_um == K_E


def test_a_lost_part_ends_the_hold_after_five_samples() -> None:
    arm = Arm()
    arm.until("hold")
    arm.lost = True
    for _ in range(4):
        arm.tick()
    assert arm.player.segment.phase == "hold"
    arm.tick()
    assert (arm.player.segment.phase, arm.player.outcome) == ("retreat", "lost")
    assert not arm.player.held


def test_too_much_force_ends_the_grip_at_once() -> None:
    arm = Arm()
    arm.until("hold")
    strong = replace(arm.estimate(), force_mN=40.1)
    player = advance(PROGRAM, arm.player, (strong,), T)
    assert (player.segment.phase, player.outcome, player.held) == ("retreat", "overforce", False)


def test_a_refused_zero_ends_the_program() -> None:
    arm = Arm()
    arm.refusal = Fault(FaultCode.ZERO_NOT_SETTLED)
    arm.until()
    assert arm.player.outcome == "zero_refused"
    assert arm.phases == ["zero", "retreat"]


def test_an_arm_that_is_pushed_back_by_a_part_is_not_moved_towards_it() -> None:
    arm = Arm(contact_um=-9.0)
    arm.player = begin(PROGRAM, (replace(BLANK, x_um=-4.0),), period_s=T)
    arm.refusal = Fault(FaultCode.ZERO_OFFSET)
    furthest_um = -4.0
    while not arm.player.ended:
        arm.tick()
        furthest_um = max(furthest_um, arm.player.ref.x_um)
    assert arm.player.outcome == "zero_refused"
    assert furthest_um == pytest.approx(-4.0)


def test_an_unconfirmed_zero_ends_the_program() -> None:
    player = begin(PROGRAM, (BLANK,), T)
    for _ in range(200):
        player = advance(PROGRAM, player, (BLANK,), T)
    assert player.outcome == "zero_refused"


def awaiting_zero() -> Arm:
    arm = Arm()
    while not arm.player.zero:
        arm.tick()
    return arm


def test_a_zero_that_was_not_taken_is_requested_again() -> None:
    arm = awaiting_zero()
    waiting = advance(PROGRAM, arm.player, (replace(arm.estimate(), zero_age_s=None),), T)
    assert (waiting.zero, waiting.segment.phase) == (True, "zero")
    assert waiting.ref == arm.player.ref
    after = advance(PROGRAM, waiting, (arm.estimate(),), T)
    assert (after.zero, after.segment.phase) == (False, "approach")


def test_no_zero_is_requested_on_the_return_from_too_much_force() -> None:
    arm = awaiting_zero()
    player = advance(PROGRAM, arm.player, (replace(arm.estimate(), force_mN=40.1),), T)
    phases: set[str] = set()
    while not player.ended:
        assert not player.zero
        phases.add(player.segment.phase)
        player = advance(PROGRAM, player, (BLANK,), T)
    assert phases == {"retreat"}
    assert player.outcome == "overforce"


@pytest.mark.parametrize("phase", ["load", "hold", "unload"])
def test_a_stop_with_a_part_keeps_the_force_until_release(phase: str) -> None:
    arm = Arm()
    arm.until(phase)
    arm.tick()
    force_mN = arm.player.ref.force_mN
    arm.player = stop(arm.player)
    for _ in range(200):
        arm.tick()
    assert arm.player.held
    assert arm.player.segment.phase == ("hold" if phase == "hold" else "stopped")
    assert arm.player.ref.force_mN == pytest.approx(force_mN)
    arm.player = release(PROGRAM, arm.player)
    arm.until()
    assert arm.phases[-2:] == ["unload", "retreat"]
    assert (arm.player.outcome, arm.player.held) == ("stopped", False)


def test_a_stop_without_a_part_comes_to_rest_and_ends() -> None:
    arm = Arm()
    arm.until("approach")
    for _ in range(8):
        arm.tick()
    speed = arm.player.ref.speed_um_per_s
    at_um = arm.player.ref.x_um
    arm.player = stop(arm.player)
    arm.until()
    assert arm.player.outcome == "stopped"
    assert at_um < arm.player.ref.x_um < at_um + 0.3 * speed


def test_a_track_goes_through_every_phase_and_ends_tracked() -> None:
    arm = Arm(program=TRACK)
    arm.until()
    assert arm.phases[3:] == ["load", "settle", "track", "unload", "retreat"]
    assert arm.player.outcome == "tracked"
    assert not arm.player.held


def test_on_the_path_the_position_and_force_references_lie_on_the_identified_line() -> None:
    arm = Arm(contact_um=11.5, stiffness=1.8, program=TRACK)
    arm.until("track")
    assert line_of(arm.player).K_e_mN_per_um == pytest.approx(1.8)
    forces: list[float] = []
    while arm.player.segment.phase == "track":
        player = arm.player
        assert player.segment.presses
        assert player.ref.force_mN == SWING.at(player.ticks * T)
        assert player.ref.x_um == pytest.approx(11.5 + player.ref.force_mN / 1.8)
        forces.append(player.ref.force_mN)
        arm.tick()
    assert len(forces) == round(SWING.duration_s / T)
    assert (min(forces), max(forces)) == pytest.approx((2.0, 18.0), abs=0.1)


def test_a_part_may_be_lost_at_the_peak_of_a_path_but_not_at_its_trough() -> None:
    arm = Arm(program=TRACK)
    arm.until("track")
    while arm.player.ref.force_mN > 2.1:
        arm.tick()
    arm.lost = True
    arm.tick()
    lost_at = None
    for tick in range(40):
        if arm.player.outcome == "lost":
            lost_at = tick
            break
        arm.tick()
    assert lost_at is not None
    # Not before F_r is 4 mN again, twice the contact force.
    assert lost_at >= 5
    assert arm.player.segment.phase == "retreat"


def test_a_stop_along_a_path_keeps_the_force() -> None:
    arm = Arm(program=TRACK)
    arm.until("track")
    for _ in range(30):
        arm.tick()
    force_mN = arm.player.ref.force_mN
    arm.player = stop(arm.player)
    for _ in range(50):
        arm.tick()
    assert (arm.player.segment.phase, arm.player.outcome) == ("stopped", "stopped")
    assert arm.player.ref.force_mN == pytest.approx(force_mN)
    arm.player = release(TRACK, arm.player)
    arm.until()
    assert arm.phases[-2:] == ["unload", "retreat"]
