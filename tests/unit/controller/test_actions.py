"""Stops that release, parts that are held from the start, and guards of a free motion."""

import pytest
from msgspec.structs import replace

from pincette.control.planning.conditioning import conditioning
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Move, Ramp
from pincette.core.faults import Fault, FaultCode
from pincette_controller.actions import keep, let_go, may_keep, pause, release, retract, stop, waits
from pincette_controller.player import advance, begin

from .ideal_arm import BLANK, GUARDS, PROGRAM, Arm, T

KEEPS = Program(
    (
        Drive("hold", None),
        Drive("unload", 0.4, courses=(Ramp(0.0),)),
    ),
    GUARDS,
    1.0,
    begins_held=True,
)
MOVES = Program(
    (
        Drive("zero", 0.1, zeroes=True),
        Move("move", 0.6, guarded=True, to_um=(14.0,)),
        Move("rest", 0.2, guarded=True, to_um=(14.0,)),
    ),
    replace(GUARDS, zero_needed=False),
    1.0,
)


def test_a_release_unloads_the_part_without_a_retreat() -> None:
    arm = Arm()
    arm.until("hold")
    arm.player = let_go(PROGRAM, arm.player)
    arm.until()
    assert arm.phases[-1] == "unload"
    assert (arm.player.outcome, arm.player.held) == ("stopped", False)
    assert arm.player.ref.x_um == pytest.approx(12.0)


def test_retract_returns_to_the_start_with_and_without_a_part() -> None:
    arm = Arm()
    arm.until("hold")
    arm.player = retract(PROGRAM, let_go(PROGRAM, arm.player))
    arm.until()
    assert arm.phases[-2:] == ["unload", "retreat"]
    assert arm.player.outcome == "stopped"
    arm = Arm()
    arm.until("contact")
    arm.player = retract(PROGRAM, arm.player)
    arm.until()
    assert arm.phases[-2:] == ["contact", "retreat"]
    assert arm.player.ref.x_um == pytest.approx(0.0)


def test_retract_of_a_program_without_a_retreat_is_a_stop() -> None:
    arm = Arm(program=replace(PROGRAM, segments=PROGRAM.segments[:2]))
    arm.until("approach")
    arm.player = retract(arm.program, arm.player)
    arm.until()
    assert (arm.phases[-1], arm.player.outcome) == ("stopping", "stopped")


def test_a_part_is_kept_only_at_rest_and_stays_held() -> None:
    arm = Arm()
    arm.until("load")
    assert not may_keep(arm.player)
    arm.until("hold")
    assert may_keep(arm.player)
    player = advance(PROGRAM, keep(arm.player), (arm.estimate(),), T)
    assert (player.ended, player.held, player.outcome) == (True, True, "stopped")


def test_a_part_held_from_the_start_of_a_program_stays_at_its_voltage_until_released() -> None:
    at_V = replace(BLANK, applied_V=2.5)
    player = begin(KEEPS, (replace(BLANK, applied_V=2.5),), T)
    assert not waits(player)
    for _ in range(100):
        player = advance(KEEPS, player, (at_V,), T)
        assert (player.ref.voltages_V[0], player.held, player.ended) == (2.5, True, False)
    player = release(KEEPS, player)
    voltages: list[float] = []
    while not player.ended:
        assert player.held
        player = advance(KEEPS, player, (at_V,), T)
        voltages.append(player.ref.voltages_V[0])
    assert (player.outcome, player.held) == ("released", False)
    assert voltages[-1] == pytest.approx(0.0)
    assert voltages == sorted(voltages, reverse=True)


def test_a_stop_of_a_continued_hold_keeps_its_voltage_too() -> None:
    player = begin(KEEPS, (replace(BLANK, applied_V=2.5),), T)
    player = stop(pause(player))
    for _ in range(50):
        player = advance(KEEPS, player, (replace(BLANK, applied_V=2.5),), T)
    assert (player.ref.voltages_V[0], player.held, player.outcome) == (2.5, True, "stopped")
    player = let_go(KEEPS, player)
    while not player.ended:
        player = advance(KEEPS, player, (replace(BLANK, applied_V=2.5),), T)
    assert (player.outcome, player.held) == ("stopped", False)
    assert player.ref.voltages_V[0] == pytest.approx(0.0)


def test_a_continued_hold_beyond_a_position_limit_releases_the_part() -> None:
    program = replace(KEEPS, guards=replace(GUARDS, position_max_um=40.0))
    player = Arm(program=program).player
    player = advance(program, player, (replace(BLANK, x_um=41.0, applied_V=2.5),), T)
    assert (player.segment.phase, player.outcome) == ("unload", "overtravel")
    while not player.ended:
        player = advance(program, player, (replace(BLANK, x_um=41.0, applied_V=2.5),), T)
    assert (player.outcome, player.held) == ("overtravel", False)


@pytest.mark.parametrize("refused", [False, True])
def test_a_move_that_touches_something_goes_back(refused: bool) -> None:
    arm = Arm(program=MOVES)
    arm.refusal = Fault(FaultCode.ZERO_BEYOND_FIRST_TOUCH) if refused else None
    arm.until()
    assert (arm.phases[-1], arm.player.outcome) == ("stopping", "contact")
    # 2 mN and 0.1 mN of uncertainty on 2 mN/µm, three samples.
    assert arm.player.touch is not None
    assert arm.player.touch.x_um == pytest.approx(13.5, abs=0.5)
    assert arm.player.touch.force_mN == pytest.approx(3.0, abs=1.0)
    assert arm.player.ref.x_um == pytest.approx(0.0)


@pytest.mark.parametrize("phase", ["zero", "approach"])
def test_a_grip_that_touches_something_in_free_space_returns_to_rest(phase: str) -> None:
    arm = Arm()
    arm.until(phase)
    arm.tick()
    for _ in range(GUARDS.contact_samples):
        met = replace(arm.estimate(), touch_x_um=5.0, touch_mN=2.5)
        assert arm.player.outcome == ""
        arm.player = advance(arm.program, arm.player, (met,), T)
    assert arm.player.touch is not None
    assert (arm.player.outcome, arm.player.touch.x_um) == ("contact", 5.0)
    arm.until()
    assert arm.player.outcome == "contact"
    assert arm.player.ref.x_um == pytest.approx(0.0)


@pytest.mark.parametrize("touch_mN", [2.5, 1.5, -2.5])
def test_an_arm_that_is_pressed_before_its_strokes_omits_them(touch_mN: float) -> None:
    strokes = conditioning(-0.8, 10.0, 0.0, 19.0)
    program = replace(PROGRAM, segments=(*strokes, *PROGRAM.segments))
    player = begin(program, (replace(BLANK, applied_V=-0.4),), T)
    pressed = replace(BLANK, touch_x_um=-8.0, touch_mN=touch_mN, applied_V=-0.4)
    for _ in range(GUARDS.contact_samples):
        assert player.outcome == ""
        player = advance(program, player, (pressed,), T)
    assert player.outcome == ("contact" if touch_mN >= GUARDS.contact_force_mN else "")
    assert player.ref.voltages_V == (-0.4,)


def test_an_arm_goes_back_if_a_light_force_on_it_grows_on_the_way_to_its_conditioning() -> None:
    """The strokes begin at 0 V, where the arm can be nearer to a part that already presses it.

    Without this check, an arm that a part pressed with 4 mN then pressed the part with 13 mN.
    """
    strokes = conditioning(-0.8, 10.0, 0.0, 19.0)
    program = replace(PROGRAM, segments=(*strokes, *PROGRAM.segments))
    light = replace(BLANK, touch_x_um=-8.0, touch_mN=0.4, applied_V=-0.4)
    player = begin(program, (light,), T)
    while player.index == 0:
        player = advance(program, player, (light,), T)
    for _ in range(GUARDS.contact_samples):
        assert player.outcome == ""
        player = advance(program, player, (replace(light, touch_mN=2.5),), T)
    assert (player.outcome, player.segment.phase) == ("contact", "stopping")
    while not player.ended:
        player = advance(program, player, (replace(light, touch_mN=2.5),), T)
    assert player.ref.voltages_V == pytest.approx((-0.4,))


def test_a_touch_during_the_retreat_is_ignored() -> None:
    arm = Arm()
    arm.until("retreat")
    arm.tick()
    for _ in range(2 * GUARDS.contact_samples):
        met = replace(arm.estimate(), touch_x_um=5.0, touch_mN=2.5)
        arm.player = advance(arm.program, arm.player, (met,), T)
    assert (arm.player.outcome, arm.player.segment.phase) == ("gripped", "retreat")


def test_an_arm_held_back_by_something_behind_it_moves_forward() -> None:
    arm = Arm(contact_um=99.0, program=MOVES)
    arm.until("move")
    arm.tick()
    held = replace(arm.estimate(), x_um=4.0, touch_x_um=4.0, touch_mN=-2.5)
    for _ in range(GUARDS.contact_samples):
        arm.player = advance(MOVES, arm.player, (held,), T)
    assert arm.player.outcome == "contact"
    while not arm.player.ended:
        arm.player = advance(MOVES, arm.player, (held,), T)
    assert arm.player.ref.x_um > 4.0


def test_a_press_that_still_lasts_at_the_start_of_the_return_is_not_a_touch() -> None:
    arm = Arm()
    arm.until("retreat")
    for _ in range(10):
        pressed = replace(arm.estimate(), touch_x_um=12.0, touch_mN=5.0)
        arm.player = advance(arm.program, arm.player, (pressed,), T)
    assert arm.player.outcome == "gripped"


def test_before_the_zero_a_force_that_certainly_exceeds_its_limit_ends_the_program() -> None:
    arm = Arm(contact_um=99.0)
    arm.tick()
    unsure = replace(arm.estimate(), force_mN=45.0, force_uncertainty_mN=6.0)
    assert advance(arm.program, arm.player, (unsure,), T).outcome == ""
    sure = replace(unsure, force_uncertainty_mN=4.0)
    assert advance(arm.program, arm.player, (sure,), T).outcome == "overforce"


def test_a_voltage_move_into_something_returns_to_its_start() -> None:
    segments = (
        Drive("zero", 0.1, guarded=True, zeroes=True),
        Drive("move", 1.0, guarded=True, courses=(Ramp(1.0),)),
    )
    program = replace(MOVES, segments=segments)
    player, highest_V = Arm(program=program).player, 0.0
    for tick in range(200):
        touch_mN = 5.0 if player.ref.voltages_V[0] > 0.5 else None
        age_s = None if tick < 6 else T * (tick - 6)
        sample = replace(
            BLANK, touch_mN=touch_mN, zero_age_s=age_s, applied_V=player.ref.voltages_V[0]
        )
        player = advance(program, player, (sample,), T)
        highest_V = max(highest_V, player.ref.voltages_V[0])
        if player.ended:
            break
    assert (player.segment.phase, player.outcome) == ("stopping", "contact")
    assert 0.5 < highest_V < 0.7
    assert player.ref.voltages_V[0] == pytest.approx(0.0)


def test_a_touch_below_the_contact_force_is_ignored() -> None:
    arm = Arm(contact_um=99.0, program=MOVES)
    arm.until("move")
    for _ in range(10):
        light = replace(arm.estimate(), touch_x_um=3.0, touch_mN=1.9)
        arm.player = advance(MOVES, arm.player, (light,), T)
    assert arm.player.outcome != "contact"


@pytest.mark.parametrize(
    ("x_um", "touch_mN", "outcome"),
    [(15.0, 6.0, ""), (12.0, 6.0, "contact"), (40.0, 21.0, "contact"), (15.0, -6.0, "contact")],
    ids=["soft", "as hard as a part", "beyond ten contact forces", "pulled"],
)
def test_a_soft_kink_is_ignored_if_the_guards_permit_bends(
    x_um: float, touch_mN: float, outcome: str
) -> None:
    bends = replace(MOVES, guards=replace(MOVES.guards, bend_mN_per_um=1.0))
    arm = Arm(contact_um=99.0, program=bends)
    arm.until("move")
    arm.tick()
    for _ in range(GUARDS.contact_samples + 1):
        met = replace(arm.estimate(), x_um=x_um, touch_x_um=8.0, touch_mN=touch_mN)
        arm.player = advance(bends, arm.player, (met,), T)
    assert arm.player.outcome == outcome


def test_a_kink_before_the_start_of_a_program_is_a_contact_even_if_the_guards_permit_bends() -> (
    None
):
    bends = replace(MOVES, guards=replace(MOVES.guards, bend_mN_per_um=1.0))
    arm = Arm(contact_um=99.0, program=bends)
    arm.until("move")
    arm.tick()
    for _ in range(GUARDS.contact_samples + 1):
        met = replace(arm.estimate(), x_um=15.0, touch_x_um=-4.0, touch_mN=6.0)
        arm.player = advance(bends, arm.player, (met,), T)
    assert arm.player.outcome == "contact"
