"""Follows the samples of a job to their end, and passes its actions on to the rig."""

from pincette.api.endings import Ending
from pincette.api.requests import ZeroingRequest
from pincette.api.states import GOOD_OUTCOMES, STATES, Event, JobState
from pincette.bus.protocol import BusError
from pincette.core.faults import Acted, Cause, Outcome
from pincette.core.messages import Action, Applied
from pincette.core.topics import ACTION, TELEMETRY
from pincette.core.wording import fault_text
from pincette_supervisor.alarms.trips import TripReason, trip_ending
from pincette_supervisor.jobs import policies
from pincette_supervisor.jobs.controller_actions import ControllerActions
from pincette_supervisor.jobs.deafness import Silence
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_recorder import JobRecorder
from pincette_supervisor.jobs.lease import ended_words
from pincette_supervisor.jobs.missing_samples import MissingSamples
from pincette_supervisor.jobs.resumption import moving_less, resumption
from pincette_supervisor.jobs.stalls import exchange_fault, stall_words
from pincette_supervisor.jobs.tracker import Tracker, gone_words
from pincette_supervisor.jobs.watch import Watch
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.results import archive
from pincette_supervisor.rigs.observer import MessageBuffer
from pincette_supervisor.rigs.rig_context import RigContext

LOOK_S = 0.02
"""How often the run takes new messages."""
LATE_S = 0.5
"""How long the last samples of a run may come after the one that ended it."""
PROGRESS_S = 0.2
"""How often progress is published at most."""
TRIPPABLE: tuple[JobState, ...] = ("running", "pausing", "paused", "resuming", "stopping")


class JobMonitor:
    """One job from its first sample to its last."""

    def __init__(
        self,
        context: RigContext,
        job: LiveJob,
        planned: Planned,
        recorder: JobRecorder,
        collection: MessageBuffer,
    ) -> None:
        self._context, self._job, self._planned, self._recorder = context, job, planned, recorder
        self._collection = collection
        self._rig = planned.model.rig
        self._tracker = Tracker(
            job.epoch,
            self._rig.rig.period_s,
            planned.planned_s,
            lockstep=self._rig.lockstep,
            hold_at_s=planned.hold_at_s,
            thinned=archive.thinned(planned),
        )
        lease_s = policies.lease_s(job.request, self._rig)
        self._silence = Silence(context, self._tracker, job.epoch, lease_s)
        self._watch = Watch(job, planned, self._tracker, context.clock)
        self._missing = MissingSamples(planned, job.epoch, self._rig.rig.period_s)
        self._given_up = False
        """Whether it was stopped since it lacks too many samples."""
        self._last_message_at = context.observer.awake_clock()
        self._applied: Applied | None = None
        """The actuator's newest sample."""
        self._over_at: float | None = None
        self._progress_sent_at = float("-inf")
        self._actions = ControllerActions(context.bus, job, self._tracker)
        self._trip_asked = self._trip_reported = False

    def follow(self) -> None:
        """Return when the arming is over by the actuator's sample, or all programs are silent."""
        tracker, job = self._tracker, self._job
        while True:
            self._watch.look()
            messages = self._collection.drain()
            moved = tracker.update(messages)
            self._missing.follow(messages)
            if moved if self._rig.lockstep else self._actuator_published():
                self._last_message_at = self._context.observer.awake_clock()
            if moved:
                self._share()
            if tracker.over and not self._awaits_last_samples():
                self._finish()
                return
            if job.interrupted:
                self._interrupt()
                return
            if self._poll_state():
                return
            job.wait(LOOK_S)

    def _actuator_published(self) -> bool:
        """Whether a sample of the actuator came since this was last called."""
        before, self._applied = self._applied, self._context.observer.newest(Applied)
        return self._applied is not before

    def _awaits_last_samples(self) -> bool:
        """Whether samples of the last tick are on their way; in lockstep none of them is lost."""
        if self._tracker.trip or self._tracker.complete:
            return False
        now = self._context.observer.awake_clock()
        if self._over_at is None:
            self._over_at = now
        if now - self._over_at < (self._context.guard_s if self._rig.lockstep else LATE_S):
            return True
        # A busy link loses samples, and how a program ended is told once.
        self._tracker.update(self._context.observer.fetch_latest(TELEMETRY))
        return False

    def _share(self) -> None:
        """Update the progress of the run for requests and listeners."""
        job, tracker = self._job, self._tracker
        wait = self._planned.waits.get(tracker.segment)
        held = tracker.held and not tracker.over and tracker.trip is None
        waiting = None if wait is None else tracker.segment
        progress = tracker.progress(wait)
        job.update_progress(progress, held=held, waiting=waiting)
        for phase, seq, held_then in tracker.phases:
            job.begin_phase(phase, seq, held_then)
        tracker.phases.clear()
        now = self._context.clock()
        if now - self._progress_sent_at >= PROGRESS_S:
            self._progress_sent_at = now
            self._context.events.publish_progress(job.id, progress.model_dump(mode="json"))
        for action, seq in tracker.effects:
            if action == Acted.LEASE:
                self._lease_ended(seq)
            else:
                job.record_effect(action, seq)
        tracker.effects.clear()
        state = job.state
        if tracker.trip is None:
            return
        if not self._trip_reported:
            self._trip_reported = True
            words = self._context.trip_words(tracker.trip)
            self._context.alarms.raise_trip(tracker.trip, words, job.id)
        if state in TRIPPABLE:
            words, ending = self._trip_words(tracker.trip), trip_ending(tracker.trip)
            job.move("trip", words, only_from=state, ending=ending)

    def _trip_words(self, trip: TripReason) -> str:
        return f"actuator tripped: {self._context.trip_words(trip)}"

    def _lease_ended(self, seq: int) -> None:
        """Stop the job whose lease has ended at the controller."""
        context, job = self._context, self._job
        length_s = policies.lease_s(job.request, self._rig)
        words = ended_words(context.bus, length_s)
        ending = Ending(code="lease_ended", values={"limit_s": length_s})
        context.alarms.raise_alarm(
            "lease", words, severity="alarm", clears="acknowledge", job=job.id
        )
        state = job.state
        if "stop" in STATES[state].events and job.move(
            "stop", words, only_from=state, ending=ending
        ):
            self._actions.acts_since(seq)

    def _poll_state(self) -> bool:
        """Act on the state; true where nothing more is to be expected of the rig."""
        job, tracker = self._job, self._tracker
        lasts_s = self._context.observer.awake_clock() - self._last_message_at
        # Once it is over, what comes late has a limit of its own.
        silence = "" if tracker.over else self._silence.words(lasts_s, job.id)
        if self._silence.excused:
            self._last_message_at = self._context.observer.awake_clock()
        state, moves = job.snapshot
        if STATES[state].terminal:  # stopped, with a part in the gripper
            if silence:
                self._recorder.evaluate(tracker, self._collection)
                self._recorder.write(tracker, over=True)
            return bool(silence)
        if state == "aborting":
            return self._abort(silence)
        ending = Ending(code="silent", values={"silent_s": lasts_s})
        if self._watch.overdue():
            silence = f"{state} took too long: {tracker.lagging_program()} lags"
            ending = Ending(code="overdue")
        if silence:
            event: Event = "overdue" if "overdue" in STATES[state].events else "trip"
            job.move(event, silence, only_from=state, ending=ending)
        elif state == "running" and (lack := self._missing.lack):
            words, ending = lack
            self._given_up = job.move("stop", words, only_from=state, ending=ending)
        elif state == "stopping":
            if self._actions.stopped_in_hold(moves):
                self._close("confirm", over=False)
        elif state == "pausing":
            self._actions.pause(moves)
        elif state == "resuming":
            self._actions.resume(moves)
        elif state == "paused" and not tracker.paused:
            # A guard or a release has ended the pause.
            job.move("go_on", only_from="paused")
        return False

    def _abort(self, silence: str) -> bool:
        """Ask the actuator once; where it does not answer, or in time, the job has failed."""
        job = self._job
        if not self._trip_asked and self._tracker.trip is None:
            self._trip_asked = True
            self._last_message_at = self._context.observer.awake_clock()
            try:
                self._context.trip(policies.abort_trip(job.request, job.cause[:200]))
            except BusError as error:
                job.note_cause(str(error), Ending(code="unanswered"))
                self._close("fail")
                return True
            return False
        if silence or self._watch.overdue():
            late = "the actuator did not say in time that it is safe"
            job.note_cause(silence or late, Ending(code="silent" if silence else "overdue"))
            self._close("fail")
            return True
        return False

    def _finish(self) -> None:
        """End a run after its last sample."""
        job, tracker = self._job, self._tracker
        if job.terminal:
            # The job was stopped with a part held, which has now been let go.
            self._recorder.evaluate(tracker, self._collection)
            if tracker.trip is not None:
                job.append_cause(self._trip_words(tracker.trip))
            self._recorder.publish_result()
            self._recorder.write(tracker, over=True)
        elif tracker.trip is not None:
            self._close("confirm" if tracker.trip.cause == Cause.ABORT else "fail")
        elif job.state in ("stopping", "aborting"):
            self._close("fail" if self._given_up else "confirm")
        elif tracker.final_outcome() == Outcome.STOPPED:
            job.move("stop", only_from=job.state)
            self._close("confirm")
        else:
            self._close("done" if tracker.final_outcome() in GOOD_OUTCOMES else "fail")

    def _close(self, event: Event, *, over: bool = True) -> None:
        """Work out the result, move the job to its terminal state, then have the record written."""
        job, tracker = self._job, self._tracker
        gone = gone_words(self._context)
        if event == "fail":
            if tracker.trip is not None and not self._trip_asked:
                trip = tracker.trip
                took = exchange_fault(self._context, trip)
                words = [self._trip_words(trip), gone or stall_words(self._context, trip)]
                job.cause = "; ".join(filter(None, (*words, fault_text(took))))
                job.ending = trip_ending(trip if took is None else trip.with_fault(took))
            job.note_cause(tracker.final_words(), Ending(code="bad_outcome"))
        fault = self._recorder.evaluate(tracker, self._collection)
        if fault and event == "done":
            job.note_cause(fault, Ending(code="no_finding"))
            event = "fail"
        if event == "fail" and not gone and not self._trip_asked:
            self._prepare_resumption(tracker.trip)
        touched = tracker.final_outcome() == Outcome.CONTACT and not tracker.left_rest
        if touched and isinstance(job.request, ZeroingRequest):
            self._context.zero_doubt.raise_by(job.id)
        self._job.recorded.clear()  # whoever sees the end sees that the record is not there yet
        job.end(event)
        self._recorder.publish_result()
        self._recorder.write(tracker, over=over)

    def _prepare_resumption(self, trip: TripReason | None) -> None:
        """Find how a calibration goes on that a stall has tripped, or that went too far."""
        job, run = self._job, self._recorder.run
        if run is None:
            return
        found = None
        if trip is not None:
            found = resumption(job.request, run, trip)
        elif self._tracker.final_outcome() == Outcome.OVERTRAVEL:
            found = moving_less(job.request, run)
        if found is None:
            return
        job.cause = f"{job.cause}; {found.words}"
        job.next_job = found.next_job

    def _interrupt(self) -> None:
        """The supervisor ends: leave the rig stopped, a part held but for a calibration's."""
        job = self._job
        try:
            self._context.bus.call(ACTION, Action(policies.interruption(job.kind)), 0.5)
        except BusError as error:
            job.note_cause(str(error))
        self._recorder.evaluate(self._tracker, self._collection)
        self._job.recorded.clear()
        if not job.terminal:
            job.end("interrupt", "the supervisor ended", "supervisor_ended")
        self._recorder.write(self._tracker, over=True)
