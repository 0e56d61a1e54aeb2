"""Simulated rig of two arms that keeps its state from job to job, and an operator.

As in ``desk``, memory and creep of both arms are kept between jobs, and jobs are planned and
evaluated by the supervisor's own functions.
"""

from collections.abc import Callable
from typing import Any

from msgspec.structs import replace
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.api.results import JobResult
from pincette.config import Calibration, RigFile, calibrated
from pincette.control.planning.calibration_programs import FREE
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow
from pincette.core.faults import Outcome
from pincette.core.messages import GroundTruth
from pincette.engine.composed import ComposedLoop
from pincette.engine.simulated import simulated_bench
from pincette.engine.teaching import SPEED_FACTOR, free_range_um
from pincette.records.columns import Columns, columns
from pincette.sim.bench import Bench
from pincette_study.closed_loop import StudyError, outcome
from pincette_study.desk import FORCE_MAX_MN, REST_S
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Run, functions_of, kind_of

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)


class PairDesk:
    """Loop of one rig of two arms, and an operator who removes its part and puts it back."""

    def __init__(self, rig: RigFile) -> None:
        self.rig, self._epoch = rig, 0
        benches: list[Bench] = []

        def set_up(told: Callable[[GroundTruth], None]) -> Bench:
            benches.append(simulated_bench(rig, told))
            return benches[0]

        self.loop = ComposedLoop(rig, set_up)
        self._bench = benches[0]

    def play(self, body: dict[str, Any]) -> tuple[JobResult, Columns]:
        """Play a job; raises StudyError if the job is refused or does not succeed."""
        request = REQUEST.validate_python(body)
        planned = plan_job(request, self.rig)
        if planned.plan.violations:
            raise StudyError(f"{body['kind']}: {planned.plan.violations[0].message}")
        self._epoch += 1
        # A reset before the job publishes the end of the previous job again.
        messages = [
            message
            for message in self.loop.play(planned.program, self._epoch)
            if getattr(message, "epoch", self._epoch) == self._epoch
        ]
        run = Run(self.rig, planned, columns(messages, self.rig.rig.period_s), messages)
        result = functions_of(kind_of(request)).evaluate(run).result
        if result.outcome not in ("gripped", "tracked", "moved"):
            raise StudyError(f"{self.rig.rig.name}: {body['kind']} ended {result.outcome!r}")
        return result, run.table

    def taught(self) -> RigFile:
        """Identify the free response of each arm without the part; return the rig with both.

        It uses the calibration, as on hardware: ``pincette.engine.response_table`` assumes an
        unpoled arm, but an arm of relays is poled when it starts.
        """
        values: dict[str, Any] = {}
        self._bench.rig.remove_part()
        for arm in (1, 2):
            result, _ = self.play({"kind": "calibrate", "calibration": "free_response", "arm": arm})
            found = result.model_dump(mode="json")["values"]
            values |= {one["quantity"]: one["value"] for one in found}
        self._bench.rig.place_part()
        return calibrated(self.rig, Calibration(values=values))

    def stroke(self) -> None:
        """Stroke twice over the identified range without the part, and rest; see ``Desk``."""
        first, second = (_strokes(arm) for arm in self.rig.arms)
        guards = replace(FREE, force_max_mN=FORCE_MAX_MN)
        seconds = max(first.duration_s, second.duration_s)
        strokes = Drive("strokes", seconds, courses=(Follow(first), Follow(second)))
        self._epoch += 1
        self._bench.rig.remove_part()
        ended = outcome(self.loop.play(Program((strokes,), guards, 1.0), self._epoch))
        self._bench.rig.place_part()
        if ended != Outcome.MOVED:
            raise StudyError(f"the strokes over the taught range ended {ended!r}")


def _strokes(arm: RigFile) -> Path:
    low_V, high_V = (end_um / arm.model.piezo_um_per_V for end_um in free_range_um(arm))
    rate_V_per_s = SPEED_FACTOR * arm.grip.approach_um_per_s / arm.model.piezo_um_per_V
    turns = ((turn_V, rate_V_per_s, REST_S) for turn_V in (high_V, low_V, high_V, low_V))
    return voltage_moves(
        [(0.0, rate_V_per_s, 0.0), *turns, (0.0, rate_V_per_s, REST_S)],
    )
