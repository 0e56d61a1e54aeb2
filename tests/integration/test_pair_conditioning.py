"""Two arms that keep their state over a restart of the programs: the forces stated by a pair grip.

Both arms are calibrated, moved by other programs, and then used by programs that do not know their
history.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from pincette.api.job_kinds import job_kinds
from pincette.api.pairs import PairResult
from pincette.config import Calibration, RigFile
from pincette.config import calibrated as calibrated_rig
from pincette.config.simulation import Amplifier
from pincette.control.planning.calibration_programs import free_program
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow
from pincette.core.messages import GroundTruth, Message
from pincette.engine.composed import ComposedLoop
from pincette.records.columns import columns
from pincette.sim.bench import Bench, open_bench
from pincette_supervisor.kinds.pairs import evaluated
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present, Run, functions_of
from pincette_supervisor.plugin.figures import series
from tests.integration.test_two_arm_jobs import lockstep
from tests.support.calibrating import REQUEST, calibrated, opened_benches, value

LEAST_V, MOST_V = -0.7, 2.6
QUANTITIES = (
    "model.free_response",
    "model.piezo_um_per_V",
    "model.creep_mN_per_decade",
    "model.forgotten_mN",
    "model.forgotten_scale_V",
)
FORCE_MN = 15.0
TRUE = ("true_force_mN", "true_second_force_mN")


@cache
def identified() -> RigFile:
    """Return the rig of two arms, each with the free response identified for it."""
    away = lockstep(bead=False)
    values: dict[str, Any] = {}
    for arm, prefix in ((1, ""), (2, "second.")):
        with opened_benches() as benches:
            record, _ = calibrated(
                away, benches, "free_response", least_V=LEAST_V, most_V=MOST_V, arm=arm
            )
        values |= {prefix + name: value(record, prefix + name) for name in QUANTITIES}
    return calibrated_rig(lockstep(), Calibration(values=values))


class Laboratory:
    """Two arms that keep their state, and the programs that are started with them."""

    def __init__(self, rig: RigFile) -> None:
        self.rig = rig
        self.told: Callable[[GroundTruth], None] | None = None
        self.bench = open_bench(rig, lambda: 0.0, self._tell)

    def _tell(self, truth: GroundTruth) -> None:
        if self.told is not None:
            self.told(truth)

    def rewire(self, rig: RigFile) -> None:
        """Give the arms in their present state other instruments without informing the programs."""
        arms = self.bench.rig.arm_states()
        self.bench = open_bench(rig, lambda: 0.0, self._tell)
        self.bench.rig.resume(arms, 1.0)

    def play(self, program: Program) -> list[Message]:
        """Start the programs and play one job."""

        def bench(told: Callable[[GroundTruth], None]) -> Bench:
            self.told = told
            return self.bench

        return ComposedLoop(self.rig, bench).play(program)

    def move(self, *stops: tuple[float, float]) -> None:
        """Move both arms to voltages in V, with a rest in s at each."""
        path = voltage_moves([(0.0, 2.0, 0.0), *((to_V, 2.0, rest_s) for to_V, rest_s in stops)])
        both = (Follow(path), Follow(path))
        self.play(free_program(Drive("past", path.duration_s, courses=both)))

    def grip(self, condition: str = "auto") -> tuple[PairResult, float]:
        """Grip with newly started programs; returns the result and the error of the force."""
        body = {"kind": "grip", "force_mN": FORCE_MN, "hold_s": 2.0}
        grip = self.rig.grip.model_copy(update={"condition": condition})
        self.rig = self.rig.model_copy(update={"grip": grip})
        present = Present(memory_known=False)
        planned = plan_job(REQUEST.validate_python(body), self.rig, present)
        assert planned.plan.violations == []
        messages = self.play(planned.program)
        table = columns(messages, self.rig.rig.period_s)
        run = Run(self.rig, planned, table, messages)
        found = functions_of(job_kinds()["grip"]).evaluate(run).result
        assert isinstance(found, PairResult)
        assert found.outcome == "gripped"
        assert found.force_held_mN is not None
        held = evaluated(run)
        true_mN = [np.mean(series(table, name)[held]) for name in TRUE]
        return found, found.force_held_mN - 0.5 * float(sum(true_mN))


def test_strokes_make_the_first_pair_grip_after_a_restart_accurate() -> None:
    found: dict[str, tuple[PairResult, float]] = {}
    for condition in ("auto", "never"):
        lab = Laboratory(identified())
        lab.move((MOST_V, 1.0), (0.0, 1.0))
        lab.move((1.8, 120.0), (0.5, 2.0), (2.3, 2.0), (0.0, 30.0))
        found[condition] = lab.grip(condition)
    (stroked, error), (plain, plain_error) = found["auto"], found["never"]
    assert stroked.force_uncertainty_mN is not None
    assert plain.force_uncertainty_mN is not None
    assert abs(error) < stroked.force_uncertainty_mN < 1.2
    assert abs(plain_error) < plain.force_uncertainty_mN
    assert stroked.stroke_change_percent is not None
    assert stroked.second_stroke_change_percent is not None
    assert not stroked.model_mismatch
    assert plain.stroke_change_percent is None


@pytest.mark.parametrize("arm", [2])
def test_a_changed_amplifier_of_either_arm_is_found_by_the_strokes(arm: int) -> None:
    lab = Laboratory(identified())
    lab.move((MOST_V, 1.0), (0.0, 30.0))
    rig = identified()
    assert rig.simulation is not None
    assert rig.simulation.second is not None
    first, other = (Amplifier(gain_ratio=1.03 if arm == number else 1.0) for number in (1, 2))
    second = rig.simulation.second.model_copy(update={"amplifier": other})
    update = {"amplifier": first, "second": second}
    changed = rig.model_copy(update={"simulation": rig.simulation.model_copy(update=update)})
    lab.rewire(changed)
    found, error = lab.grip()
    changes = found.stroke_change_percent, found.second_stroke_change_percent
    assert None not in changes
    assert found.model_mismatch
    assert changes[arm - 1] == pytest.approx(3.5, abs=1.5)
    assert changes[2 - arm] == pytest.approx(0.0, abs=0.6)
    assert found.force_uncertainty_mN is not None
    assert abs(error) < found.force_uncertainty_mN
