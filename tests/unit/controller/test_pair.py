"""Programs of two arms: their phases, guards that end them early, and actions."""

import dataclasses
from math import inf, nan

import pytest
from msgspec.structs import replace

from pincette.config import read_rig
from pincette.control.force.freedom import FreeArm
from pincette.control.planning.pair_plan import (
    PairHold,
    PairPaths,
    carry_program,
    grip_program,
    pair_guards,
    track_program,
)
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, LetGo, Move, Ramp, Stay
from pincette.core.faults import ActionCode, Fault, FaultCode, Outcome
from pincette.core.messages import Command, Estimate, Load, Telemetry
from pincette.core.service import RefusedError
from pincette_controller import SERVICE
from pincette_controller.outputs import number_out_of_bounds
from tests.support.arms import with_arm
from tests.support.rigs import DEMO
from tests.unit.controller.ideal_pair import (
    GAP_UM,
    NEAR_UM,
    PERIOD_S,
    RIG,
    IdealPair,
    request,
)

STARTS_UM = (0.0, 0.0)
MOST_MN = 30.0
LIES_UM = NEAR_UM - 0.5 * GAP_UM


def grip(hold_s: float | None = 1.0, *, centred: bool = False) -> Program:
    return grip_program(request(centred=centred), PairHold(hold_s=hold_s), STARTS_UM, MOST_MN)


def track() -> Program:
    force = sinusoid("force", 8.0, 4.0, 0.7, 2)
    place = sinusoid("position", LIES_UM, 4.0, 1.0, 2)
    return track_program(request(), PairPaths(force=force, place=place), STARTS_UM, MOST_MN)


def phases(told: list[Telemetry]) -> list[str]:
    names = [each.phase for each in told]
    return [name for at, name in enumerate(names) if at == 0 or names[at - 1] != name]


def test_a_part_is_gripped_held_and_released() -> None:
    pair = IdealPair(grip())
    telemetry = pair.play()
    assert phases(telemetry) == [
        "zero",
        "approach",
        "contact",
        "load",
        "hold",
        "unload",
        "retreat",
    ]
    assert telemetry[-1].outcome == Outcome.GRIPPED
    assert not telemetry[-1].held
    assert [u == pytest.approx(0.0, abs=0.01) for u in pair.voltages_V] == [True, True]


def test_a_held_part_has_the_planned_force_at_its_original_place() -> None:
    pair = IdealPair(grip())
    while (telemetry := pair.tick()[1]).phase != "unload":
        pass
    assert pair.forces() == pytest.approx((8.0, 8.0), abs=0.05)
    assert len(telemetry.arms) == 2
    assert telemetry.place_um == pytest.approx(telemetry.place_r_um, abs=0.01)


def test_place_and_force_follow_independent_paths() -> None:
    pair = IdealPair(track())
    forces: list[float] = []

    def watched(estimate: Estimate) -> Estimate:
        player = pair.state.player
        if player is not None and player.segment.phase == "track":
            forces.append(estimate.arms[1].force_mN)
        return estimate

    pair.change = watched
    telemetry = pair.play()
    on_path = [each for each in telemetry if each.phase == "track"]
    places = [each.place_um or 0.0 for each in on_path]
    assert telemetry[-1].outcome == Outcome.TRACKED
    assert max(places) - min(places) == pytest.approx(4.0, abs=0.1)
    assert max(forces) - min(forces) == pytest.approx(4.0, abs=0.1)
    references = [each.place_r_um or 0.0 for each in on_path]
    errors = [abs(q - q_r) for q, q_r in zip(places, references, strict=True)]
    assert max(errors) < 0.1


def test_each_arm_touches_the_part_before_both_load_it() -> None:
    telemetry = IdealPair(grip(centred=True)).play()
    assert telemetry[-1].outcome == Outcome.GRIPPED
    met = next(each.contact_x_um for each in telemetry if each.phase == "load")
    assert met == pytest.approx(LIES_UM, abs=0.1)


@pytest.mark.parametrize("drift_mN_per_s", [-0.1, 0.0, 0.1])
def test_an_arm_that_seeks_the_part_presses_little_more_than_the_contact_force(
    drift_mN_per_s: float,
) -> None:
    """The estimated force of a free arm drifts along its path, by the error of its model."""
    pair = IdealPair(grip(centred=True))
    begun: list[int] = []

    def drifting(estimate: Estimate) -> Estimate:
        if not begun and pair.zeroed_at is not None:
            begun.append(estimate.seq)
        passed_s = (estimate.seq - begun[0]) * PERIOD_S if begun else 0.0
        off_mN = drift_mN_per_s * min(passed_s, 4.0)
        assert len(estimate.arms) == 2
        one, two = estimate.arms[0].force_mN + off_mN, estimate.arms[1].force_mN + off_mN
        return with_arm(with_arm(estimate, force_mN=one), 1, force_mN=two)

    pair.change = drifting
    pressed_mN = [0.0, 0.0]
    while (telemetry := pair.tick()[1]).phase != "contact":
        if telemetry.phase == "centre":
            pressed_mN = [max(each) for each in zip(pressed_mN, pair.forces(), strict=True)]
    assert pair.state.player is not None
    assert not pair.state.player.outcome
    assert min(pressed_mN) > 0.6
    assert max(pressed_mN) < 1.2


def early(*, centred: bool) -> Program:
    """Return a grip whose plan expects the part 1.8 µm farther on, with a tolerance of 1.5 µm."""
    contacts_um = (NEAR_UM + 1.8, GAP_UM - NEAR_UM + 1.8)
    expected = dataclasses.replace(request(centred=centred), contacts_um=contacts_um)
    return grip_program(expected, PairHold(hold_s=0.4), STARTS_UM, MOST_MN)


@pytest.mark.parametrize("centred", [False, True])
@pytest.mark.parametrize("arm", [0, 1])
def test_a_part_found_too_early_by_an_unconfirmed_zero_is_not_loaded(
    arm: int, centred: bool
) -> None:
    pair = IdealPair(early(centred=centred))

    def unconfirmed(estimate: Estimate) -> Estimate:
        if arm == 0:
            return with_arm(estimate, zero_unconfirmed=estimate.arms[0].zero_age_s is not None)
        return with_arm(estimate, 1, zero_unconfirmed=estimate.arms[0].zero_age_s is not None)

    pair.change = unconfirmed
    telemetry = pair.play()
    assert telemetry[-1].outcome == Outcome.CONTACT
    assert not any(each.held for each in telemetry)
    assert "load" not in phases(telemetry)
    assert telemetry[-1].touch_x_um == pytest.approx((NEAR_UM, GAP_UM - NEAR_UM)[arm], abs=0.3)
    assert telemetry[-1].touch_mN is not None
    assert telemetry[-1].touch_mN >= request().contact_force_mN


@pytest.mark.parametrize("centred", [False, True])
def test_a_part_found_too_early_by_a_confirmed_zero_is_loaded(centred: bool) -> None:
    assert IdealPair(early(centred=centred)).play()[-1].outcome == Outcome.GRIPPED


def test_the_approach_continues_until_its_touch_is_detected() -> None:
    """A contact force F keeps an arm s·F behind its free path, also for the most distant part."""
    compliant = dataclasses.replace(request(), compliances_um_per_mN=(0.46, 0.5))
    ways = zip(compliant.furthest_um, request().furthest_um, strict=True)
    assert [one - other for one, other in ways] == pytest.approx([0.8 * 0.46, 0.8 * 0.5])


def test_a_stop_holds_both_references_and_a_release_releases() -> None:
    pair = IdealPair(track())
    telemetry = pair.play({"track": ActionCode.STOP, "stopped": ActionCode.RELEASE})
    held = [each for each in telemetry if each.phase == "stopped"]
    assert held
    assert len(held[-1].arms) == 2
    assert held[-1].place_um == pytest.approx(held[-1].place_r_um, abs=0.02)
    assert telemetry[-1].outcome == Outcome.STOPPED
    assert not telemetry[-1].held


def test_a_retract_releases_and_goes_back() -> None:
    telemetry = IdealPair(track()).play({"track": ActionCode.RETRACT})
    assert phases(telemetry)[-2:] == ["unload", "retreat"]


def test_a_kept_part_stays_pressed_by_both_arms() -> None:
    pair = IdealPair(grip(None))
    telemetry = pair.play({"hold": ActionCode.KEEP})
    assert telemetry[-1].held
    assert min(pair.forces()) == pytest.approx(8.0, abs=0.1)


def test_a_pause_along_a_path_begins_where_the_place_reverses_and_a_resume_continues() -> None:
    pair = IdealPair(track())
    while pair.tick()[1].phase != "track":
        pass
    telemetry = pair.tick(ActionCode.PAUSE)[1]
    while not telemetry.paused:
        telemetry = pair.tick()[1]
    rests = [pair.tick()[1] for _ in range(20)]
    assert len({each.force_r_mN for each in rests}) == 1
    assert len({each.arms[1] and each.place_r_um for each in rests}) == 1
    pair.tick(ActionCode.RESUME)
    assert pair.play()[-1].outcome == Outcome.TRACKED


def test_a_part_without_force_at_one_of_two_arms_counts_as_lost() -> None:
    pair = IdealPair(grip(None))
    while pair.tick()[1].phase != "hold":
        pass
    pair.change = lambda estimate: with_arm(estimate, 1, force_mN=0.0)
    reported = [pair.tick()[1] for _ in range(8)]
    assert reported[-1].outcome == Outcome.LOST
    assert reported[-1].phase == "retreat"


@pytest.mark.parametrize("arm", [1, 2])
def test_too_much_force_of_either_arm_opens_both_arms(arm: int) -> None:
    pair = IdealPair(grip(None))
    while pair.tick()[1].phase != "hold":
        pass
    if arm == 1:
        pair.change = lambda estimate: _pressing(estimate, MOST_MN + 1.0)
    else:
        pair.change = lambda estimate: with_arm(estimate, 1, force_mN=MOST_MN + 1.0)
    telemetry = pair.tick()[1]
    assert telemetry.outcome == Outcome.OVERFORCE
    assert telemetry.phase == "retreat"


def _pressing(estimate: Estimate, force_mN: float) -> Estimate:
    return with_arm(estimate, force_mN=force_mN)


def test_without_a_part_both_arms_go_back() -> None:
    pair = IdealPair(grip())
    pair.part = False
    telemetry = pair.play()
    assert telemetry[-1].outcome == Outcome.NO_CONTACT
    assert phases(telemetry)[-1] == "retreat"


def test_a_touch_of_the_second_arm_in_free_space_reverses_both_arms() -> None:
    pair = IdealPair(grip())
    while pair.tick()[1].phase != "approach":
        pass
    for _ in range(5):
        pair.tick()
    pair.change = lambda estimate: with_arm(estimate, 1, touch_x_um=1.0, touch_mN=3.0)
    reported = [pair.tick()[1] for _ in range(4)]
    assert reported[-1].outcome == Outcome.CONTACT
    assert reported[-1].touch_x_um == 1.0
    assert reported[-1].phase == "retreat"


@pytest.mark.parametrize("arm", [0, 1])
def test_if_one_of_two_arms_is_pressed_before_its_strokes_neither_makes_strokes(arm: int) -> None:
    strokes = Drive("condition", 0.1, guarded=True, courses=(Stay(), Stay()))
    program = grip()
    pair = IdealPair(replace(program, segments=(strokes, *program.segments)))

    def pressed(estimate: Estimate) -> Estimate:
        if arm == 0:
            return with_arm(estimate, touch_x_um=1.0, touch_mN=3.0)
        return with_arm(estimate, 1, touch_x_um=1.0, touch_mN=3.0)

    pair.change = pressed
    reported = [pair.tick()[1] for _ in range(4)]
    assert reported[-1].outcome == Outcome.CONTACT
    assert pair.voltages_V == (0.0, 0.0)


@pytest.mark.parametrize("arm", [0, 1])
def test_an_arm_held_back_by_something_behind_it_moves_forward_again(arm: int) -> None:
    back = Drive("retreat", 1.0, guarded=True, courses=(Ramp(0.0), Ramp(0.0)))
    pair = IdealPair(replace(grip(), segments=(back,)))
    pair.part, pair.voltages_V = False, (1.0, 1.0)
    for _ in range(25):
        pair.tick()
    pair.change = lambda estimate: with_arm(estimate, arm, touch_x_um=5.0, touch_mN=-3.0)
    while pair.tick()[1].outcome != Outcome.CONTACT:
        pass
    met_V = pair.voltages_V[arm]
    pair.play()
    assert pair.voltages_V[arm] > met_V + 0.03
    assert pair.voltages_V[1 - arm] == pytest.approx(met_V, abs=0.02)


@pytest.mark.parametrize(("behind", "outcome"), [(0, "zero_refused"), (1, "contact")])
def test_after_a_refused_zero_each_arm_with_a_known_zero_is_monitored_on_return(
    behind: int, outcome: str
) -> None:
    """The zero of the first arm was refused, so its force is not known."""
    pair = IdealPair(grip())

    def refused(estimate: Estimate) -> Estimate:
        return with_arm(estimate, zero_refusal=Fault(FaultCode.ZERO_OFFSET), zero_age_s=None)

    pair.change = refused
    telemetry = pair.tick()[1]
    while telemetry.phase != "retreat":
        telemetry = pair.tick()[1]
    assert telemetry.outcome == Outcome.ZERO_REFUSED
    for _ in range(3):
        pair.tick()
    pair.change = lambda estimate: with_arm(
        refused(estimate), behind, touch_x_um=1.0, touch_mN=-3.0
    )
    assert pair.play()[-1].outcome == outcome


def carry() -> IdealPair:
    guards = pair_guards(request(), MOST_MN)
    pair = IdealPair(carry_program(3.0, 20.0, guards, release_s=0.5, safe_V=0.0))
    pair.voltages_V = (0.6, 0.6)
    return pair


def test_a_held_part_is_carried_and_stays_held() -> None:
    pair = carry()
    begin = pair.forces()
    first = pair.tick()[1]
    telemetry = pair.play()
    assert phases(telemetry) == ["move", "rest"]
    assert telemetry[-1].outcome == Outcome.MOVED
    assert telemetry[-1].held
    assert first.place_um is not None
    assert telemetry[-1].place_um is not None
    assert telemetry[-1].place_um - first.place_um == pytest.approx(3.0, abs=0.05)
    assert pair.forces() == pytest.approx(begin, abs=0.3)


def test_a_carried_part_can_be_released() -> None:
    pair = carry()
    pair.tick()
    pair.tick(ActionCode.RELEASE)
    telemetry = pair.play()
    assert phases(telemetry) == ["unload"]
    assert not telemetry[-1].held
    assert pair.voltages_V == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_program_must_match_the_number_of_arms_of_the_rig() -> None:
    one_arm = SERVICE.configure(read_rig(DEMO))
    with pytest.raises(RefusedError, match="for two arms, and this rig has one"):
        SERVICE.handle(one_arm, SERVICE.start(one_arm), Load(grip()), 0.0)
    two_arms = SERVICE.configure(RIG)
    check = FreeArm(0.5, 0.9, 0.0, 0.05)
    for segment in (
        Move("approach", 1.0, to_um=(1.0,)),
        LetGo("release", 1.0, checks=(check,)),
    ):
        program = Program((segment,), pair_guards(request(), MOST_MN), 1.0)
        with pytest.raises(RefusedError, match="for one arm, and this rig has two"):
            SERVICE.handle(two_arms, SERVICE.start(two_arms), Load(program), 0.0)
    program = Program((LetGo("release", 1.0, checks=(check, check)),), program.guards, 1.0)
    with pytest.raises(RefusedError, match="for two arms, and this rig has one"):
        SERVICE.handle(one_arm, SERVICE.start(one_arm), Load(program), 0.0)
    with pytest.raises(ValueError, match="1 checks for 2 courses"):
        LetGo("release", 1.0, courses=(Stay(), Stay()), checks=(check,))


def test_each_command_is_for_both_arms() -> None:
    pair = IdealPair(grip())
    command = pair.tick()[0]
    assert isinstance(command, Command)
    assert len(command.arms) == 2


@pytest.mark.parametrize("number", ["x_r_um", "x_d_um"])
@pytest.mark.parametrize("value", [nan, inf, -1e300])
def test_an_invalid_number_of_the_second_arm_is_a_fault(number: str, value: float) -> None:
    _, telemetry = IdealPair(grip()).tick()
    assert len(telemetry.arms) == 2
    assert number_out_of_bounds(telemetry) is None
    wrong = with_arm(telemetry, 1, **{number: value})
    found = number_out_of_bounds(wrong)
    assert found is not None
    assert found.code is FaultCode.LAW_NUMBER
    assert [item.name for item in found.values] == [f"second.{number}"]


def test_a_zero_that_one_arm_has_missed_is_requested_for_both_again() -> None:
    pair = IdealPair(grip())
    while pair.zeroed_at is None:
        pair.tick()
    seq = pair.zeroed_at
    pair.change = lambda estimate: with_arm(estimate, 1, zero_age_s=None)
    command, _ = pair.tick()
    assert command.zero
    pair.change = lambda estimate: estimate
    command, view = pair.tick()
    assert not command.zero
    assert pair.zeroed_at == seq + 1
    assert view.phase != "retreat"
