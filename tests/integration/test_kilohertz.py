"""The delivered rig with T = 1 ms, in virtual time: a grip in a second and a half, 10 Hz."""

from collections.abc import Callable
from pathlib import Path

import pytest

from pincette.config import read_rig
from pincette.control.force.position_steps import StepLimits
from pincette.control.planning.program import Program
from pincette.control.planning.segments import paths_of
from pincette.core.faults import Mode
from pincette.core.messages import Applied, Estimate, GroundTruth, Message, Telemetry
from pincette.core.topics import TELEMETRY, Topic
from pincette.engine.composed import ComposedLoop
from pincette.engine.simulated import simulated_bench
from pincette.engine.timing_budget import budget
from pincette.sim.bench import Bench
from pincette_controller import guarding
from pincette_controller.player_state import Player
from pincette_study.closed_loop import errors, tracked, tracking_plan
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job

RIG = read_rig(Path("deploy/rigs/kilohertz.toml"))
MOST_S = 1.5
"""Longest duration of a grip without its hold, in s."""
PEAK, HELD = 0.03, 0.03
"""Shares of the force by which the true force may exceed it, and deviate from it in the hold;
the deviation comes from the identified contact line, not from the loop."""


STEP_TICK, BACK = 200, 0.15
"""Tick of the hold at which the part steps, and the remaining share of the step allowed then."""


@pytest.fixture(scope="module")
def said() -> list[Message]:
    return ComposedLoop(RIG).play(plan_job(GripJobRequest(kind="grip"), RIG).program)


def test_a_grip_is_short_and_its_force_is_held(said: list[Message]) -> None:
    wanted_mN, hold_s, T = RIG.grip.force_mN, RIG.grip.hold_s, RIG.rig.period_s
    phases = {one.seq: one.phase for one in said if isinstance(one, Telemetry)}
    assert len(phases) * T - hold_s <= MOST_S
    last = [one for one in said if isinstance(one, Applied)][-1]
    assert (last.state, last.faults) == (Mode.IDLE, ())
    true_mN = {one.seq: one.arms[0].force_mN for one in said if isinstance(one, GroundTruth)}
    assert max(true_mN.values()) <= (1.0 + PEAK) * wanted_mN
    held = [true_mN[seq] for seq, phase in phases.items() if phase == "hold" and seq in true_mN]
    assert len(held) > 0.5 * hold_s / T
    late = held[len(held) // 2 :]
    assert abs(sum(late) / len(late) - wanted_mN) <= HELD * wanted_mN


def test_a_path_of_10_hz_is_followed_in_position_and_force() -> None:
    program = tracking_plan(RIG, frequency_hz=10.0, cycles=6).program
    path = next(path for one in program.segments for path in paths_of(one))
    messages = ComposedLoop(RIG).play(program)
    assert [one for one in messages if isinstance(one, Telemetry)][-1].outcome == "tracked"
    found = errors(tracked(messages, path, RIG.rig.period_s))
    assert found.position_percent <= 0.6
    # The arm was not stroked: its first load shows the history that the model does not know.
    assert found.force_percent <= 4.0


def test_a_healthy_grip_reports_no_position_step(said: list[Message]) -> None:
    views = [one for one in said if isinstance(one, Telemetry)]
    assert views[-1].outcome == "gripped"
    assert all(view.step_um is None for view in views)


def test_a_part_that_steps_during_the_hold_is_detected_within_15_ms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The step is 1 µm; the true position has returned to the impedance reference, except for 15 %
    of the step.

    The reference follows the force by K_f, slowly. Only the law is tested: the step detector, which
    freezes the voltage at once, is disabled.
    """

    def unwatched(
        _program: Program, player: Player, _estimate: Estimate, _limits: StepLimits | None
    ) -> Player:
        return player

    monkeypatch.setattr(guarding, "watch_steps", unwatched)
    benches, stepped = list[Bench](), list[int]()

    def set_up(told: Callable[[GroundTruth], None]) -> Bench:
        benches.append(simulated_bench(RIG, told))
        return benches[0]

    def step(_topic: Topic, message: Message) -> None:
        view = message if isinstance(message, Telemetry) else None
        if view and view.phase == "hold" and view.segment_tick == STEP_TICK and not stepped:
            stepped.append(view.seq)
            assert RIG.simulation is not None
            benches[0].rig.place_part(RIG.simulation.bead_contact_um - 1.0)

    loop = ComposedLoop(RIG, set_up)
    loop.bus.subscribe(TELEMETRY, step)
    messages = loop.play(plan_job(GripJobRequest(kind="grip"), RIG).program)
    true_um = {one.seq: one.arms[0].x_um for one in messages if isinstance(one, GroundTruth)}
    wanted_um = {one.seq: one.arms[0].x_d_um for one in messages if isinstance(one, Telemetry)}
    (at,) = stepped
    before_um = sum(true_um[seq] - wanted_um[seq] for seq in range(at - 50, at)) / 50.0
    after = range(at + 1, at + 200)
    off_um = [true_um[seq] - wanted_um[seq] - before_um for seq in after]
    most_um = max(map(abs, off_um))
    late = [tick for tick, off in enumerate(off_um, 1) if abs(off) > BACK * most_um]
    print(f"a step by 1 µm: {most_um:.2f} µm, back within 15 % after {late[-1]} ms")
    assert most_um > 0.3
    assert late[-1] * RIG.rig.period_s <= 0.015


def test_the_instruments_fit_into_the_period() -> None:
    assert budget(RIG).fits
