"""Simulated rig that keeps its state from job to job, and an operator who handles the part.

Memory and creep of the arm are kept between jobs, as in a real arm. Grips, and the calibration
``residual``, are planned and evaluated by the supervisor's own functions.
"""

from collections.abc import Callable

from msgspec.structs import replace

from pincette.config import Calibration, RigFile
from pincette.control.planning.calibration_programs import FREE
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow
from pincette.core.faults import Outcome
from pincette.core.messages import GroundTruth, Message
from pincette.engine.composed import ComposedLoop
from pincette.engine.simulated import simulated_bench
from pincette.engine.teaching import SPEED_FACTOR, free_range_um
from pincette.records.columns import columns
from pincette.sim.bench import Bench
from pincette_study.closed_loop import StudyError, outcome
from pincette_supervisor.kinds.calibrate.requests import ResidualRequest
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.recorded_jobs import motion_of
from pincette_supervisor.plugin import RESIDUALS, Planned, Present, Run, functions_of, kind_of
from pincette_supervisor.plugin.model_in_use import motion_digest, rig_file_alone

FORCE_MAX_MN = 1e3
REST_S = 0.5
TRIES = 3
"""Number of attempts at a run without the part. Noise may end a run as a false contact, and an
operator would then repeat it too.
"""
AWAY = ResidualRequest(kind="calibrate", calibration="residual", confirm=False)


class Desk:
    """Loop of one rig, and an operator who removes its part and puts it back."""

    def __init__(self, rig: RigFile) -> None:
        self.rig, self._epoch = rig, 0
        benches: list[Bench] = []

        def set_up(told: Callable[[GroundTruth], None]) -> Bench:
            benches.append(simulated_bench(rig, told))
            return benches[0]

        self.loop = ComposedLoop(rig, set_up)
        self._bench = benches[0]

    def play(self, program: Program, known: Calibration | None = None) -> list[Message]:
        """Play a program to its end; ``known`` overrides parts of the rig file's model."""
        self._epoch += 1
        return self.loop.play(program, self._epoch, "" if known is None else known.text())

    def stroke(self, rest_s: float = REST_S) -> None:
        """Stroke twice over the identified range without the part, then rest.

        The strokes erase earlier turning points of the arm, which the model does not know. During a
        rest of some minutes its slow creep decays.
        """
        rig = self.rig
        low_V, high_V = (end_um / rig.model.piezo_um_per_V for end_um in free_range_um(rig))
        turns_V = (high_V, low_V, high_V, low_V)
        rate_V_per_s = SPEED_FACTOR * rig.grip.approach_um_per_s / rig.model.piezo_um_per_V
        moves = ((turn_V, rate_V_per_s, REST_S) for turn_V in turns_V)
        back = (0.0, rate_V_per_s, rest_s)
        path = voltage_moves([(0.0, rate_V_per_s, 0.0), *moves, back])
        # As the history is unknown, the first stroke looks like a force, so no guard may end it.
        guards = replace(FREE, force_max_mN=FORCE_MAX_MN)
        strokes = Drive("strokes", path.duration_s, courses=(Follow(path),))
        ended = outcome(self._without_part(Program((strokes,), guards, 1.0)))
        if ended != Outcome.MOVED:
            raise StudyError(f"the strokes over the taught range ended {ended!r}")

    def grip(self, profile: str) -> tuple[Planned, list[Message]]:
        """Grip the part of the rig file; raises StudyError if it cannot be planned."""
        request = GripJobRequest.model_validate({"kind": "grip", "profile": profile})
        planned = plan_job(request, self.rig)
        if planned.plan.violations:
            raise StudyError(f"a {profile} grip: {planned.plan.violations[0].message}")
        return planned, self.play(planned.program)

    def residual(self, program: Program, played: list[Message]) -> Calibration | None:
        """Repeat the voltages of a job without the part; return the errors of the model.

        Returns None if a guard ended each of ``TRIES`` attempts.
        """
        rig, period_s = self.rig, self.rig.rig.period_s
        motion = motion_of(
            columns(played, period_s),
            job="the job before",
            program=motion_digest(program),
            period_s=period_s,
            compliance_um_per_mN=rig.model.compliance_um_per_mN,
            pressed_from_mN=2.0 * rig.grip.contact_force_mN,
        )
        planned = plan_job(AWAY, rig_file_alone(rig), Present(recorded=motion))
        if planned.plan.violations:
            raise StudyError(f"without the part: {planned.plan.violations[0].message}")
        for _ in range(TRIES):
            table = columns(self._without_part(planned.program), period_s)
            found = functions_of(kind_of(AWAY)).evaluate(Run(rig, planned, table))
            values = {one["quantity"]: one["value"] for one in found.result.model_dump()["values"]}
            if RESIDUALS in values:
                return Calibration(
                    values={RESIDUALS: values[RESIDUALS]}, sources={RESIDUALS: "study"}
                )
        return None

    def _without_part(self, program: Program) -> list[Message]:
        self._bench.rig.remove_part()
        played = self.play(program)
        self._bench.rig.place_part()
        return played
