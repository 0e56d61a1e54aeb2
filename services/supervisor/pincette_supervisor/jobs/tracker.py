"""Tracking of the samples of a run: its progress, its end, and silent programs."""

from collections import Counter
from collections.abc import Iterable
from typing import cast

from pincette.api.endings import Ending
from pincette.api.job_kinds import job_kinds
from pincette.api.jobs import Progress
from pincette.api.states import OUTCOMES
from pincette.config import RigFile
from pincette.control.planning.conditioning import PHASE as CONDITION
from pincette.core.faults import TRIPPED, Acted, Outcome, Phase
from pincette.core.messages import (
    Applied,
    Estimate,
    GroundTruth,
    Message,
    Position,
    Sample,
    Telemetry,
)
from pincette.core.topics import APPLIED, LOOP, TOPIC_OF, TOPICS, Topic
from pincette.core.wording import fault_text
from pincette_supervisor.alarms import TripReason, reason_of
from pincette_supervisor.plugin import Planned, Wait
from pincette_supervisor.plugin.figures import MOST_MISSING
from pincette_supervisor.results.run_samples import THINNED, RunSamples
from pincette_supervisor.rigs.rig_context import RigContext

EVERY_TICK = [topic for topic in TOPICS if topic.per_tick and topic.producer in LOOP]
PROGRAMS = (*LOOP, "rig")
STALE_S, STALE_PERIODS = 1.0, 10.0
GONE_S = 1.0
"""Lockstep: longest standstill of the loop after a program's token has vanished, in s."""
SETTLE_S = 0.5
"""Time from the start of a hold that is excluded from the held force, in s."""

BEFORE_APPROACH = ("", "open", CONDITION, "zero", Phase.RETREAT, Phase.UNLOAD, Phase.STOPPING)
"""Phases before a job moves towards a part, and phases of the motion back."""


class Tracker:
    """Processes the messages of one epoch in order of arrival."""

    def __init__(
        self,
        epoch: int,
        period_s: float,
        planned_s: float | None,
        *,
        lockstep: bool,
        hold_at_s: float | None = None,
        thinned: frozenset[str] = THINNED,
    ) -> None:
        """Create the tracker; ``hold_at_s`` is the planned start of the hold, or None.

        ``thinned``: see ``RunSamples``.
        """
        self.samples = RunSamples(period_s, every_tick=lockstep, thinned=thinned)
        self.messages = 0
        """Number of messages of the epoch so far."""
        self.trip: TripReason | None = None
        self.outcome = Outcome.NONE
        self.released = False
        self._loaded = self._pressed_as_asked = False
        self.held = False
        self.phase = ""
        self.phases: list[tuple[str, int, bool]] = []
        """Phases that began since this list was last emptied: name, number of the first sample, and
        True if a part was held.
        """
        self.left_rest = False
        """True once the program has left the rest in which it zeroes the force first."""
        self.segment = -1
        """Number of the program's segment."""
        self.stop_took_effect = False
        self.paused = False
        self.telemetry_seq = -1
        """Number of the controller's newest sample."""
        self.effects: list[tuple[Acted, int]] = []
        """Actions that took effect since this list was last emptied, each with the number of the
        sample.
        """
        self._final_seq: int | None = None
        """Number of the sample that ended the arming; an idle loop in real time continues."""
        self._paused_ticks = 0
        """Number of samples that were paused."""
        self._lockstep = lockstep
        self._epoch, self._period_s, self._planned_s = epoch, period_s, planned_s
        self._hold_at_s = hold_at_s
        self._hold_seq: int | None = None
        """Number of the sample that began the hold."""
        self._held_sum_mN, self._held_count = 0.0, 0
        self._seqs: dict[Topic, int] = dict.fromkeys(EVERY_TICK, -1)
        self._position: Position | None = None
        self._estimate: Estimate | None = None
        self._applied: Applied | None = None
        self._telemetry: Telemetry | None = None

    def update(self, messages: Iterable[Message]) -> bool:
        """Process new messages; return False if none of them belongs to this epoch."""
        before = self.messages
        for message in messages:
            if isinstance(message, GroundTruth):
                # In real time, ground truth of the idle rig may still arrive before the first
                # sample.
                if self._lockstep or self._position is not None:
                    self._keep(message)
            elif cast(Sample, message).epoch == self._epoch:
                self._keep(message)
                self._follow(cast(Sample, message))
        return self.messages > before

    def _keep(self, message: Message) -> None:
        self.messages += 1
        self.samples.add(message)

    def _follow(self, sample: Sample) -> None:
        topic = TOPIC_OF[type(sample)]
        if topic in self._seqs:
            self._seqs[topic] = max(self._seqs[topic], sample.seq)
        if isinstance(sample, Position):
            self._position = sample
        elif isinstance(sample, Estimate):
            self._estimate = sample
            self._follow_hold(sample)
        elif isinstance(sample, Applied):
            self._applied = sample
            if sample.state in TRIPPED and self.trip is None:
                self.trip = reason_of(sample)
            if sample.final and self._final_seq is None:
                self._final_seq = sample.seq
        elif isinstance(sample, Telemetry):
            self._view(sample)

    @property
    def zero_unconfirmed(self) -> bool:
        """Return True if a part may have been pressing when an arm's force was zeroed."""
        estimate = self._estimate
        if estimate is None:
            return False
        return any(arm.zero_unconfirmed for arm in estimate.arms)

    @property
    def part_held(self) -> bool | None:
        """Return True if this run shows that the gripper holds a part; None if it shows nothing.

        The actuator's samples show a held part, and a confirmed zero shows an empty gripper.
        """
        if self._applied is not None and self._applied.part_held:
            return True
        estimate = self._estimate
        if estimate is None or not estimate.valid or self.zero_unconfirmed:
            return None
        return False if all(arm.zero_age_s is not None for arm in estimate.arms) else None

    def _view(self, sample: Telemetry) -> None:
        self._telemetry = sample
        if sample.phase != self.phase:
            self.phases.append((sample.phase, sample.seq, sample.held))
            self.left_rest = self.left_rest or sample.phase not in BEFORE_APPROACH
        self.phase, self.held, self.segment = sample.phase, sample.held, sample.segment
        self.paused, self.telemetry_seq = sample.paused, sample.seq
        self._paused_ticks += sample.paused
        self.outcome = sample.outcome or self.outcome
        self._loaded = self._loaded or self.phase == Phase.LOAD
        self._pressed_as_asked = self._pressed_as_asked or self.phase in (Phase.HOLD, Phase.TRACK)
        if self._hold_seq is None and self.phase == Phase.HOLD:
            self._hold_seq = sample.seq
        for acted in sample.acted:
            self.effects.append((acted, sample.seq))
            self.stop_took_effect = self.stop_took_effect or acted == Acted.STOP
            self.released = self.released or acted == Acted.RELEASE

    def _follow_hold(self, sample: Estimate) -> None:
        force_mN = self._pressed_mN()
        if sample.valid and any(arm.zero_age_s is None for arm in sample.arms):
            # The zero is invalid, so the forces before may be wrong.
            self._held_sum_mN, self._held_count = 0.0, 0
        if self.phase != Phase.HOLD or self._hold_seq is None or force_mN is None:
            return
        if (sample.seq - self._hold_seq) * self._period_s >= SETTLE_S:
            self._held_sum_mN, self._held_count = self._held_sum_mN + force_mN, self._held_count + 1

    def _hold_in_s(self) -> float | None:
        if self.phase == Phase.HOLD:
            return 0.0
        if self.phase == Phase.STOPPED or self._hold_at_s is None or self._hold_seq is not None:
            return None
        return max(0.0, self._hold_at_s - self.played_s)

    @property
    def cut_short(self) -> bool:
        """Return True if the part was released in the load, before its hold or path had begun."""
        return self.released and self._loaded and not self._pressed_as_asked

    @property
    def played_s(self) -> float:
        """Return the time that the program has played by the newest sample, without pauses."""
        seq = -1 if self._position is None else self._position.seq
        return (seq + 1 - self._paused_ticks) * self._period_s

    def lagging_program(self) -> str:
        """Return the first program, in the order of a tick, whose sample number lags."""
        seqs = [
            max(seq for topic, seq in self._seqs.items() if topic.producer == program)
            for program in LOOP
        ]
        return next(
            (program for program, seq in zip(LOOP, seqs, strict=True) if seq < seqs[0]), LOOP[0]
        )

    @property
    def over(self) -> bool:
        """Return whether the arming is over according to the actuator's sample."""
        return self._final_seq is not None

    @property
    def complete(self) -> bool:
        """Return whether all samples of the last tick have arrived.

        Each topic has a separate link.
        """
        return self._final_seq is not None and min(self._seqs.values()) >= self._final_seq

    @property
    def last_seq(self) -> int:
        """Return the number of the newest sample whose tick has ended; -1 before the first."""
        return self._seqs[APPLIED]

    def final_outcome(self) -> Outcome:
        """Return the outcome of the program; ``Outcome.NONE`` before its end."""
        return self.outcome or (Outcome.RELEASED if self.released else Outcome.NONE)

    def final_words(self) -> str:
        """Return the outcome of the program, in words."""
        return outcome_words(self.final_outcome(), self._telemetry, self._estimate)

    def progress(self, wait: Wait | None = None) -> Progress:
        """Return the progress by the newest samples, with what the run waits for."""
        position, applied, telemetry = self._position, self._applied, self._telemetry
        seq = -1 if position is None else position.seq
        x_um = position.arms[0].x_um if position is not None and position.arms[0].valid else None
        force_mN, uncertainty_mN = self._force()
        played_s, planned_s = self.played_s, self._planned_s
        pressing = self.held and force_mN is not None
        x_r_um = None if telemetry is None else telemetry.arms[0].x_r_um
        force_r_mN = None if telemetry is None else telemetry.force_r_mN
        return Progress(
            phase=self.phase,
            seq=seq,
            elapsed_s=(seq + 1) * self._period_s,
            planned_s=planned_s,
            paused=self.paused,
            percent=None if not planned_s else min(100.0, 100.0 * played_s / planned_s),
            remaining_s=None if planned_s is None else max(0.0, planned_s - played_s),
            x_r_um=x_r_um,
            x_um=x_um,
            force_r_mN=force_r_mN,
            force_mN=force_mN,
            force_uncertainty_mN=uncertainty_mN,
            voltage_V=None if applied is None else applied.confirmed_V(),
            held=self.held,
            hold_in_s=self._hold_in_s(),
            force_held_mN=self._held_sum_mN / self._held_count if self._held_count else None,
            target=force_r_mN if pressing else x_r_um,
            current=force_mN if pressing else x_um,
            unit="mN" if pressing else "µm",
            instruction="" if wait is None else wait.instruction,
            weight_mN=None if wait is None else wait.weight_mN,
        )

    def _force(self) -> tuple[float | None, float | None]:
        """Return the newest force and its uncertainty in mN; None for both before the first
        zero.
        """
        estimate = self._estimate
        arm = None if estimate is None or not estimate.valid else estimate.arms[0]
        if arm is None or arm.zero_age_s is None:
            return None, None
        return arm.force_mN, arm.force_uncertainty_mN

    def _pressed_mN(self) -> float | None:
        """Return the force on the part, in mN; the mean of two arms, as in their job's result."""
        force_mN, _ = self._force()
        if force_mN is None or self._estimate is None or len(self._estimate.arms) == 1:
            return force_mN
        second = self._estimate.arms[1]
        return None if second.zero_age_s is None else 0.5 * (force_mN + second.force_mN)


def outcome_words(
    outcome: Outcome, telemetry: Telemetry | None = None, estimate: Estimate | None = None
) -> str:
    """Return an outcome in words: its meaning, the obstacle, or why a zero was rejected."""
    words = f"{outcome}: {OUTCOMES[outcome]}" if outcome else "unfinished"
    if outcome == Outcome.ZERO_REFUSED:
        return f"{words}; {_refusal_words(estimate)}"
    if outcome != Outcome.CONTACT or telemetry is None or telemetry.touch_mN is None:
        return words
    if telemetry.touch_mN < 0.0:
        return (
            f"{outcome}: the free arm was pulled with {-telemetry.touch_mN:.1f} mN at "
            f"{telemetry.touch_x_um:.2f} µm, or the zero of its force is wrong"
        )
    return (
        f"{words}, at {telemetry.touch_x_um:.2f} µm, and went back at {telemetry.touch_mN:.1f} mN"
    )


def _refusal_words(estimate: Estimate | None) -> str:
    """Return why the estimator rejected a zero, in words; if it gave no reason, the sample was
    lost.
    """
    refusals = () if estimate is None else [arm.zero_refusal for arm in estimate.arms]
    refusal = next((one for one in refusals if one is not None), None)
    return fault_text(refusal) or (
        "the estimator neither took nor refused a zero: the sample or the voltage of the "
        "zero was lost; look at the sensor's line and start again"
    )


def gone_words(context: RigContext) -> str:
    """Return the programs whose token has vanished, in words."""
    gone = context.observer.gone(PROGRAMS)
    return f"killed or hung: {', '.join(gone)}" if gone else ""


def silence_limit_s(rig: RigFile) -> float:
    """Return how long a program of the loop may be silent in real time, in s."""
    return max(STALE_S, STALE_PERIODS * rig.rig.period_s)


def silent_words(context: RigContext, tracker: Tracker, lasts_s: float) -> str:
    """Return the silent program, in words; empty if none is silent."""
    # In lockstep the whole loop stands still when one program does; in real time the actuator
    # represents the loop, since it detects itself when the others are silent.
    killed = gone_words(context)
    if context.rig.lockstep:
        if killed and lasts_s > min(GONE_S, context.guard_s):
            return killed
        if lasts_s > context.guard_s:
            silent = context.rig.program_of(tracker.lagging_program())
            return f"{silent} is silent: no progress for {context.guard_s:g} s"
        return ""
    limit_s = silence_limit_s(context.rig)
    if lasts_s > limit_s:
        silent = f"actuator: silent for more than {limit_s:g} s"
        return f"{killed}; {silent}" if killed else silent
    return ""


# Counts the positions that a job lacks while it plays.
#
# A kind of job that needs every sample gets no values from a phase that lacks too many: such a job
# is not played to its end.

WAITING_ROWS = 10_000
"""Largest number of positions that are stored while a job waits for a person."""


class MissingSamples:
    """Counts missing positions of an epoch by phase, if the kind of job needs all of them."""

    def __init__(self, planned: Planned, epoch: int, period_s: float) -> None:
        self._epoch = epoch
        self._planned: Counter[str] = Counter()
        """Planned number of samples of each phase; a phase that waits for a person has no entry."""
        if job_kinds()[planned.plan.kind].needs_every_sample:
            for phase in planned.plan.phases:
                if phase.duration_s is not None:
                    self._planned[phase.phase] += round(phase.duration_s / period_s)
        self._phase: str = ""
        self._first, self._newest = 0, -1
        self._valid: set[int] = set()
        """Numbers of the valid positions since the phase began."""

    def update(self, messages: Iterable[Message]) -> None:
        """Process new messages; those of each topic arrive in order."""
        if not self._planned:
            return
        for message in messages:
            if not isinstance(message, Position | Telemetry) or message.epoch != self._epoch:
                continue
            if isinstance(message, Telemetry):
                self._begin(message.phase, message.seq)
                continue
            self._newest = message.seq
            if message.arms[0].valid:
                self._valid.add(message.seq)
            if not self._planned[self._phase] and len(self._valid) > WAITING_ROWS:
                self._valid = {one for one in self._valid if one > message.seq - WAITING_ROWS // 2}

    def _begin(self, phase: str, seq: int) -> None:
        """Begin to count the positions of a phase, unless it has already begun."""
        if phase != self._phase:
            self._phase, self._first = phase, seq
            self._valid = {one for one in self._valid if one >= seq}

    @property
    def lack(self) -> tuple[str, Ending] | None:
        """Return the cause if a phase lacks too many positions; None if it does not."""
        planned = self._planned[self._phase]
        count = self._newest - self._first + 1 - len(self._valid)
        if not planned or count <= MOST_MISSING * planned:
            return None
        words = (
            f"{count} of the {planned} samples of {self._phase} are missing already, limit "
            f"{100.0 * MOST_MISSING:g} %: check the sensor's line and the load of the "
            "machine (`pincette latency --of-rig`)"
        )
        values = {"missing": count, "planned": planned, "limit": MOST_MISSING}
        return words, Ending(code="samples_missing", values=values)
