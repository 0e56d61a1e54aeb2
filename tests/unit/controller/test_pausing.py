"""A pause begins while the references are at rest, moves nothing and changes nothing after it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from pincette.control.planning.path_shapes import sinusoid, steps
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow, Move, Track
from pincette_controller.actions import pause, resume, stop

from .ideal_arm import PROGRAM, SWING, TRACK, Arm, T

Reference = tuple[int, int, float, float]


def reference(arm: Arm) -> Reference:
    player = arm.player
    return player.index, player.ticks, player.ref.x_um, player.ref.force_mN


def paused(arm: Arm, most: int = 200) -> Arm:
    """Request a pause, and play until it has begun."""
    arm.player = pause(arm.player)
    for _ in range(most):
        arm.tick()
        if arm.player.pause.active:
            return arm
    pytest.fail(f"no pause began; phases: {arm.phases}")


def whole(arm: Arm, at: tuple[tuple[int, int], ...] = ()) -> list[Reference]:
    """Return the references of each tick of a program, with pauses requested at some ticks for
    some time."""
    begin, end = {start for start, _ in at}, {start + length for start, length in at}
    seen: list[Reference] = []
    for tick in range(3000):
        if tick in begin:
            arm.player = pause(arm.player)
        if tick in end:
            arm.player = resume(arm.player)
        arm.tick()
        # A pause may begin with a segment; without one its first sample is that after it.
        if arm.player.ticks and (not seen or seen[-1] != reference(arm)):
            seen.append(reference(arm))
        if arm.player.ended:
            return seen
    pytest.fail(f"the program did not end; phases: {arm.phases}")


@pytest.mark.parametrize(
    ("asked", "begins"),
    [
        ("zero", ("zero", 0.0)),
        ("approach", ("approach", 0.4)),
        ("contact", ("load", 0.0)),
        ("load", ("load", 0.4)),
        ("hold", ("hold", 0.2)),
        ("unload", ("unload", 0.4)),
        ("retreat", ("retreat", 0.4)),
    ],
)
def test_in_every_phase_a_pause_begins_when_the_references_next_come_to_rest(
    asked: str, begins: tuple[str, float]
) -> None:
    # The contact line differs from the planned one, so the hold begins with a motion.
    arm = Arm(contact_um=11.5, stiffness=1.8)
    arm.until(asked)
    paused(arm)
    phase, at_s = begins
    assert arm.player.segment.phase == phase
    assert arm.player.ticks * T == pytest.approx(at_s, abs=0.5 * T if at_s else 1.5 * T)
    before = arm.player
    for _ in range(100):
        arm.tick()
    assert reference(arm) == (before.index, before.ticks, before.ref.x_um, before.ref.force_mN)
    arm.player = resume(arm.player)
    arm.until()
    assert arm.player.outcome == "gripped"


def test_along_a_path_a_pause_begins_at_a_turning_point() -> None:
    arm = Arm(program=TRACK)
    arm.until("track")
    for _ in range(30):
        arm.tick()
    paused(arm)
    assert arm.player.segment.phase == "track"
    t_s = arm.player.ticks * T
    assert SWING.point(t_s - 0.5 * T).rate * SWING.point(t_s + 0.5 * T).rate <= 0.0


def test_a_path_of_steps_pauses_between_steps_and_a_voltage_path_where_it_rests() -> None:
    levels = steps("force", (10.0, 15.0), 0.3, 20.0, 400.0)
    program = replace(
        TRACK,
        segments=(
            *TRACK.segments[:6],
            Track("track", levels.duration_s, force=levels),
            *TRACK.segments[7:],
        ),
    )
    arm = Arm(program=program)
    arm.until("track")
    while arm.player.ref.force_mN == 10.0:
        arm.tick()
    paused(arm)
    assert arm.player.ref.force_mN == pytest.approx(15.0)
    swing = sinusoid("voltage", 0.5, 1.0, 0.5, 2)
    program = Program(
        (Drive("swing", swing.duration_s, courses=(Follow(swing),)),), PROGRAM.guards, 2.0
    )
    arm = Arm(program=program)
    for _ in range(110):
        arm.tick()
    paused(arm)
    assert arm.player.ref.voltages_V[0] in (
        pytest.approx(swing.mean + swing.amplitude, abs=1e-3),
        pytest.approx(swing.mean - swing.amplitude, abs=1e-3),
    )
    resting_V = arm.player.ref.voltages_V[0]
    arm.tick()
    assert arm.player.ref.voltages_V[0] == resting_V


@pytest.mark.parametrize("phase", ["approach", "load", "hold", "unload"])
def test_a_stop_during_a_pause_moves_nothing(phase: str) -> None:
    arm = Arm()
    arm.until(phase)
    paused(arm)
    x_r_um, force_r_mN, held = arm.player.ref.x_um, arm.player.ref.force_mN, arm.player.held
    arm.player = stop(arm.player)
    for _ in range(100):
        arm.tick()
        assert (arm.player.ref.x_um, arm.player.ref.force_mN) == (x_r_um, force_r_mN)
        if arm.player.ended:
            break
    assert arm.player.held == held
    assert arm.player.ended == (not held)
    assert (arm.player.outcome, arm.player.pause.active) == ("stopped", False)


def test_a_stop_at_the_turning_point_of_a_path_moves_nothing() -> None:
    swing = sinusoid("position", 5.0, 4.0, 2.0, 1)
    segments = (
        Move("approach", 0.4, to_um=(5.0,)),
        Track("track", swing.duration_s, force=swing),
    )
    arm = Arm(contact_um=99.0, program=replace(PROGRAM, segments=segments))
    arm.until("track")
    for _ in range(5):
        arm.tick()
    paused(arm)
    x_r_um = arm.player.ref.x_um
    arm.player = stop(arm.player)
    arm.until()
    assert arm.player.ref.x_um == x_r_um


@pytest.mark.parametrize("phase", ["load", "hold"])
def test_a_part_lost_in_a_pause_ends_the_pause(phase: str) -> None:
    arm = Arm()
    arm.until(phase)
    paused(arm)
    arm.lost = True
    for _ in range(5):
        assert arm.player.pause.active
        arm.tick()
    assert (arm.player.segment.phase, arm.player.outcome) == ("retreat", "lost")
    assert (arm.player.held, arm.player.pause.active) == (False, False)


def test_a_cancelled_pause_has_no_effect() -> None:
    arm = Arm()
    arm.until("load")
    arm.player = pause(arm.player)
    arm.tick()
    arm.player = resume(arm.player)
    arm.until()
    assert arm.player.outcome == "gripped"


PLAIN = {"grip": whole(Arm()), "track": whole(Arm(program=TRACK))}
PAUSES = st.lists(st.tuples(st.integers(0, 250), st.integers(1, 60)), max_size=5).map(tuple)


@settings(max_examples=30)
@given(PAUSES)
def test_pauses_never_change_the_references_of_a_grip(at: tuple[tuple[int, int], ...]) -> None:
    """Compared by segment and time within it, bit for bit, the fitted contact line included."""
    assert whole(Arm(), at) == PLAIN["grip"]


@settings(max_examples=30)
@given(PAUSES)
def test_pauses_never_change_the_references_of_a_track(at: tuple[tuple[int, int], ...]) -> None:
    assert whole(Arm(program=TRACK), at) == PLAIN["track"]
