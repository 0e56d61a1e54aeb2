"""Decision whether the loop is silent, or the supervisor does not receive its messages.

A supervisor that is not scheduled, or whose router is not, receives nothing from a healthy loop:
the programs of the loop are linked to each other, not through the supervisor. A trip would then
drop a part for no reason. Therefore the actuator itself is queried before a silence counts:

- It is armed for this job: the loop is healthy, and only the supervisor received nothing.
- It is not armed: its last sample, which says why, is fetched.
- It does not reply, and messages of other programs arrive: the actuator is silent.
- Its token has vanished, and another program's token has been present all the time: it has ended.
- The router was replaced, and the actuator has not linked to the new one yet, or only just: wait.
- Nothing arrives and no program replies: the link is cut, or the router has ended, and with it
  the tokens of all programs have vanished. The loop continues under its lease, and ends with it.
  Only then does the silence count. It ends the job without a trip: over the direct link, a trip
  would reach a healthy loop, and release its part after ``freeze_s``.
"""

from pincette.bus.protocol import BusError
from pincette.core.faults import Mode
from pincette.core.messages import Applied, Estimate, Position, Telemetry
from pincette.core.topics import APPLIED, TELEMETRY
from pincette.engine.arming import status
from pincette_supervisor.jobs.tracker import PROGRAMS, Tracker, silence_limit_s, silent_words
from pincette_supervisor.process_load import share_words
from pincette_supervisor.rigs.rig_context import RigContext

ASK_S = 0.7
OTHERS = (Position, Estimate, Telemetry)
ACTUATOR = "actuator"
CAUSE = "supervisor.deaf"
GRACE_SHARE = 0.5
"""Fraction of the silence limit after which a link that appeared or was lost counts, and within
which a message of another program must have arrived for that program to count as present. The last
message of a program that was cut off together with the actuator may have arrived shortly after the
actuator's.
"""


class SilenceDetector:
    """Detects a silent loop of one job in real time; in lockstep by the programs' state alone."""

    def __init__(self, context: RigContext, tracker: Tracker, epoch: int, lease_s: float) -> None:
        """Create the detector.

        ``lease_s``: time without supervisor after which the loop ends; 0: never.
        """
        self._context, self._tracker, self._epoch = context, tracker, epoch
        self._lease_s = lease_s
        self._told = False
        self.excused = False
        """True if the last query showed that the loop either runs or has ended."""
        self.cut_off = False
        """True if no program was received or has replied, so that the loop ends by its lease."""

    def words(self, lasts_s: float, job: str) -> str:
        """Return why the loop counts as silent after this time without a sample; empty if not."""
        self.excused = self.cut_off = False
        words = silent_words(self._context, self._tracker, lasts_s)
        if not words or self._context.rig.lockstep or self._actuator_has_ended():
            return words
        try:
            actuator = status(self._context.bus, ACTUATOR, ASK_S)
        except BusError:
            if self._hears() and self._actuator_is_linked():
                return words
            self.cut_off = self._lease_s > 0.0
            if lasts_s <= self._lease_s:
                return ""
            return self._cut_off_words(lasts_s) if self.cut_off else words
        if actuator.mode != Mode.ARMED or actuator.epoch != self._epoch:
            fetch = self._context.observer.fetch_latest
            self._tracker.update([*fetch(TELEMETRY), *fetch(APPLIED)])
            self.excused = self._tracker.over or self._tracker.trip is not None
            return "" if self.excused else words
        self.excused = True
        self._tell(lasts_s, job)
        return ""

    def _actuator_has_ended(self) -> bool:
        """Return whether the actuator's token has vanished while the token of another program on
        its side of the network has been present all the time.

        Programs that link to a new router appear one after another, so those that are present only
        since then do not show that the actuator has ended.
        """
        observer = self._context.observer
        gone_s = observer.token_age_s(ACTUATOR)
        beside = () if self._context.rig.bus.served_upstream else ("recorder",)
        return (
            bool(observer.gone((ACTUATOR,)))
            and gone_s >= self._grace_s
            and any(
                observer.alive(other) and observer.token_age_s(other) > gone_s
                for other in (*PROGRAMS, *beside)
            )
        )

    def _actuator_is_linked(self) -> bool:
        """Return whether the actuator has been present for long enough to reply."""
        observer = self._context.observer
        return observer.alive(ACTUATOR) and observer.token_age_s(ACTUATOR) >= self._grace_s

    @property
    def _grace_s(self) -> float:
        """Return the time after which a lasting state is believed, in s: the tokens of a lost link
        vanish one after another, and a program replies some time after its token has appeared.
        """
        return GRACE_SHARE * silence_limit_s(self._context.rig)

    def _cut_off_words(self, lasts_s: float) -> str:
        """Return the cause of a job's end after a silence longer than its lease."""
        return (
            f"no message or reply has come from any program of the rig for {lasts_s:.1f} s: "
            "the router has ended or hangs, or the network is cut. The controller stops by "
            f"itself when its lease of {self._lease_s:g} s ends; a held part stays held"
        )

    def _hears(self) -> bool:
        """Return whether messages of any other program of the loop arrive."""
        observer = self._context.observer
        ages_s = [observer.silent_s(kind) for kind in OTHERS]
        return any(age_s is not None and age_s <= self._grace_s for age_s in ages_s)

    def _tell(self, lasts_s: float, job: str) -> None:
        """Raise the alarm, once for each job, since later silences have the same cause."""
        if self._told:
            return
        self._told = True
        age_s = self._context.observer.age_s(Applied)
        shares = share_words(max(lasts_s, age_s or 0.0))
        words = (
            f"the supervisor received no sample from the actuator for {lasts_s:.1f} s, but "
            f"the actuator replied that it is armed: the loop continues; {shares}"
        )
        self._context.alarms.raise_alarm(
            CAUSE, words, severity="warning", clears="acknowledge", job=job
        )
