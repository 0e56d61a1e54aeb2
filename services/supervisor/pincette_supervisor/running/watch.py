"""Follows the samples of a job to their end, and asks the rig for what the job's state asks for."""

from pincette.api.states import GOOD_OUTCOMES, STATES, Event, JobState
from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Act, Done, Message
from pincette.topics import ACT, APPLIED, TELEMETRY, TRIP
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.running import deadlines, policies
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.keeping import Keeper
from pincette_supervisor.running.lease import LEASE_ENDED, ended_words
from pincette_supervisor.running.observer import Collection
from pincette_supervisor.running.silence import gone_words, silent_words
from pincette_supervisor.running.site import Site
from pincette_supervisor.running.tracker import Tracker, outcome_words

LOOK_S = 0.02
"""How often the run looks at what has come."""
LATE_S = 0.5
"""How long the last samples of a run may come after the one that ended it."""
PROGRESS_S = 0.2
"""How often progress is told at most."""
TRIPPABLE: tuple[JobState, ...] = ("running", "pausing", "paused", "resuming", "stopping")


class Watch:
    """One job from its first sample to its last."""

    def __init__(
        self, site: Site, job: LiveJob, planned: Planned, keeper: Keeper, collection: Collection
    ) -> None:
        self._site, self._job, self._planned, self._keeper = site, job, planned, keeper
        self._collection = collection
        self._rig = planned.model.rig
        self._tracker = Tracker(
            job.epoch, self._rig.rig.period_s, planned.planned_s, lockstep=self._rig.lockstep
        )
        self._heard_at = site.observer.waking()
        self._applied: Message | None = None
        """What the actuator said last."""
        self._over_at: float | None = None
        self._told_at = float("-inf")
        self._asked_in = -1
        """Count of the job's moves when the controller was last asked for something."""
        self._acts_from: int | None = None
        """The seq at which what was asked for acts; None where it was refused."""
        self._trip_asked = self._pause_asked = self._trip_told = False

    def follow(self) -> None:
        """Return when the actuator has said that the arming is over, or nobody says anything."""
        tracker, job = self._tracker, self._job
        while True:
            moved = tracker.take(self._collection.drain())
            if moved if self._rig.lockstep else self._actuator_spoke():
                self._heard_at = self._site.observer.waking()
            if moved:
                self._share()
            if tracker.over and not self._comes_more():
                self._conclude()
                return
            if job.interrupted:
                self._interrupt()
                return
            if self._given_up():
                return
            job.wait(LOOK_S)

    def _actuator_spoke(self) -> bool:
        """Whether the actuator has said something since this was last asked."""
        before, self._applied = self._applied, self._site.observer.newest(APPLIED)
        return self._applied is not before

    def _comes_more(self) -> bool:
        """Whether samples of the last tick are on their way: in lockstep none of them is lost."""
        if self._tracker.trip_cause or self._tracker.complete:
            return False
        now = self._site.observer.waking()
        if self._over_at is None:
            self._over_at = now
        if now - self._over_at < (self._site.guard_s if self._rig.lockstep else LATE_S):
            return True
        # A busy link loses samples, and how a program ended is told once.
        self._tracker.take(self._site.observer.asked_anew(TELEMETRY))
        return False

    def _share(self) -> None:
        """Let requests and listeners see how far the run is."""
        job, tracker = self._job, self._tracker
        wait = self._planned.waits.get(tracker.segment)
        held = tracker.held and not tracker.over and not tracker.trip_cause
        waiting = None if wait is None else tracker.segment
        progress = tracker.progress(wait)
        job.share(progress, phase=tracker.phase, held=held, waiting=waiting)
        now = self._site.clock()
        if now - self._told_at >= PROGRESS_S:
            self._told_at = now
            self._site.events.progress(job.id, progress.model_dump(mode="json"))
        for action, seq in tracker.acted:
            if action == LEASE_ENDED:
                self._stopped_by_itself(seq)
            else:
                job.acted(action, seq)
        tracker.acted.clear()
        state = job.state
        if tracker.trip_cause and not self._trip_told:
            self._trip_told = True
            words = self._site.trip_words(tracker.trip_cause)
            self._site.alarms.tripped(tracker.trip_cause, words, job.id)
        if tracker.trip_cause and state in TRIPPABLE:
            job.move("trip", self._trip_words(), only_from=state)

    def _trip_words(self) -> str:
        return f"actuator tripped: {self._site.trip_words(self._tracker.trip_cause)}"

    def _stopped_by_itself(self, seq: int) -> None:
        """The controller has heard nothing of this program for the length of the lease."""
        site, job = self._site, self._job
        words = ended_words(site.bus, self._rig.safety.lease_s)
        site.alarms.raised("lease", words, severity="alarm", clears="acknowledge", job=job.id)
        state = job.state
        if "stop" in STATES[state].events and job.move("stop", words, only_from=state):
            # It acts already: asked again, it would begin anew.
            self._asked_in, self._acts_from = job.moves, seq

    def _given_up(self) -> bool:
        """Do what the state asks for; true where nothing more is to be expected of the rig."""
        job, tracker = self._job, self._tracker
        lasts_s = self._site.observer.waking() - self._heard_at
        # Once it is over, what comes late has a limit of its own.
        silence = "" if tracker.over else silent_words(self._site, tracker, lasts_s)
        state, moves = job.standing
        if STATES[state].terminal:  # stopped, with a part in the gripper
            if silence:
                self._keeper.keep(tracker, self._collection, over=True)
            return bool(silence)
        if state == "aborting":
            return self._abort(silence)
        if self._overdue():
            silence = f"{state} took too long: {tracker.silent()} lags"
        if silence:
            event: Event = "overdue" if "overdue" in STATES[state].events else "trip"
            job.move(event, silence, only_from=state)
        elif state == "stopping":
            self._stop(moves)
        elif state == "pausing":
            self._pause(moves)
        elif state == "resuming":
            self._resume(moves)
        elif state == "paused" and not tracker.paused:
            # A guard or a release has ended the pause.
            job.move("go_on", only_from="paused")
        return False

    def _ask_once(self, act: Act, state: JobState, moves: int) -> bool:
        """Ask the controller once in a state; false where it refuses, or does not answer."""
        job = self._job
        if self._asked_in == moves:
            return self._acts_from is not None
        self._asked_in, self._acts_from = moves, None
        try:
            reply = self._site.bus.ask(ACT, act)
        except RefusalError:
            return False  # the program has just ended; its last sample is on its way
        except BusError as error:
            job.move("overdue", str(error), only_from=state)
            return False
        self._acts_from = reply.seq if isinstance(reply, Done) else self._tracker.told_seq
        return True

    def _acts(self) -> bool:
        """Whether the controller's newest sample is one at which what was asked for acts."""
        return self._acts_from is not None and self._tracker.told_seq >= self._acts_from

    def _stop(self, moves: int) -> None:
        """Ask the controller once; a part that a stop keeps makes the stop complete."""
        tracker, request = self._tracker, self._job.request
        self._ask_once(policies.stop_act(request), "stopping", moves)
        if tracker.stop_acted and tracker.held and policies.on_stop(request) == "hold":
            self._close("confirm", over=False)

    def _pause(self, moves: int) -> None:
        self._pause_asked = True
        self._ask_once(Act("pause"), "pausing", moves)
        if self._acts() and self._tracker.paused:
            self._job.move("rest", only_from="pausing")

    def _resume(self, moves: int) -> None:
        """Go on where the pause began, or where it had not begun, take the wish back."""
        taken = not self._pause_asked or self._ask_once(Act("resume"), "resuming", moves)
        if taken and self._pause_asked and not (self._acts() and not self._tracker.paused):
            return
        self._pause_asked = False
        self._job.move("go_on", only_from="resuming")

    def _abort(self, silence: str) -> bool:
        """Ask the actuator once; where it does not answer, or in time, the job has failed."""
        job = self._job
        if not self._trip_asked and not self._tracker.trip_cause:
            self._trip_asked = True
            self._heard_at = self._site.observer.waking()
            cause = f"supervisor: {job.cause}"[:200] if job.cause else "abort"
            try:
                self._site.bus.ask(TRIP, policies.abort_trip(job.request, cause), 1.0)
            except BusError as error:
                job.blame(str(error))
                self._close("fail")
                return True
            return False
        if silence or self._overdue():
            job.blame(silence or "the actuator did not say in time that it is safe")
            self._close("fail")
            return True
        return False

    def _overdue(self) -> bool:
        job = self._job
        on_stop = policies.on_stop(job.request)
        limit_s = deadlines.limit_s(job.state, self._planned, self._rig, on_stop)
        spent_s = self._site.clock() - job.entered_at
        if job.state == "running":
            # In lockstep a machine may take as long as it likes for what is played.
            lockstep = self._rig.lockstep
            spent_s = self._tracker.played_s if lockstep else spent_s + job.played_s
        return limit_s is not None and spent_s > limit_s

    def _conclude(self) -> None:
        """End a run whose last sample has come."""
        job, tracker = self._job, self._tracker
        if job.terminal:
            # A stop had kept a part, and this is how it was let go.
            self._keeper.keep(tracker, self._collection, over=True)
            if tracker.trip_cause:
                job.amend(self._trip_words())
            self._keeper.tell()
        elif tracker.trip_cause:
            self._close("confirm" if tracker.trip_cause == "abort" else "fail")
        elif job.state in ("stopping", "aborting"):
            self._close("confirm")
        elif tracker.ending() == "stopped":
            job.move("stop", only_from=job.state)
            self._close("confirm")
        else:
            self._close("done" if tracker.ending() in GOOD_OUTCOMES else "fail")

    def _close(self, event: Event, *, over: bool = True) -> None:
        """Write the record, then let the state say that the job has ended."""
        job, tracker = self._job, self._tracker
        if event == "fail":
            if tracker.trip_cause and not self._trip_asked:
                gone = gone_words(self._site)
                words = self._trip_words()
                job.cause = f"{words}; {gone}" if gone else words
            job.blame(outcome_words(tracker.ending()))
        fault = self._keeper.keep(tracker, self._collection, over=over)
        if fault and event == "done":
            job.blame(fault)
            event = "fail"
        job.end(event)
        self._keeper.tell()

    def _interrupt(self) -> None:
        """The supervisor ends: leave the rig stopped, holding what it holds."""
        job = self._job
        try:
            self._site.bus.ask(ACT, Act("stop"), 0.5)
        except BusError as error:
            job.blame(str(error))
        self._keeper.keep(self._tracker, self._collection, over=True)
        if not job.terminal:
            job.end("interrupt", "the supervisor ended")
