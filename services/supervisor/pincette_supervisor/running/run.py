"""One job from its preparation to its end, in a thread of its own; never inside the loop."""

import secrets
from time import monotonic

from pincette.api.states import GOOD_OUTCOMES, STATES, Event
from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Act, Trip
from pincette.runtime.arming import arm
from pincette.topics import ACT, TRIP
from pincette_supervisor.results import archive, calibration_record
from pincette_supervisor.results.archive import Take
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.observer import Collection
from pincette_supervisor.running.silence import gone_words, silent_words
from pincette_supervisor.running.site import Site
from pincette_supervisor.running.tracker import Tracker, outcome_words

LOOK_S = 0.02
"""How often the run looks at what has come."""


class Run:
    """Prepares, plays and watches one job, and writes its record."""

    def __init__(self, site: Site, job: LiveJob) -> None:
        self._site, self._job = site, job
        self._epoch = secrets.randbits(48) | 1
        self._rig = job.planned.model.rig
        planned_s = job.planned.planned_s
        self._planned_s = planned_s
        self._tracker = Tracker(
            self._epoch, self._rig.rig.period_s, planned_s, lockstep=self._rig.lockstep
        )
        self._heard_at = self._asked_at = monotonic()
        """When the rig was last heard of, and when it was last asked for something."""
        self._stop_asked = self._trip_asked = False
        self.interrupted = False
        """Set where the supervisor ends."""

    def main(self) -> None:
        """Live the job; the rig is free when this returns."""
        job, observer = self._job, self._site.observer
        try:
            if not self._prepare() or not self._await_start():
                return
            collection = observer.collect()
            if self._arm():
                self._watch(collection)
        except BusError as error:
            job.end("fail", str(error))
        finally:
            observer.stop_collecting()
            try:
                job.end("fail", "the supervisor has a fault; its log says more")
            finally:
                job.finish()

    def _prepare(self) -> bool:
        job, health = self._job, self._site.health
        job.move("prepare", only_from="queued")
        if job.state == "preparing":
            health.refresh(force=True)
            reasons = self._site.reasons()
            if not reasons:
                health.clear_boot()
                reasons = [f"actuator: latched ({cause})"] if (cause := health.latched()) else []
            if reasons:
                job.end("fail", "; ".join(reasons))
                return False
        return job.move("prepared", only_from="preparing") or self._give_up()

    def _await_start(self) -> bool:
        job = self._job
        if job.autostart:
            job.move("start", only_from="ready")
        while job.state == "ready" and not self.interrupted:
            job.wait(0.2)
        if job.state == "ready":
            job.end("interrupt", "the supervisor ended")
        return job.state == "running" or self._give_up()

    def _give_up(self) -> bool:
        """End a job that was stopped or aborted before it moved."""
        self._job.end("confirm")
        return False

    def _arm(self) -> bool:
        site, job, model = self._site, self._job, self._job.planned.model
        self._asked_at = monotonic()
        try:
            arm(
                site.bus,
                job.planned.program,
                epoch=self._epoch,
                digest=model.rig_file_digest,
                calibration=model.calibration.text(),
            )
        except RefusalError as error:
            # An abort that came while the rig was being armed has latched the actuator.
            job.end("fail" if job.state == "running" else "confirm", str(error))
            return False
        site.health.note_armed(self._epoch, model.digest)
        job.acted("start", 0)
        return True

    def _watch(self, collection: Collection) -> None:
        """Follow the samples until the actuator has said that the arming is over."""
        tracker, job = self._tracker, self._job
        while True:
            if tracker.take(collection.drain()):
                self._heard_at = monotonic()
                self._share()
            if tracker.over:
                self._conclude(collection)
                return
            if self.interrupted:
                self._interrupt(collection)
                return
            if self._given_up(collection):
                return
            job.wait(LOOK_S)

    def _share(self) -> None:
        """Let requests see how far the run is."""
        job, tracker = self._job, self._tracker
        wait = job.planned.waits.get(tracker.segment)
        job.progress = tracker.progress(wait)
        job.wait_at(None if wait is None else tracker.segment)
        job.held = tracker.held and not tracker.over and not tracker.trip_cause
        job.phase = tracker.phase
        for action, seq in tracker.acted:
            job.acted(action, seq)
        tracker.acted.clear()
        state = job.state
        if tracker.trip_cause and state in ("running", "stopping"):
            job.move("trip", tracker.trip_words(), only_from=state)

    def _given_up(self, collection: Collection) -> bool:
        """Do what the state asks for; true where nothing more is to be expected of the rig."""
        job, tracker = self._job, self._tracker
        silence = silent_words(self._site, tracker, self._heard_at, self._asked_at)
        state = job.state
        if job.terminal:  # stopped, with a part in the gripper
            return bool(silence)
        if state == "aborting":
            return self._abort(collection, silence)
        if self._overdue():
            silence = f"{state} took too long: {tracker.silent()} lags"
        if silence:
            job.move("overdue", silence, only_from=state)
        elif state == "stopping":
            self._stop(collection)
        return False

    def _stop(self, collection: Collection) -> None:
        """Ask the controller once; a part that it holds makes the stop complete."""
        job, tracker = self._job, self._tracker
        if not self._stop_asked:
            self._stop_asked = True
            try:
                self._site.bus.ask(ACT, Act("stop"))
            except RefusalError:
                return  # the program has just ended; its last sample is on its way
            except BusError as error:
                job.move("overdue", str(error), only_from="stopping")
        if tracker.stop_acted and tracker.held:
            self._close(collection, "confirm")

    def _abort(self, collection: Collection, silence: str) -> bool:
        """Ask the actuator once; where it does not answer, or in time, the job has failed."""
        job = self._job
        if not self._trip_asked and not self._tracker.trip_cause:
            self._trip_asked = True
            self._asked_at = monotonic()
            cause = f"supervisor: {job.cause}"[:200] if job.cause else "abort"
            try:
                self._site.bus.ask(TRIP, Trip(cause), 1.0)
            except BusError as error:
                job.blame(str(error))
                self._close(collection, "fail")
                return True
            return False
        if silence or self._overdue():
            job.blame(silence or "the actuator did not say in time that it is safe")
            self._close(collection, "fail")
            return True
        return False

    def _overdue(self) -> bool:
        job, safety = self._job, self._rig.safety
        state = STATES[job.state]
        if state.deadline_s is None or (state.beyond == "program" and self._planned_s is None):
            return False
        beyond_s = {
            "": 0.0,
            "program": self._planned_s or 0.0,
            "freeze": safety.freeze_s + safety.ramp_s,
        }[state.beyond]
        return monotonic() - job.entered_at > state.deadline_s + beyond_s

    def _conclude(self, collection: Collection) -> None:
        """End a run whose last sample has come."""
        job, tracker = self._job, self._tracker
        if job.terminal:
            # A stop had kept a part, and this is how it was let go.
            self._record(collection)
            if tracker.trip_cause:
                job.amend(tracker.trip_words())
        elif tracker.trip_cause:
            self._close(collection, "confirm" if tracker.trip_cause == "abort" else "fail")
        elif job.state in ("stopping", "aborting"):
            self._close(collection, "confirm")
        elif tracker.ending() == "stopped":
            job.move("stop", only_from="running")
            self._close(collection, "confirm")
        else:
            good = tracker.ending() in GOOD_OUTCOMES
            self._close(collection, "done" if good else "fail")

    def _close(self, collection: Collection, event: Event) -> None:
        """Write the record, then let the state say that the job has ended."""
        job, tracker = self._job, self._tracker
        if event == "fail":
            if tracker.trip_cause and not self._trip_asked:
                gone = gone_words(self._site)
                job.cause = f"{tracker.trip_words()}; {gone}" if gone else tracker.trip_words()
            job.blame(outcome_words(tracker.ending()))
        fault = self._record(collection)
        if fault and event == "done":
            job.blame(fault)
            event = "fail"
        job.end(event)

    def _record(self, collection: Collection) -> str:
        """Keep result and record; returns why the samples do not give what was asked for."""
        site, job = self._site, self._job
        row = site.store.get(job.id)
        if row is None:
            return ""
        take = Take(self._epoch, self._tracker.messages, collection.dropped)
        calibrates = job.planned.plan.kind == "calibrate"
        gather = calibration_record.gather if calibrates else archive.gather
        record = site.archivist.submit(gather, self._rig, row, job.planned, take).result()
        job.keep_result(record.tree)
        try:
            site.archivist.submit(record.write, site.records / job.id).result()
        except OSError as error:
            job.blame(f"the record is incomplete: {error}")
        return record.fault

    def _interrupt(self, collection: Collection) -> None:
        """The supervisor ends: leave the rig stopped, holding what it holds."""
        try:
            self._site.bus.ask(ACT, Act("stop"), 0.5)
        except BusError as error:
            self._job.blame(str(error))
        if not self._job.terminal:
            self._record(collection)
            self._job.end("interrupt", "the supervisor ended")
