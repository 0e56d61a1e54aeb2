"""The first grip after a restart of the programs, on an arm whose history they do not know.

The simulated arm keeps its state: it was calibrated and moved by other programs, and is then used
by new ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from math import fsum, hypot, sqrt

import pytest

from pincette.config import Calibration, RigFile
from pincette.config import calibrated as calibrated_rig
from pincette.control.planning.calibration_programs import free_program
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow
from pincette.core.messages import Estimate, GroundTruth, Message, Sample, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette.sim.bench import Bench, open_bench
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present
from pincette_supervisor.results.archive import Record, Take, gather
from tests.support.calibrating import REQUEST, calibrated, opened_benches, value
from tests.support.rigs import Tree, demo_rig

FORCE_MN = 20.0
WIDE_LOOP: Tree = {
    "hysteresis": {"A_over_d": 0.5, "b_times_U": 1.04, "g_times_U": 0.26, "full_drive_V": 1.5}
}
RELAYS: Tree = {
    "hysteresis": None,
    "relays": {"loop_share": 0.15, "full_drive_V": 4.0, "centre_V": 1.0},
}
LEAST_V, MOST_V = -0.7, 2.6
"""Voltage range of the calibration, in V, in which an arm of relays stays within its travel."""
DEPTH_V = -0.5
"""Smallest depth of the strokes, in V."""
AFTER_S = 30.0
"""Rest at 0 V between the last motion and the restart."""


CLASSES: dict[str, Tree] = {"Bouc-Wen": WIDE_LOOP, "relays": RELAYS}


@dataclass
class Laboratory:
    """An arm that keeps its state, and the programs that are started with it."""

    rig: RigFile
    told: Callable[[GroundTruth], None] | None = None
    bench: Bench = field(init=False)

    def __post_init__(self) -> None:
        self.bench = open_bench(self.rig, lambda: 0.0, self._tell)

    def rewire(self, simulation: Tree) -> None:
        """Give the arm in its present state other instruments without informing the programs."""
        arms = self.bench.rig.arm_states()
        changed = demo_rig({"simulation": simulation}, time="lockstep")
        self.bench = open_bench(changed, lambda: 0.0, self._tell)
        self.bench.rig.resume(arms, 1.0)

    def calibrate(self, calibration: str) -> Record:
        """Remove the part, calibrate, and put the part back."""
        body = {"kind": "calibrate", "calibration": calibration}
        planned = plan_job(REQUEST.validate_python(body), self.rig)
        assert planned.plan.violations == []
        self.bench.rig.remove_part()
        messages = [
            message
            for message in self.play(planned.program)
            if not isinstance(message, Sample) or message.seq >= 0
        ]
        self.bench.rig.place_part()
        row = JobRow("job", "calibrate", self.rig.rig.name, "running", body, {}, "")
        return gather(self.rig, row, planned, Take(1, messages))

    def _tell(self, truth: GroundTruth) -> None:
        if self.told is not None:
            self.told(truth)

    def play(self, program: Program) -> list[Message]:
        """Start the programs and play one."""

        def bench(told: Callable[[GroundTruth], None]) -> Bench:
            self.told = told
            return self.bench

        return ComposedLoop(self.rig, bench).play(program)

    def move(self, *stops: tuple[float, float]) -> None:
        """Go to voltages in V, with a rest in s at each."""
        path = voltage_moves([(0.0, 2.0, 0.0), *((to_V, 2.0, rest_s) for to_V, rest_s in stops)])
        self.play(free_program(Drive("past", path.duration_s, courses=(Follow(path),))))


@cache
def identified(name: str) -> RigFile:
    """Return a rig with this class of hysteresis and the free response that was identified for
    it."""
    simulation = CLASSES[name]
    away = demo_rig({"simulation": {**simulation, "bead": False}}, time="lockstep")
    with opened_benches() as benches:
        record, _ = calibrated(away, benches, "free_response", least_V=LEAST_V, most_V=MOST_V)
    values = {
        name: value(record, name)
        for name in (
            "model.free_response",
            "model.piezo_um_per_V",
            "model.creep_mN_per_decade",
            "model.forgotten_mN",
            "model.forgotten_scale_V",
        )
    }
    rig = demo_rig({"simulation": simulation}, time="lockstep")
    return calibrated_rig(rig, Calibration(values=values))


@dataclass(frozen=True)
class Held:
    """Force that a grip held, in mN, and the change of the stroke that its result states."""

    mean_mN: float
    u_mN: float
    true_mN: float
    true_peak_mN: float
    stroke_change: float | None
    stroke_limit: float | None

    @property
    def error_mN(self) -> float:
        """Estimated mean force less the true one."""
        return self.mean_mN - self.true_mN


def first_grip(lab: Laboratory, condition: str) -> Held:
    """Start the programs, grip, and return the held force."""
    request = GripJobRequest.model_validate(
        {"kind": "grip", "force_mN": FORCE_MN, "hold_s": 2.0, "condition": condition}
    )
    planned = plan_job(request, lab.rig, Present(memory_known=False))
    assert planned.plan.violations == []
    messages = lab.play(planned.program)
    views = [message for message in messages if isinstance(message, Telemetry)]
    assert views[-1].outcome == "gripped"
    hold = [view.seq for view in views if view.phase == "hold"]
    settled = hold[len(hold) // 2 :]
    estimates = {message.seq: message for message in messages if isinstance(message, Estimate)}
    truths = [message for message in messages if isinstance(message, GroundTruth)]
    # The arm's own tick counter continues over a restart.
    ahead = truths[0].seq - min(estimates)
    true_mN = {truth.seq - ahead: truth.arms[0].force_mN for truth in truths}
    last = estimates[settled[-1]]
    return Held(
        mean_mN=fsum(estimates[seq].arms[0].force_mN for seq in settled) / len(settled),
        u_mN=last.arms[0].force_uncertainty_mN,
        true_mN=fsum(true_mN[seq] for seq in settled) / len(settled),
        true_peak_mN=max(true_mN.values()),
        stroke_change=last.arms[0].stroke_change,
        stroke_limit=last.arms[0].stroke_limit,
    )


@pytest.mark.parametrize("name", CLASSES)
def test_strokes_make_the_first_grip_after_a_restart_accurate(name: str) -> None:
    rig = identified(name)
    taught = rig.model.free_response
    assert taught is not None
    assert taught.taught_V is not None
    low_V, high_V = taught.taught_V
    assert low_V < DEPTH_V
    errors_mN: dict[str, float] = {}
    for condition in ("auto", "never"):
        lab = Laboratory(rig)
        lab.move((high_V, 1.0), (0.0, 1.0))
        lab.move((0.7 * high_V, 120.0), (0.2 * high_V, 2.0), (0.9 * high_V, 2.0), (0.0, AFTER_S))
        held = first_grip(lab, condition)
        errors_mN[condition] = held.error_mN
        assert abs(held.error_mN) < held.u_mN
        if condition == "auto":
            assert held.u_mN < 1.6
            assert held.true_peak_mN < 1.05 * FORCE_MN
    assert abs(errors_mN["auto"]) < 0.6
    assert abs(errors_mN["never"]) > abs(errors_mN["auto"])


def test_a_changed_amplifier_is_found_in_the_next_grip_and_corrected_by_a_gain_check() -> None:
    lab = Laboratory(identified("relays"))
    taught = lab.rig.model.free_response
    assert taught is not None
    assert taught.taught_V is not None
    lab.move((taught.taught_V[1], 1.0), (0.0, AFTER_S))
    before = first_grip(lab, "auto")
    assert before.stroke_change is not None
    assert before.stroke_limit is not None
    assert abs(before.stroke_change) < before.stroke_limit < 0.02
    lab.rewire({**RELAYS, "amplifier": {"gain_ratio": 1.03}})
    found = first_grip(lab, "auto")
    assert found.stroke_change is not None
    assert found.stroke_limit is not None
    assert found.stroke_limit < found.stroke_change < 0.06
    assert abs(found.error_mN) < found.u_mN
    # g*F/sqrt(3), since the sensor may be the cause.
    g_mN = 2.0 * found.stroke_change * FORCE_MN / sqrt(3.0)
    assert found.u_mN == pytest.approx(hypot(before.u_mN, g_mN), rel=0.1)
    record = lab.calibrate("gain_check")
    values = {
        quantity: value(record, quantity)
        for quantity in ("model.free_response", "model.piezo_um_per_V")
    }
    lab.rig = calibrated_rig(lab.rig, Calibration(values=values))
    renewed = first_grip(lab, "auto")
    assert renewed.stroke_change is not None
    assert renewed.stroke_limit is not None
    assert abs(renewed.stroke_change) < renewed.stroke_limit
    assert abs(renewed.error_mN) < renewed.u_mN < found.u_mN - 0.1
