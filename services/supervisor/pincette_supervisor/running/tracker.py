"""What the samples of a run say: where it is, whether it is over, and who has gone silent."""

from collections.abc import Iterable
from typing import cast

from pincette.api.job_models import Progress
from pincette.api.states import OUTCOMES
from pincette.messages import Applied, Estimate, Message, Position, Sample, Telemetry, Truth
from pincette.topics import APPLIED, LOOP, TOPIC_OF, TOPICS, Topic
from pincette_supervisor.planning.planned import Wait
from pincette_supervisor.results.result import TRIPPED

EVERY_TICK = [topic for topic in TOPICS if topic.per_tick and topic.producer in LOOP]


class Tracker:
    """Takes the messages of one epoch in order of arrival."""

    def __init__(
        self, epoch: int, period_s: float, planned_s: float | None, *, lockstep: bool
    ) -> None:
        self.messages: list[Message] = []
        self.trip_cause = ""
        self.outcome = ""
        self.released = False
        self.held = False
        self.phase = ""
        self.segment = -1
        """Number of the program's segment."""
        self.stop_acted = False
        self.paused = False
        self.told_seq = -1
        """Number of the controller's newest sample."""
        self.acted: list[tuple[str, int]] = []
        """Actions that have taken effect since this list was last emptied, with their seq."""
        self._final_seq: int | None = None
        """Number of the sample that ended the arming; an idle loop in real time goes on."""
        self._rested = 0
        """Samples that were paused."""
        self._lockstep = lockstep
        self._epoch, self._period_s, self._planned_s = epoch, period_s, planned_s
        self._seqs: dict[Topic, int] = dict.fromkeys(EVERY_TICK, -1)
        self._position: Position | None = None
        self._estimate: Estimate | None = None
        self._applied: Applied | None = None
        self._telemetry: Telemetry | None = None

    def take(self, messages: Iterable[Message]) -> bool:
        """Follow what has come; False where none of it belongs to this epoch."""
        before = len(self.messages)
        for message in messages:
            if isinstance(message, Truth):
                # In real time a truth of the idle rig may still be on its way.
                if self._lockstep or self._position is not None:
                    self.messages.append(message)
            elif cast(Sample, message).epoch == self._epoch:
                self.messages.append(message)
                self._follow(cast(Sample, message))
        return len(self.messages) > before

    def _follow(self, sample: Sample) -> None:
        topic = TOPIC_OF[type(sample)]
        if topic in self._seqs:
            self._seqs[topic] = max(self._seqs[topic], sample.seq)
        if isinstance(sample, Position):
            self._position = sample
        elif isinstance(sample, Estimate):
            self._estimate = sample
        elif isinstance(sample, Applied):
            self._applied = sample
            if sample.state in TRIPPED and not self.trip_cause:
                self.trip_cause = sample.cause or "unknown"
            if sample.final and self._final_seq is None:
                self._final_seq = sample.seq
        elif isinstance(sample, Telemetry):
            self._view(sample)

    def _view(self, sample: Telemetry) -> None:
        self._telemetry = sample
        self.phase, self.held, self.segment = sample.phase, sample.held, sample.segment
        self.paused, self.told_seq = sample.paused, sample.seq
        self._rested += sample.paused
        self.outcome = sample.outcome or self.outcome
        for word in sample.acted.split():
            self.acted.append((word, sample.seq))
            self.stop_acted = self.stop_acted or word == "stop"
            self.released = self.released or word == "release"

    @property
    def played_s(self) -> float:
        """Time that the program has played, by the newest sample, without its pauses."""
        seq = -1 if self._position is None else self._position.seq
        return (seq + 1 - self._rested) * self._period_s

    def silent(self) -> str:
        """The program whose number lags: the first, in the order of a tick."""
        seqs = [
            max(seq for topic, seq in self._seqs.items() if topic.producer == program)
            for program in LOOP
        ]
        return next(
            (program for program, seq in zip(LOOP, seqs, strict=True) if seq < seqs[0]), LOOP[0]
        )

    @property
    def over(self) -> bool:
        """Whether the actuator has said that the arming is over."""
        return self._final_seq is not None

    @property
    def complete(self) -> bool:
        """Whether all has come of the last tick of the run: every topic has a way of its own."""
        return self._final_seq is not None and min(self._seqs.values()) >= self._final_seq

    @property
    def last_seq(self) -> int:
        """Number of the newest sample whose tick has ended; -1 before the first."""
        return self._seqs[APPLIED]

    def ending(self) -> str:
        """How the program ended, in the controller's code."""
        return self.outcome or ("released" if self.released else "unfinished")

    def progress(self, wait: Wait | None = None) -> Progress:
        """Where the run is, by its newest samples, and what it waits for."""
        position, applied, told = self._position, self._applied, self._telemetry
        seq = -1 if position is None else position.seq
        x_um = position.x_um if position is not None and position.valid else None
        force_mN, uncertainty_mN = self._force()
        played_s, planned_s = self.played_s, self._planned_s
        pressing = self.held and force_mN is not None
        x_r_um, force_r_mN = (None, None) if told is None else (told.x_r_um, told.force_r_mN)
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
            voltage_V=None if applied is None else applied.voltage_V,
            held=self.held,
            target=force_r_mN if pressing else x_r_um,
            current=force_mN if pressing else x_um,
            unit="mN" if pressing else "µm",
            instruction="" if wait is None else wait.instruction,
            weight_mN=None if wait is None else wait.weight_mN,
        )

    def _force(self) -> tuple[float | None, float | None]:
        """The newest force and its uncertainty, once it has a zero."""
        estimate = self._estimate
        if estimate is None or not estimate.valid or estimate.zero_age_s is None:
            return None, None
        return estimate.force_mN, estimate.force_uncertainty_mN


def outcome_words(outcome: str) -> str:
    """An outcome code with its meaning."""
    meaning = OUTCOMES.get(outcome)
    return f"{outcome}: {meaning}" if meaning else outcome
