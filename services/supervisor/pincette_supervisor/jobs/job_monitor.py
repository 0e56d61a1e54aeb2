"""Monitoring of a job: processes its samples until the last one, and passes its actions to the
rig."""

from collections.abc import Callable, Mapping
from itertools import takewhile
from time import monotonic
from typing import cast

from pincette.api.endings import Ending
from pincette.api.recovery import CASES, Recovery, RecoveryCase
from pincette.api.requests import ContactJobRequest, OnStop, ZeroingRequest
from pincette.api.states import STATES, JobState
from pincette.bus.protocol import BusError, RefusalError
from pincette.config import RigFile
from pincette.core.faults import Acted, ActionCode, Cause, Fault, FaultCode, Outcome, Phase, fault
from pincette.core.messages import Ack, Action, Applied
from pincette.core.topics import ACTION, TELEMETRY
from pincette.core.wording import fault_text
from pincette.engine.measuring.kept import asked, how, kept
from pincette.latency.advice import age_change
from pincette.latency.rule import TAIL
from pincette_supervisor.alarms import TripReason, trip_ending
from pincette_supervisor.jobs.decide import (
    Ask,
    Asked,
    AskTrip,
    Close,
    Command,
    Complete,
    Facts,
    Interrupt,
    Move,
    TakeDefault,
    Why,
    decide,
)
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_recorder import JobRecorder
from pincette_supervisor.jobs.lease import ended_words, interruption, lease_end, lease_s
from pincette_supervisor.jobs.planner import repeated
from pincette_supervisor.jobs.silence_detector import SilenceDetector
from pincette_supervisor.jobs.tracker import MissingSamples, Tracker, gone_words
from pincette_supervisor.plugin import Interruption, Planned, functions_of, kind_of
from pincette_supervisor.results import archive
from pincette_supervisor.results.camera import Moment
from pincette_supervisor.rigs.observer import MessageBuffer
from pincette_supervisor.rigs.rig_context import RigContext

# Check of a job's time limit, by the time in which the supervisor was running. An exceeded limit
# means that a rig does not do what was requested. While the supervisor was not scheduled, it could
# not see the progress: that time does not count.

STANDSTILL_S = 0.25
"""Longest normal interval between two checks, in s; the excess counts as a scheduling stall."""

RELEASING = ("unload", "release", "retreat")
"""Phases that a stop plays if ``on_stop`` releases the part."""


class Watch:
    """Time limits of one job."""

    def __init__(
        self,
        job: LiveJob,
        planned: Planned,
        tracker: Tracker,
        clock: Callable[[], float],
        look_clock: Callable[[], float] = monotonic,
    ) -> None:
        """Create the time limits.

        ``clock`` measures the time in each state, ``look_clock`` the time between two checks.
        """
        self._job, self._planned, self._tracker = job, planned, tracker
        self._clock, self._look_clock = clock, look_clock
        self._looked_s = look_clock()
        self._missed_s = self._missed_before_s = 0.0
        self._moves = -1

    def look(self) -> None:
        """Check the clock once, and add the time of a scheduling stall."""
        now_s = self._look_clock()
        missed_s = max(0.0, now_s - self._looked_s - STANDSTILL_S)
        self._looked_s = now_s
        moves = self._job.status.moves
        if moves != self._moves:
            self._moves, self._missed_before_s = moves, self._missed_s
        self._missed_s += missed_s

    def overdue(self) -> bool:
        """Return whether the time limit of the job's state has passed."""
        request, status, rig = self._job.request, self._job.status, self._planned.model.rig
        on_stop = kind_of(request).stop_of(request)
        limit_s = deadline_s(status.state, self._planned, rig, on_stop)
        spent_s = self._clock() - status.entered_at
        running = status.state == "running"
        if rig.lockstep:
            # The time that the machine needs to play the program is not limited.
            spent_s = self._tracker.played_s if running else spent_s
        elif running:
            spent_s += status.played_s - self._missed_s
        else:
            spent_s -= self._missed_s - self._missed_before_s
        return limit_s is not None and spent_s > limit_s


def deadline_s(
    state: JobState, planned: Planned | None, rig: RigFile, on_stop: OnStop
) -> float | None:
    """Return the time limit of a state, in s; None if it may last indefinitely."""
    row = STATES[state]
    if row.deadline_s is None:
        return None
    if row.beyond == "" or planned is None:
        return row.deadline_s
    if row.beyond == "freeze":
        return row.deadline_s + rig.safety.freeze_s + rig.safety.ramp_s
    if row.beyond == "letting_go":
        return row.deadline_s + (0.0 if on_stop == "hold" else _release_s(planned))
    if state == "running" and planned.planned_s is None:
        return None  # the program has no end, but a pause must still begin in time
    return row.deadline_s + planned.plan.duration_s


def _release_s(planned: Planned) -> float:
    """Return the planned duration of the release, in s; of several grips, that of the last one."""
    last = takewhile(lambda item: item.phase != "contact", reversed(planned.plan.phases))
    return sum(item.duration_s or 0.0 for item in last if item.phase in RELEASING)


# Timing that a machine has achieved before a trip by the age of commands, and suitable settings.


def silence_s(rig: RigFile, reason: TripReason) -> float | None:
    """Return the time without a command before a trip by a stall, in s; None for another trip.

    If further faults were found, such as a failed reading, they caused the silence, and the result
    is None. It is also None in lockstep, which has no clock.
    """
    codes = [one.code for one in reason.faults]
    if rig.lockstep or reason.cause != Cause.COMMAND_AGE or codes != [FaultCode.NO_COMMAND]:
        return None
    return next((item.value for item in reason.faults[0].values if item.name == "silent_s"), None)


INSTRUMENTS = {"sensor": "sensor", "actuator": "output"}
"""Instrument of each program that uses one."""


def exchange_fault(context: RigContext, reason: TripReason) -> Fault | None:
    """Return the duration of the newest instrument exchanges for a trip by age; otherwise None.

    Queries the programs, so that exchanges shortly before the trip are included.
    """
    if context.rig.lockstep or reason.cause != Cause.COMMAND_AGE:
        return None
    context.health.refresh(force=True)
    values: dict[str, float] = {}
    for program, times in context.health.exchanges().items():
        for arm, took in enumerate(times):
            name = f"{'second_' if arm else ''}{INSTRUMENTS[program]}"
            values |= {
                f"{name}_minimum_s": took.minimum_s,
                f"{name}_median_s": took.median_s,
                f"{name}_worst_s": took.worst_s,
            }
    return fault(FaultCode.EXCHANGE_TIMES, **values) if values else None


def stall_words(context: RigContext, reason: TripReason) -> str:
    """Return what delayed this machine and what to change, in words; empty for another trip."""
    rig = context.rig
    silent_s = silence_s(rig, reason)
    if silent_s is None:
        return ""
    ages = context.observer.counters.ages()
    transit_s = ages.quantile_s(TAIL) or rig.realtime.computing_s
    told = [
        f"the machine stalled, unless a program hung: commands came within "
        f"{1e3 * ages.max_s:.0f} ms of their samples, p99.9 {1e3 * transit_s:.0f} ms"
    ]
    known = kept(context.records.parent)
    late_s = max(0.0, silent_s - rig.rig.period_s)
    if known is not None:
        late_s = max(late_s, *(one.lateness.max_s for one in known.wake_ups))
    change = age_change(asked(rig), late_s, transit_s)
    told += [] if change is None else [f"a setting that fits this machine: {change.words()}"]
    return "; ".join([*told, how(rig)])


LOOK_S = 0.02
"""Interval at which the run processes new messages, in s."""
LATE_S = 0.5
"""Time within which the last samples of a run may arrive after the sample that ended it, in s."""
PROGRESS_S = 0.2
"""Shortest interval between two progress events, in s."""
CUT_SHORT: Why = (
    "the part was released while it was loaded: the requested force was not reached",
    Ending(code="requested"),
)
PICTURED: Mapping[str, Moment] = {Phase.LOAD: "contact", Phase.HOLD: "hold"}
"""Phases at whose beginning the camera takes a picture."""
TOUCHED = (Outcome.CONTACT, Outcome.OVERFORCE)
"""Outcomes of a job in which something presses on the arm."""


class JobMonitor:
    """Monitors one job from its first sample to its last."""

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
        length_s = lease_s(job.request, self._rig)
        self._silence = SilenceDetector(context, self._tracker, job.epoch, length_s)
        self._watch = Watch(job, planned, self._tracker, context.clock)
        self._missing = MissingSamples(planned, job.epoch, self._rig.rig.period_s)
        self._last_message_at = context.observer.suspend_aware_clock()
        self._applied: Applied | None = None
        """Newest sample of the actuator."""
        self._over_at: float | None = None
        self._last_fetched = False
        """True once the controller's last sample was fetched, because samples did not arrive."""
        self._progress_sent_at = float("-inf")
        self._lease: Why | None = None
        """Reason why the controller has stopped at the end of its lease; None if it has not."""
        self._lease_seq = -1
        """Number of the sample at which the controller has stopped at the end of its lease."""
        self._moves = 0
        """Number of the job's state changes at the last check."""
        self._asked_in = -1
        """Number of the job's state changes at the last command to the controller."""
        self._effective_seq: int | None = None
        """Number of the sample at which the last command takes effect; None if it was rejected."""
        self._recovery: Recovery | None = None
        """Recovery of the request, once the job waits for a decision."""
        self._pause_asked = self._given_up = False
        self._trip_asked = self._trip_reported = False

    def follow(self) -> None:
        """Monitor the job until a sample of the actuator ends the arming, or all programs are
        silent.
        """
        try:
            while True:
                facts = self._look()
                command = decide(facts)
                if command is not None and self._obey(command, facts.state):
                    return
                self._job.wait(LOOK_S)
        except BaseException:
            if self._recovery is not None:  # otherwise nothing waits for the record
                self._job.finish_record()
            raise

    def _look(self) -> Facts:
        """Process new messages, publish the progress, and return the facts for the next command."""
        tracker, job = self._tracker, self._job
        self._watch.look()
        messages = self._collection.drain()
        moved = tracker.update(messages)
        self._missing.update(messages)
        if moved if self._rig.lockstep else self._actuator_published():
            self._last_message_at = self._context.observer.suspend_aware_clock()
        if moved:
            self._share()
        over = tracker.over and not self._awaits_last_samples()
        silent = None if over or job.interrupted else self._silent()
        # Read after the actuator's status, whose request blocks, so that the state is up to date.
        status = job.status
        state, self._moves = status.state, status.moves
        late = self._late(state, silent)
        return Facts(
            state=state,
            over=over,
            trip=tracker.trip,
            outcome=tracker.final_outcome(),
            held=tracker.held,
            paused=tracker.paused,
            interrupted=job.interrupted,
            late=late,
            cut_off=silent is not None and self._silence.cut_off,
            lease=self._lease,
            cut_short=CUT_SHORT if tracker.cut_short else None,
            lack=self._missing.lack,
            asked=self._asked(),
            stop_acts=tracker.stop_took_effect,
            pause_asked=self._pause_asked,
            trip_asked=self._trip_asked,
            given_up=self._given_up,
            on_stop=ActionCode(lease_end(job.request)),
            unsafe=None if self._recovery is None else self._latched(),
            waited=self._recovery is not None
            and self._context.clock() - status.entered_at >= self._recovery.wait_s,
        )

    def _latched(self) -> Why | None:
        """Return the cause if the actuator is latched while the job waits for a decision."""
        reason = self._context.health.latched()
        return None if reason is None else (self._trip_words(reason), trip_ending(reason))

    def _asked(self) -> Asked:
        """Return the progress of the command to the controller that belongs to the present
        state."""
        if self._asked_in != self._moves:
            return "no"
        if self._effective_seq is None:
            return "refused"
        return "effective" if self._tracker.telemetry_seq >= self._effective_seq else "accepted"

    def _silent(self) -> Why | None:
        """Return why the loop counts as silent; None if it does not."""
        lasts_s = self._context.observer.suspend_aware_clock() - self._last_message_at
        # After the end, late samples have a separate time limit.
        words = "" if self._tracker.over else self._silence.words(lasts_s, self._job.id)
        if self._silence.excused:
            self._last_message_at = self._context.observer.suspend_aware_clock()
        return (words, Ending(code="silent", values={"silent_s": lasts_s})) if words else None

    def _late(self, state: JobState, silent: Why | None) -> Why | None:
        """Return why the job does not progress: a silent loop, or an exceeded time limit."""
        first = state == "aborting" or self._silence.cut_off
        if (silent and first) or not self._watch.overdue():
            return silent
        words = f"{state} took too long: {self._tracker.lagging_program()} lags"
        if state == "aborting":
            words = "the actuator did not confirm in time that it is safe"
        return words, Ending(code="overdue")

    def _actuator_published(self) -> bool:
        """Return whether a sample of the actuator has arrived since the last call."""
        before, self._applied = self._applied, self._context.observer.newest(Applied)
        return self._applied is not before

    def _awaits_last_samples(self) -> bool:
        """Return whether samples of the last tick are pending; in lockstep none of them is lost."""
        if self._tracker.trip or self._tracker.complete or self._last_fetched:
            return False
        now = self._context.observer.suspend_aware_clock()
        if self._over_at is None:
            self._over_at = now
        if now - self._over_at < (self._context.guard_s if self._rig.lockstep else LATE_S):
            return True
        # A busy link loses samples, and the controller publishes the outcome of a program only
        # once.
        self._last_fetched = True
        self._tracker.update(self._context.observer.fetch_latest(TELEMETRY))
        return False

    def _share(self) -> None:
        """Publish the progress of the run to requests and listeners."""
        job, tracker = self._job, self._tracker
        self._context.health.note_part(tracker.part_held)
        wait = self._planned.waits.get(tracker.segment)
        held = tracker.held and not tracker.over and tracker.trip is None
        waiting = None if wait is None else tracker.segment
        progress = tracker.progress(wait)
        job.update_progress(progress, held=held, waiting=waiting)
        for phase, seq, held_then in tracker.phases:
            job.begin_phase(phase, seq, held_then)
            if phase in PICTURED:
                self._recorder.camera.take(PICTURED[phase])
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
        if tracker.trip is not None and not self._trip_reported:
            self._trip_reported = True
            words = self._context.trip_words(tracker.trip)
            self._context.alarms.raise_trip(tracker.trip, words, job.id)

    def _trip_words(self, trip: TripReason) -> str:
        return f"actuator tripped: {self._context.trip_words(trip)}"

    def _lease_ended(self, seq: int) -> None:
        """Record that the controller has stopped because its lease ended."""
        length_s = lease_s(self._job.request, self._rig)
        words = ended_words(self._context.bus, length_s)
        self._lease = words, Ending(code="lease_ended", values={"limit_s": length_s})
        self._lease_seq = seq
        self._context.alarms.raise_alarm(
            "lease", words, severity="alarm", clears="acknowledge", job=self._job.id
        )

    def _obey(self, command: Command, state: JobState) -> bool:
        """Carry out a command; return True if nothing more is expected of the rig."""
        match command:
            case Move():
                self._move(command, state)
            case Ask():
                self._ask(command.action, state)
            case AskTrip():
                return self._ask_trip()
            case Close():
                return self._close(command)
            case TakeDefault():
                self._take_default()
            case Complete():
                self._complete()
                return True
            case Interrupt():
                self._interrupt()
                return True
        return False

    def _move(self, move: Move, state: JobState) -> None:
        """Apply an event, unless the job has just left the state."""
        job, trip, why = self._job, self._tracker.trip, move.why
        if move.event == "trip" and trip is not None:
            why = self._trip_words(trip), trip_ending(trip)
        words, ending = why or ("", None)
        if self._recovery is not None:
            words = "; ".join(filter(None, (job.status.cause, words)))
            job.update(cause=words)
        if not job.move(move.event, words, only_from=state, ending=ending):
            return
        if move.event == "go_on":
            self._pause_asked = False
        elif why is not None and why is self._lease:
            # The controller already stops; another command would restart its stop.
            self._asked_in, self._effective_seq = self._moves + 1, self._lease_seq
        elif why is not None and why == self._missing.lack:
            self._given_up = True

    def _ask(self, action: ActionCode, state: JobState) -> None:
        """Send a command to the controller; the job is overdue if it does not reply."""
        self._asked_in, self._effective_seq = self._moves, None
        self._pause_asked = self._pause_asked or action == ActionCode.PAUSE
        try:
            reply = self._context.bus.call(ACTION, Action(action))
        except RefusalError:
            return  # the program has just ended; its last sample is on its way
        except BusError as error:
            ending = Ending(code="unanswered")
            self._job.move("overdue", str(error), only_from=state, ending=ending)
            return
        self._effective_seq = reply.seq if isinstance(reply, Ack) else self._tracker.telemetry_seq

    def _ask_trip(self) -> bool:
        """Request a trip of the actuator.

        Return True if it does not reply, which makes the job fail.
        """
        job = self._job
        self._trip_asked = True
        self._last_message_at = self._context.observer.suspend_aware_clock()
        try:
            self._context.trip(job.abort_trip(job.status.cause[:200]))
        except BusError as error:
            self._close(Close("fail", (str(error), Ending(code="unanswered"))))
            return True
        return False

    def _complete(self) -> None:
        """Complete the record of a job that was stopped while a part was held."""
        tracker = self._tracker
        if self._recovery is None:  # otherwise it was evaluated before the wait
            self._recorder.evaluate(tracker, self._collection)
        if tracker.over:
            if tracker.trip is not None:
                self._job.append_cause(self._trip_words(tracker.trip))
            self._recorder.publish_result()
        self._recorder.write(tracker, over=True)

    def _close(self, close: Close) -> bool:
        """Compute the result, move the job to its terminal state, then have the record written.

        Return True if nothing more is expected; False if the job waits for a decision.
        """
        job, tracker, event = self._job, self._tracker, close.event
        gone = gone_words(self._context)
        if event == "fail":
            if close.why is not None:
                job.note_cause(*close.why)
            if tracker.trip is not None and not self._trip_asked:
                trip = tracker.trip
                took = exchange_fault(self._context, trip)
                words = [self._trip_words(trip), gone or stall_words(self._context, trip)]
                job.update(
                    cause="; ".join(filter(None, (*words, fault_text(took)))),
                    ending=trip_ending(trip if took is None else trip.with_fault(took)),
                )
        self._recorder.camera.take("end")
        fault = self._recorder.evaluate(tracker, self._collection)
        if close.over and not gone and self._waits(close, fault):
            return False
        if event == "fail":
            job.note_cause(tracker.final_words(), Ending(code="bad_outcome"))
        if fault and event == "done":
            job.note_cause(fault, Ending(code="no_finding"))
            event = "fail"
        if event == "fail" and not gone and not self._trip_asked:
            self._prepare_next_job(tracker.trip)
        touched = tracker.final_outcome() in TOUCHED and (
            not tracker.left_rest or tracker.zero_unconfirmed
        )
        if touched and isinstance(job.request, ZeroingRequest):
            self._context.zero_doubt.raise_by(job.id)
        # A client that sees the end also sees that the record is not available yet.
        with self._recorder.expected():
            job.end(event)
            self._recorder.publish_result()
            self._recorder.write(tracker, over=close.over)
        return close.over

    def _waits(self, close: Close, fault: str) -> bool:
        """Return True if the job waits for a decision on a grip that did not succeed."""
        job, tracker = self._job, self._tracker
        if not isinstance(job.request, ContactJobRequest) or job.request.recovery is None:
            return False
        case = cast(RecoveryCase, str(tracker.final_outcome()))
        words = tracker.final_words()
        if close.event == "done" and not fault and self._recorder.verified is False:
            case, words = "unverified", CASES["unverified"]
        elif close.event != "fail" or close.why is not None or tracker.trip is not None:
            return False
        held, recovery = self._recorder.held, job.request.recovery
        if case not in CASES or not job.await_decision(case, words, recovery, held=held):
            return False
        self._recovery = job.request.recovery
        self._recorder.close(tracker)
        return True

    def _take_default(self) -> None:
        """Take the default decision."""
        job, recovery, wait = self._job, self._recovery, self._job.status.recovery
        assert recovery is not None
        assert wait is not None
        again = None
        if wait.default == "retry":
            fewer = {**recovery.model_dump(), "tries": recovery.tries - 1}
            again = repeated(job.row, recovery=fewer)
        job.decide(wait.default, f"default after {recovery.wait_s:g} s", again)

    def _prepare_next_job(self, trip: TripReason | None) -> None:
        """Let the kind of job determine the next job after a stall or an exceeded position
        limit.
        """
        job, run = self._job, self._recorder.run
        why: Interruption
        if trip is not None and silence_s(self._rig, trip) is not None:
            why = "stall"
        elif trip is None and self._tracker.final_outcome() == Outcome.OVERTRAVEL:
            why = "overtravel"
        else:
            return
        if run is None:
            return
        found = functions_of(kind_of(job.request)).goes_on(job.request, run, why)
        if found is not None:
            job.update(
                cause=f"{job.status.cause}; {found.words}",
                next_job=found.request,
                stalled=why == "stall",
            )

    def _interrupt(self) -> None:
        """Leave the rig stopped because the supervisor ends."""
        job = self._job
        try:
            self._context.bus.call(ACTION, Action(interruption(kind_of(job.request))), 0.5)
        except BusError as error:
            job.note_cause(str(error))
        self._recorder.evaluate(self._tracker, self._collection)
        with self._recorder.expected():
            if not job.status.terminal:
                job.end("interrupt", "the supervisor ended", "supervisor_ended")
            self._recorder.write(self._tracker, over=True)
