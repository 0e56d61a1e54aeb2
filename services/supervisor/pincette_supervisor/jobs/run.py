"""Run of one job from its preparation to its end, in a thread outside the loop."""

import secrets
from collections.abc import Callable
from datetime import UTC, datetime

from pincette.api.endings import Ending, EndingCode
from pincette.api.requests import ZeroingRequest
from pincette.bus.protocol import BusError, RefusalError
from pincette.core.faults import ActionCode
from pincette.core.messages import Action
from pincette.core.topics import ACTION
from pincette.engine.arming import arm
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_monitor import JobMonitor, deadline_s
from pincette_supervisor.jobs.job_recorder import JobRecorder
from pincette_supervisor.jobs.lease import Renewal, lease_of, renewing
from pincette_supervisor.jobs.refusals import lasting_readiness, require_zero_confirmed, reset_words
from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.plugin import Planned
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.places import require_fresh
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import is_playing

KEEP_S, LOOK_S = 2.0, 0.02
"""Time within which a program hands its part over, and the interval of the checks, in s."""


def ending_code(error: BusError | StoreError) -> EndingCode:
    """Return the code of the ending of a job with an error."""
    if isinstance(error, StoreError):
        return "not_stored"
    return "refused" if isinstance(error, RefusalError) else "unanswered"


class Run:
    """Prepares and arms one job, and has it monitored."""

    def __init__(
        self, context: RigContext, job: LiveJob, plan: Callable[[LiveJob], Planned]
    ) -> None:
        self._context, self._job, self._plan = context, job, plan

    def main(self) -> None:
        """Run the job; it causes no more motion when this returns."""
        job, observer = self._job, self._context.observer
        try:
            require_zero_confirmed(self._context, job.request)
            planned = self._prepare()
            if planned is None or not self._await_start():
                return
            if (place := planned.plan.place) is not None:  # may be too old after the wait
                require_fresh(place, place.seconds_until(datetime.now(UTC)))
            job.epoch = secrets.randbits(48) | 1
            recorder = JobRecorder(self._context, job, planned, job.epoch)
            collection = observer.start_buffering()
            if self._arm(planned, recorder):
                with renewing(job.renewal):
                    JobMonitor(self._context, job, planned, recorder, collection).follow()
        except ProblemError as error:
            job.note_cause(str(error), Ending(code="plan_refused", problem=error.code))
            job.end("fail")
        except (BusError, StoreError) as error:
            job.end("fail", str(error), ending_code(error))
        finally:
            observer.stop_buffering()
            job.end("fail", "the supervisor has a fault; see its log", "internal")

    def _prepare(self) -> Planned | None:
        job = self._job
        job.move("prepare", only_from="queued")
        if job.planned is None and job.status.state == "preparing":
            job.set_plan(self._plan(job))
        planned = job.planned
        if planned is not None and job.status.state == "preparing":
            reasons = self._reasons(planned)
            if reasons:
                job.end("fail", "; ".join(reasons), "not_ready")
                return None
            self._see_deadline(planned)
        if planned is None or not job.move("prepared", only_from="preparing"):
            self._give_up()
            return None
        return planned

    def _reasons(self, planned: Planned) -> list[str]:
        """Return why the rig cannot start; clear the latch of an actuator that was switched on."""
        context = self._context
        context.health.refresh()
        found = lasting_readiness(context)
        if found.latched is not None:
            return [reset_words(context, found.latched)]
        if found.faults:
            return list(found.faults)
        context.health.clear_boot()
        if planned.begins_held:
            return self._take_over()
        return [found.taken] if found.occupant == "part" else []

    def _take_over(self) -> list[str]:
        """End a program that only holds a part, which stays held; return why that fails."""
        context = self._context
        if not is_playing(context):
            return []
        context.bus.call(ACTION, Action(ActionCode.KEEP))
        asked_at = context.clock()
        while is_playing(context):
            if context.clock() - asked_at > KEEP_S:
                return [f"the program that holds the part did not end within {KEEP_S:g} s"]
            self._job.wait(LOOK_S)
        return []

    def _see_deadline(self, planned: Planned) -> None:
        job = self._job
        limit_s = deadline_s("preparing", planned, planned.model.rig, "hold")
        spent_s = self._context.clock() - job.status.entered_at
        if limit_s is not None and spent_s > limit_s:
            words = f"preparing took {spent_s:.1f} s, limit {limit_s:g} s"
            spent = Ending(code="overdue", values={"spent_s": spent_s, "limit_s": limit_s})
            if job.move("overdue", words, only_from="preparing", ending=spent):
                job.end("fail")

    def _await_start(self) -> bool:
        job = self._job
        if job.request.autostart:
            job.move("start", only_from="ready")
        while job.status.state == "ready" and not job.interrupted:
            job.wait(0.2)
        if job.status.state == "ready":
            job.end("interrupt", "the supervisor ended", "supervisor_ended")
        return job.status.state == "running" or self._give_up()

    def _give_up(self) -> bool:
        """End a job that was stopped or aborted before it moved; return False."""
        self._job.end("confirm")
        return False

    def _arm(self, planned: Planned, recorder: JobRecorder) -> bool:
        context, job, model = self._context, self._job, planned.armed
        row = context.store.get(job.id)
        if row is None:
            return False
        if trouble := recorder.begin(row):
            job.end("fail", f"recorder: {trouble}", "not_recorded")
            return False
        job.store(epoch=str(job.epoch))
        lease = lease_of(planned.model.rig, job.request, job.epoch)
        confirmed = isinstance(job.request, ZeroingRequest) and job.request.zero_confirmed
        try:
            arm(
                context.bus,
                planned.program,
                epoch=job.epoch,
                digest=model.rig_file_digest,
                calibration=model.calibration.text(),
                lease=lease,
                zero_confirmed=confirmed,
            )
        except BusError as error:
            recorder.discard(row)
            # An abort that came while the rig was being armed has latched the actuator.
            ending = isinstance(error, RefusalError) and job.status.state in (
                "stopping",
                "aborting",
            )
            job.end("confirm" if ending else "fail", str(error), ending_code(error))
            return False
        if lease is not None:
            job.renewal = Renewal(context.bus, lease)
        if confirmed:
            context.zero_doubt.settle()
        context.health.note_armed(job.epoch, model.digest)
        job.record_effect("start", 0)
        return True
