"""Playing a program: references, guards, actions, in ticks."""

import pytest
from msgspec.structs import replace

from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.program import Segment
from pincette.core.faults import Fault, FaultCode
from pincette_controller.actions import release, stop
from pincette_controller.player import advance, begin

from .ideal_arm import BLANK, PROGRAM, SWING, TRACK, Arm, T


def test_a_grip_goes_through_every_phase_and_ends_gripped() -> None:
    arm = Arm()
    arm.until()
    assert arm.phases == ["zero", "approach", "contact", "load", "hold", "unload", "retreat"]
    assert arm.player.outcome == "gripped"
    assert arm.player.x_r_um == pytest.approx(0.0)
    assert not arm.player.held


def test_in_the_hold_position_and_force_agree_on_the_fitted_line() -> None:
    arm = Arm(contact_um=11.5, stiffness=1.8)
    arm.until("hold")
    for _ in range(12):
        arm.tick()
    player = arm.player
    assert player.K_e_mN_per_um == pytest.approx(1.8)
    assert player.contact_x_um == pytest.approx(11.5)
    assert player.force_r_mN == pytest.approx(20.0)
    assert player.x_r_um == pytest.approx(11.5 + 20.0 / 1.8)


def test_references_never_jump() -> None:
    arm = Arm()
    previous = arm.player
    while not arm.player.ended:
        arm.tick()
        step_um = abs(arm.player.x_r_um - previous.x_r_um)
        step_mN = abs(arm.player.force_r_mN - previous.force_r_mN)
        # The peak speed of the quintic over the longest move, 12 µm in 0.4 s.
        assert step_um < 15 / 8 * 12.0 / 0.4 * T
        # F_r is blended in from the force at contact, and ends with the pressing.
        assert step_mN < 2.0 or (arm.player.segment.kind == "force") != (
            previous.segment.kind == "force"
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
def test_a_stiffness_that_may_be_right_within_the_uncertainty_is_held(stiffness: float) -> None:
    arm = Arm(stiffness=stiffness)
    arm.uncertainty_mN = 8.0
    arm.until()
    assert arm.player.outcome == "gripped"


@pytest.mark.parametrize("stiffness", [1.2, 3.0])
def test_a_part_of_another_stiffness_is_let_go(stiffness: float) -> None:
    arm = Arm(stiffness=stiffness)
    arm.until()
    assert arm.player.outcome == "wrong_stiffness"
    assert "hold" not in arm.phases
    assert arm.player.K_e_mN_per_um == pytest.approx(stiffness)


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
    player = advance(PROGRAM, arm.player, strong, T)
    assert (player.segment.phase, player.outcome, player.held) == ("retreat", "overforce", False)


def test_a_refused_zero_ends_the_program() -> None:
    arm = Arm()
    arm.refusal = Fault(FaultCode.ZERO_NOT_SETTLED)
    arm.until()
    assert arm.player.outcome == "zero_refused"
    assert arm.phases == ["zero", "retreat"]


def test_a_zero_that_nobody_confirms_ends_the_program() -> None:
    player = begin(PROGRAM, 0.0)
    for _ in range(200):
        player = advance(PROGRAM, player, BLANK, T)
    assert player.outcome == "zero_refused"


@pytest.mark.parametrize("phase", ["load", "hold", "unload"])
def test_stop_with_a_part_keeps_the_force_until_release(phase: str) -> None:
    arm = Arm()
    arm.until(phase)
    arm.tick()
    force_mN = arm.player.force_r_mN
    arm.player = stop(arm.player)
    for _ in range(200):
        arm.tick()
    assert arm.player.held
    assert arm.player.segment.phase == "hold"
    assert arm.player.force_r_mN == pytest.approx(force_mN)
    arm.player = release(PROGRAM, arm.player)
    arm.until()
    assert arm.phases[-2:] == ["unload", "retreat"]
    assert (arm.player.outcome, arm.player.held) == ("stopped", False)


def test_stop_without_a_part_comes_to_rest_and_ends() -> None:
    arm = Arm()
    arm.until("approach")
    for _ in range(8):
        arm.tick()
    speed = arm.player.speed_um_per_s
    at_um = arm.player.x_r_um
    arm.player = stop(arm.player)
    arm.until()
    assert arm.player.outcome == "stopped"
    assert at_um < arm.player.x_r_um < at_um + 0.3 * speed


def test_a_track_goes_through_every_phase_and_ends_tracked() -> None:
    arm = Arm(program=TRACK)
    arm.until()
    assert arm.phases[3:] == ["load", "settle", "track", "unload", "retreat"]
    assert arm.player.outcome == "tracked"
    assert not arm.player.held


def test_along_the_path_position_and_force_agree_on_the_identified_line() -> None:
    arm = Arm(contact_um=11.5, stiffness=1.8, program=TRACK)
    arm.until("track")
    assert arm.player.K_e_mN_per_um == pytest.approx(1.8)
    forces: list[float] = []
    while arm.player.segment.phase == "track":
        player = arm.player
        assert player.pressing
        assert player.force_r_mN == SWING.at(player.ticks * T)
        assert player.x_r_um == pytest.approx(11.5 + player.force_r_mN / 1.8)
        forces.append(player.force_r_mN)
        arm.tick()
    assert len(forces) == round(SWING.duration_s / T)
    assert (min(forces), max(forces)) == pytest.approx((2.0, 18.0), abs=0.1)


def test_at_its_trough_a_path_loses_no_part_but_at_its_peak_it_may() -> None:
    arm = Arm(program=TRACK)
    arm.until("track")
    while arm.player.force_r_mN > 2.1:
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
    # Not before F_r is at 4 mN again, twice the contact force.
    assert lost_at >= 5
    assert arm.player.segment.phase == "retreat"


def test_stop_along_a_path_keeps_the_force() -> None:
    arm = Arm(program=TRACK)
    arm.until("track")
    for _ in range(30):
        arm.tick()
    force_mN = arm.player.force_r_mN
    arm.player = stop(arm.player)
    for _ in range(50):
        arm.tick()
    assert (arm.player.segment.phase, arm.player.outcome) == ("hold", "stopped")
    assert arm.player.force_r_mN == pytest.approx(force_mN)
    arm.player = release(TRACK, arm.player)
    arm.until()
    assert arm.phases[-2:] == ["unload", "retreat"]


def test_a_path_of_position_is_played_free_of_contact() -> None:
    swing = sinusoid("position", 5.0, 4.0, 2.0, 1)
    program = replace(
        PROGRAM,
        segments=(
            Segment("approach", "free", 0.4, x_to_um=5.0),
            Segment("track", "path", swing.duration_s, path=swing),
        ),
    )
    arm = Arm(contact_um=99.0, program=program)
    arm.until("track")
    seen: list[float] = []
    while not arm.player.ended:
        assert not arm.player.pressing
        assert arm.player.x_r_um == swing.at(arm.player.ticks * T)
        seen.append(arm.player.x_r_um)
        arm.tick()
    assert (min(seen), max(seen)) == pytest.approx((3.0, 7.0), abs=0.05)
    # Stopped on the way, the reference runs out instead of standing still at once.
    arm = Arm(contact_um=99.0, program=program)
    arm.until("track")
    for _ in range(27):
        arm.tick()
    speed, at_um = arm.player.speed_um_per_s, arm.player.x_r_um
    assert abs(speed) > 5.0
    arm.player = stop(arm.player)
    arm.until()
    assert arm.player.x_r_um == pytest.approx(at_um + 0.15 * speed, abs=0.02)
