"""A held part is loaded and unloaded to new forces by one arm and by two, without being
released."""

from collections.abc import Callable
from itertools import pairwise
from math import fsum
from statistics import fmean

import pytest

from pincette.api.pairs import PairResult
from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette.core.faults import ActionCode
from pincette.core.messages import (
    Action,
    Applied,
    Arm,
    Estimate,
    GroundTruth,
    Message,
    Position,
    Reset,
    Sample,
    Telemetry,
)
from pincette.core.messages.arms import ArmEstimate
from pincette.core.topics import ACTION, ARM, RESET, TOPICS, Topic
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import HoldJobRequest, HoldResult
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned, Present
from pincette_supervisor.results.archive import Take, gather
from tests.support.rigs import demo_rig
from tests.support.stated_force import taught
from tests.support.two_arms import SHORT_PAIR, two_arm_rig

RIG = demo_rig(time="lockstep")
PAIR = two_arm_rig(SHORT_PAIR)
RIGS = pytest.mark.parametrize("rig", [RIG, PAIR], ids=["one arm", "two arms"])
STAIRCASE_MN = (5.0, 10.0, 15.0, 10.0, 5.0)
MOST, NOISE_SAMPLES = 1.02, 8
KEPT_TICKS = 100
LARGEST_JUMP_UM = 0.3
"""Largest change of the position reference in a period, in µm: a load of 10 mN in 1 s moves it by
0.2 µm."""
Watch = Callable[["Desk", Telemetry], None]


class Desk:
    """A rig in one process on which jobs are played one after the other."""

    def __init__(self, rig: RigFile = RIG) -> None:
        self.rig, self.loop, self.epoch = rig, ComposedLoop(rig), 0
        self.heard: list[Message] = []
        self.newest: dict[type[Message], Message] = {}
        self._watch: Watch | None = None
        for topic in TOPICS:
            self.loop.bus.subscribe(topic, self._hear)
        self.loop.bus.call(RESET, Reset(acknowledge=True))

    def _hear(self, _topic: Topic, message: Message) -> None:
        self.heard.append(message)
        self.newest[type(message)] = message
        if isinstance(message, Telemetry) and message.playing and self._watch is not None:
            self._watch(self, message)

    def ask(self, action: str) -> None:
        self.loop.bus.call(ACTION, Action(ActionCode(action)))

    @property
    def estimates(self) -> tuple[ArmEstimate, ...]:
        newest = self.newest[Estimate]
        assert isinstance(newest, Estimate)
        return newest.arms

    @property
    def force_mN(self) -> float:
        return fmean(arm.force_mN for arm in self.estimates)

    @property
    def present(self) -> Present:
        applied, position = self.newest[Applied], self.newest[Position]
        assert isinstance(applied, Applied)
        assert isinstance(position, Position)
        return Present(
            applied.arms[0].voltage_V,
            position.arms[0].x_um,
            applied.part_held,
            second_V=applied.arms[-1].voltage_V,
            second_um=position.arms[-1].x_um,
            force_mN=self.force_mN,
            force_uncertainty_mN=max(arm.force_uncertainty_mN for arm in self.estimates),
        )

    def job(self, request: JobRequest, watch: Watch | None = None) -> Planned:
        planned = plan_job(request, self.rig, self.present if self.heard_anything else None)
        assert planned.plan.violations == []
        self.play(planned.program, watch)
        return planned

    @property
    def heard_anything(self) -> bool:
        return Estimate in self.newest

    def play(self, program: Program, watch: Watch | None = None) -> None:
        self.heard.clear()
        self.epoch, self._watch = self.epoch + 1, watch
        arm(self.loop.bus, program, epoch=self.epoch, digest=self.rig.digest())
        while self.loop.bus.pump():
            pass

    def grip(self, force_mN: float, watch: Watch | None = None) -> None:
        request = GripJobRequest(kind="grip", force_mN=force_mN, until_released=True, load_s=1.0)
        self.job(request, watch or kept)

    def hold(
        self, force_mN: float, watch: Watch | None = None, hold_s: float | None = None
    ) -> HoldResult | PairResult:
        """Hold a part with a new force; returns the result of its record."""
        request = HoldJobRequest(
            kind="hold", force_mN=force_mN, load_s=1.0, hold_s=hold_s, release_s=1.0
        )
        planned = self.job(request, watch or kept)
        row = JobRow("job", "hold", self.rig.rig.name, "running", {}, {}, "")
        samples = [one for one in self.heard if not isinstance(one, Sample) or one.seq >= 0]
        result = gather(self.rig, row, planned, Take(self.epoch, samples)).result
        assert isinstance(result, HoldResult | PairResult)
        return result

    @property
    def views(self) -> list[Telemetry]:
        return [one for one in self.heard if isinstance(one, Telemetry)]

    @property
    def voltages_V(self) -> list[float]:
        return [one.arms[0].voltage_V for one in self.heard if isinstance(one, Applied)]

    @property
    def forces_mN(self) -> list[float]:
        """Estimated forces, each a mean over a few samples, so that noise makes no peak."""
        all_mN = [
            fmean(arm.force_mN for arm in one.arms)
            for one in self.heard
            if isinstance(one, Estimate)
        ]
        count = NOISE_SAMPLES
        return [fsum(all_mN[at : at + count]) / count for at in range(len(all_mN) - count + 1)]

    @property
    def truths_mN(self) -> list[float]:
        return [
            fmean(arm.force_mN for arm in one.arms)
            for one in self.heard
            if isinstance(one, GroundTruth)
        ]


def at(phase: str, tick: int, action: str) -> Watch:
    """Request an action at a tick of a phase."""

    def watch(desk: Desk, view: Telemetry) -> None:
        if (view.phase, view.segment_tick) == (phase, tick):
            desk.ask(action)

    return watch


kept = at("hold", KEPT_TICKS, "keep")
"""End a program during its hold, with the part held."""


def stopped_then_kept(phase: str, tick: int) -> Watch:
    def watch(desk: Desk, view: Telemetry) -> None:
        if (view.phase, view.segment_tick) == (phase, tick):
            desk.ask("stop")
        elif view.phase == "stopped" and view.segment_tick == KEPT_TICKS:
            desk.ask("keep")

    return watch


Stairs = list[tuple[HoldResult | PairResult, Desk]]


@pytest.fixture(scope="module", params=[RIG, PAIR], ids=["one arm", "two arms"])
def stairs(request: pytest.FixtureRequest) -> Stairs:
    """Return each step of the staircase after the grip, with its messages."""
    desk, steps = Desk(request.param), Stairs()
    desk.grip(STAIRCASE_MN[0])
    for force_mN in STAIRCASE_MN[1:]:
        result = desk.hold(force_mN)
        step = Desk.__new__(Desk)
        step.heard, step.newest = list(desk.heard), dict(desk.newest)
        steps.append((result, step))
    return steps


def test_changing_forces_never_lose_the_part(stairs: Stairs) -> None:
    for result, step in stairs:
        assert min(step.truths_mN) > 0.8 * min(STAIRCASE_MN)
        assert all(view.held for view in step.views)
        assert (result.outcome, result.held_at_end) == ("stopped", True)
        assert [phase.phase for phase in result.phases] == ["load", "hold"]


def test_each_force_is_held_without_a_higher_peak(stairs: Stairs) -> None:
    befores_mN = STAIRCASE_MN[:-1]
    for before_mN, force_mN, (result, step) in zip(
        befores_mN, STAIRCASE_MN[1:], stairs, strict=True
    ):
        assert max(step.forces_mN) <= MOST * max(before_mN, force_mN)
        if isinstance(result, HoldResult):
            assert result.force_target_mN == force_mN
        assert result.force_held_mN is not None
        assert result.force_uncertainty_mN is not None
        assert abs(result.force_held_mN - force_mN) < 0.3
        held_mN = step.truths_mN[-KEPT_TICKS // 2 :]
        error_mN = fsum(held_mN) / len(held_mN) - result.force_held_mN
        assert abs(error_mN) < result.force_uncertainty_mN


def test_the_true_force_of_a_calibrated_arm_has_no_higher_peak() -> None:
    """The error of its zero is excluded in the grip; the true force of each later step is
    bounded."""
    rig = taught(RIG, ("noise", "free_response", "contact_stiffness"))
    assert rig.simulation is not None
    for seed in (1, 4):
        simulation = rig.simulation.model_copy(update={"seed": seed})
        desk = Desk(rig.model_copy(update={"simulation": simulation}))
        desk.grip(STAIRCASE_MN[0])
        uncertainty_mN = max(arm.force_uncertainty_mN for arm in desk.estimates)
        assert max(desk.truths_mN) <= MOST * STAIRCASE_MN[0] + uncertainty_mN
        for before_mN, force_mN in pairwise(STAIRCASE_MN):
            desk.hold(force_mN)
            assert max(desk.truths_mN) <= MOST * max(before_mN, force_mN)


def test_references_and_voltage_continue_without_a_jump(stairs: Stairs) -> None:
    for _, step in stairs:
        changes_V = [abs(b - a) for a, b in pairwise(step.voltages_V)]
        assert max(changes_V[:5]) < 0.02
        assert max(changes_V) < RIG.limits.slew_V_per_s * RIG.rig.period_s
        forces_mN = [view.force_r_mN for view in step.views]
        per_tick_mN = 5.0 * 1.875 * RIG.rig.period_s / 1.0
        jumps_mN = [abs(b - a) for a, b in pairwise(forces_mN)]
        assert max(jumps_mN) < 1.5 * per_tick_mN


def test_the_age_of_the_zero_continues_through_a_change_of_force(stairs: Stairs) -> None:
    ages_s = [[arm.zero_age_s for arm in step.estimates] for _, step in stairs]
    for of_arm_s in zip(*ages_s, strict=True):
        assert None not in of_arm_s
        assert list(of_arm_s) == sorted(of_arm_s, key=lambda age_s: age_s or 0.0)
    uncertain_mN = [result.force_uncertainty_mN or 0.0 for result, _ in stairs]
    assert min(uncertain_mN) > 0.1


@pytest.mark.parametrize("share", [0.75, 1.3])
def test_a_part_of_another_stiffness_is_loaded_and_unloaded_too(share: float) -> None:
    assert RIG.simulation is not None
    K_e = share * RIG.part.stiffness_mN_per_um
    changes = {"simulation": {"environment_stiffness_mN_per_um": K_e}}
    desk = Desk(demo_rig(changes, time="lockstep"))
    desk.grip(10.0)
    before_mN = 10.0
    for force_mN in (20.0, 6.0, 12.0):
        result = desk.hold(force_mN)
        assert min(desk.truths_mN) > 0.8 * min(before_mN, force_mN)
        assert max(desk.forces_mN) <= MOST * max(before_mN, force_mN) + 0.1
        assert result.force_held_mN == pytest.approx(force_mN, abs=0.3)
        before_mN = force_mN


@pytest.mark.parametrize("seed", [1, 7])
def test_small_changes_of_a_large_force_neither_release_the_part_nor_jump(seed: int) -> None:
    """The position hardly changes, so that noise decides the first fits of the contact line."""
    assert RIG.simulation is not None
    simulation = RIG.simulation.model_copy(update={"seed": seed})
    desk = Desk(RIG.model_copy(update={"simulation": simulation}))
    desk.grip(9.3)
    for force_mN in (10.0, 9.4, 10.1, 20.0, 20.6):
        result = desk.hold(force_mN)
        assert (result.outcome, result.held_at_end) == ("stopped", True)
        assert result.force_held_mN == pytest.approx(force_mN, abs=0.3)
        jumps_um = [abs(b.arms[0].x_r_um - a.arms[0].x_r_um) for a, b in pairwise(desk.views)]
        assert max(jumps_um) < LARGEST_JUMP_UM


@RIGS
def test_a_stop_during_a_change_keeps_the_present_force_and_the_next_hold_continues(
    rig: RigFile,
) -> None:
    desk = Desk(rig)
    desk.grip(5.0)
    result = desk.hold(20.0, stopped_then_kept("load", 25))
    assert (result.outcome, result.force_held_mN) == ("stopped", None)
    assert desk.views[-1].phase == "stopped"
    assert 8.0 < desk.force_mN < 17.0
    result = desk.hold(20.0)
    assert result.force_held_mN == pytest.approx(20.0, abs=0.3)


@RIGS
def test_a_change_that_is_paused_rests_and_then_continues(rig: RigFile) -> None:
    desk, paused = Desk(rig), list[float]()
    desk.grip(5.0)

    def watch(on: Desk, view: Telemetry) -> None:
        if (view.phase, view.segment_tick, view.paused) == ("load", 20, False):
            on.ask("pause")
        elif view.paused:
            paused.append(view.force_r_mN)
            if len(paused) == 30:
                on.ask("resume")
        kept(on, view)

    result = desk.hold(15.0, watch)
    assert len(paused) >= 30
    assert result.force_held_mN == pytest.approx(15.0, abs=0.3)


@RIGS
def test_the_hold_ends_after_its_time_and_the_part_is_released(rig: RigFile) -> None:
    desk = Desk(rig)
    desk.grip(5.0)
    result = desk.hold(10.0, hold_s=1.5)
    assert (result.outcome, result.held_at_end) == ("released", False)
    assert [phase.phase for phase in result.phases] == ["load", "hold", "unload"]
    assert desk.truths_mN[-1] == 0.0


@RIGS
@pytest.mark.parametrize("phase", ["load", "hold"])
def test_a_release_releases_the_part(rig: RigFile, phase: str) -> None:
    desk = Desk(rig)
    desk.grip(5.0)
    result = desk.hold(10.0, at(phase, 20, "release"))
    assert (result.outcome, result.held_at_end) == ("released", False)
    assert desk.truths_mN[-1] == 0.0


@RIGS
def test_a_force_change_without_a_zero_moves_nothing_and_keeps_the_part(rig: RigFile) -> None:
    """The estimator has begun an epoch without its zero, so the force that it estimates is
    unknown."""
    desk = Desk(rig)
    desk.grip(15.0)
    planned = plan_job(HoldJobRequest(kind="hold", force_mN=20.0), rig, desk.present)
    desk.loop.bus.call(ARM["estimator"], Arm(99, 1, rig.digest()))
    before_V = desk.voltages_V[-1]

    def let_go(on: Desk, view: Telemetry) -> None:
        if view.phase == "stopped" and view.segment_tick == KEPT_TICKS:
            on.ask("release")

    desk.play(planned.program, let_go)
    frozen_V = {
        applied.arms[0].voltage_V
        for view, applied in zip(
            desk.views, (m for m in desk.heard if isinstance(m, Applied)), strict=False
        )
        if view.phase == "stopped"
    }
    assert frozen_V == {before_V}
    assert desk.views[-1].outcome == "uncertain_force"
    assert [*dict.fromkeys(view.phase for view in desk.views)] == ["stopped", "unload"]
    assert desk.truths_mN[-1] == 0.0
