"""What the samples of a run say: where it is, whether it is over, and who has gone silent."""

from collections.abc import Iterable
from typing import cast

from pincette.api.job_models import Progress
from pincette.api.states import OUTCOMES
from pincette.messages import Applied, Estimate, Message, Position, Sample, Telemetry, Truth
from pincette.topics import LOOP, TOPIC_OF
from pincette_supervisor.planning.planned import Wait
from pincette_supervisor.results.result import TRIPPED

CAUSES = {
    "abort": "abort: the job was aborted",
    "estop": "estop: an emergency stop was asked for",
    "restart": "restart: the actuator was started anew",
}


class Tracker:
    """Takes the messages of one epoch in order of arrival."""

    def __init__(
        self, epoch: int, period_s: float, planned_s: float | None, *, lockstep: bool
    ) -> None:
        self.messages: list[Message] = []
        self.trip_cause = ""
        self.over = False
        self.outcome = ""
        self.released = False
        self.held = False
        self.phase = ""
        self.segment = -1
        """Number of the program's segment."""
        self.stop_acted = False
        self.acted: list[tuple[str, int]] = []
        """Actions that have taken effect since this list was last emptied, with their seq."""
        self._lockstep = lockstep
        self._epoch, self._period_s, self._planned_s = epoch, period_s, planned_s
        self._seqs: dict[str, int] = dict.fromkeys(LOOP, -1)
        self._position: Position | None = None
        self._estimate: Estimate | None = None
        self._applied: Applied | None = None

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
        producer = TOPIC_OF[type(sample)].producer
        self._seqs[producer] = max(self._seqs[producer], sample.seq)
        if isinstance(sample, Position):
            self._position = sample
        elif isinstance(sample, Estimate):
            self._estimate = sample
        elif isinstance(sample, Applied):
            self._applied = sample
            if sample.state in TRIPPED and not self.trip_cause:
                self.trip_cause = sample.cause or "unknown"
            self.over = self.over or sample.final
        elif isinstance(sample, Telemetry):
            self._view(sample)

    def _view(self, sample: Telemetry) -> None:
        self.phase, self.held, self.segment = sample.phase, sample.held, sample.segment
        self.outcome = sample.outcome or self.outcome
        for word in sample.acted.split():
            self.acted.append((word, sample.seq))
            self.stop_acted = self.stop_acted or word == "stop"
            self.released = self.released or word == "release"

    def silent(self) -> str:
        """The program whose number lags: the first, in the order of a tick."""
        seqs = [self._seqs[program] for program in LOOP]
        return next(
            (program for program, seq in zip(LOOP, seqs, strict=True) if seq < seqs[0]), LOOP[0]
        )

    def ending(self) -> str:
        """How the program ended, in the controller's code."""
        return self.outcome or ("released" if self.released else "unfinished")

    def trip_words(self) -> str:
        """Why the actuator tripped."""
        return f"actuator tripped: {CAUSES.get(self.trip_cause, self.trip_cause)}"

    def progress(self, wait: Wait | None = None) -> Progress:
        """Where the run is, by its newest samples, and what it waits for."""
        position, estimate, applied = self._position, self._estimate, self._applied
        seq = -1 if position is None else position.seq
        zeroed = estimate is not None and estimate.valid and estimate.zero_age_s is not None
        return Progress(
            phase=self.phase,
            seq=seq,
            elapsed_s=(seq + 1) * self._period_s,
            planned_s=self._planned_s,
            x_um=position.x_um if position is not None and position.valid else None,
            force_mN=estimate.force_mN if zeroed and estimate is not None else None,
            force_uncertainty_mN=(
                estimate.force_uncertainty_mN if zeroed and estimate is not None else None
            ),
            voltage_V=None if applied is None else applied.voltage_V,
            held=self.held,
            instruction="" if wait is None else wait.instruction,
            weight_mN=None if wait is None else wait.weight_mN,
        )


def outcome_words(outcome: str) -> str:
    """An outcome code with its meaning."""
    meaning = OUTCOMES.get(outcome)
    return f"{outcome}: {meaning}" if meaning else outcome
