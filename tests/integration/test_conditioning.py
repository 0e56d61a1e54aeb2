"""The first grip after a restart of the programs, on an arm whose past they have not followed.

The simulated arm lives on: it was calibrated, moved by others, and is then met by new programs.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import fsum

import pytest
from msgspec import UNSET, UnsetType

from pincette.config import Calibration, RigFile
from pincette.config import calibrated as calibrated_rig
from pincette.control.planning.calibration_programs import free_program
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.program import Program, Segment
from pincette.core.messages import Estimate, GroundTruth, Message, Telemetry
from pincette.core.messages.second import SecondTruth
from pincette.engine.composed import ComposedLoop
from pincette.sim.bench import Bench, open_bench
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.present import Present
from tests.support.calibrating import calibrated, opened_benches, value
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
"""Of the calibration, so that an arm of relays stays within its travel."""
DEPTH_V = -0.5
"""Depth of the strokes, at the least."""
AFTER_S = 30.0
"""Rest at 0 V between the last motion and the restart."""


@dataclass
class Laboratory:
    """An arm that lives on, and the programs that are started beside it."""

    rig: RigFile
    told: Callable[[GroundTruth], None] | None = None
    bench: Bench = field(init=False)

    def __post_init__(self) -> None:
        self.bench = open_bench(self.rig, lambda: 0.0, self._tell)

    def _tell(
        self,
        seq: int,
        x_um: float,
        force_mN: float,
        voltage_V: float,
        second: SecondTruth | UnsetType = UNSET,
    ) -> None:
        if self.told is not None:
            self.told(GroundTruth(seq, x_um, force_mN, voltage_V, second))

    def play(self, program: Program) -> list[Message]:
        """Start the programs and play one."""

        def bench(told: Callable[[GroundTruth], None]) -> Bench:
            self.told = told
            return self.bench

        return ComposedLoop(self.rig, bench).play(program)

    def move(self, *stops: tuple[float, float]) -> None:
        """Go to voltages in V, with a rest in s at each."""
        path = voltage_moves([(0.0, 2.0, 0.0), *((to_V, 2.0, rest_s) for to_V, rest_s in stops)])
        self.play(free_program(Segment("past", "voltage", path.duration_s, path=path)))


def identified(simulation: Tree) -> RigFile:
    """A rig with the free response that its calibration finds."""
    away = demo_rig({"simulation": {**simulation, "bead": False}}, time="lockstep")
    with opened_benches() as benches:
        record, _ = calibrated(away, benches, "free_response", least_V=LEAST_V, most_V=MOST_V)
    values = {
        name: value(record, name)
        for name in ("model.free_response", "model.piezo_um_per_V", "model.creep_mN_per_decade")
    }
    rig = demo_rig({"simulation": simulation}, time="lockstep")
    return calibrated_rig(rig, Calibration(values=values))


def first_grip(lab: Laboratory, condition: str) -> tuple[float, float, float, float]:
    """Mean force held as estimated, its uncertainty, the true one, and the true peak, in mN."""
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
    # The arm's own count of ticks goes on over a restart.
    ahead = truths[0].seq - min(estimates)
    true_mN = {truth.seq - ahead: truth.force_mN for truth in truths}
    return (
        fsum(estimates[seq].force_mN for seq in settled) / len(settled),
        estimates[settled[-1]].force_uncertainty_mN,
        fsum(true_mN[seq] for seq in settled) / len(settled),
        max(true_mN.values()),
    )


@pytest.mark.parametrize("simulation", [WIDE_LOOP, RELAYS], ids=["Bouc-Wen", "relays"])
def test_strokes_make_the_first_grip_after_a_restart_true(simulation: Tree) -> None:
    rig = identified(simulation)
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
        held_mN, u_mN, true_mN, peak_mN = first_grip(lab, condition)
        errors_mN[condition] = held_mN - true_mN
        assert abs(held_mN - true_mN) < u_mN
        if condition == "auto":
            assert u_mN < 1.0
            assert peak_mN < 1.05 * FORCE_MN
    assert abs(errors_mN["auto"]) < 0.6
    assert abs(errors_mN["never"]) > abs(errors_mN["auto"])
