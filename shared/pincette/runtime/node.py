"""A service at work: its state, the samples that wait for a partner, its instrument.

A node knows no thread and no bus, so the same node runs in an own process over Zenoh and beside
its neighbours in one process; what drives it hands it messages and the time.
"""

from collections import deque
from dataclasses import dataclass
from typing import Any, cast

from pincette import __version__
from pincette.config import Calibration, ConfigError, RigFile, calibrated, parse_calibration
from pincette.instruments.protocols import VoltageOutput
from pincette.messages import Applied, Arm, Message, Reset, Sample, Status, StatusRequest
from pincette.runtime.asking import Notes
from pincette.runtime.instrument import Device, Instrument
from pincette.runtime.timing import too_slow
from pincette.service import AnyService, ForInstrument, Input, RefusedError
from pincette.topics import COMMAND

JOIN_WAIT_PERIODS = 0.25
KEPT = 16
"""Samples kept for a join, where what waits longer has lost its partner, and streams that wait."""


@dataclass(frozen=True, slots=True)
class Pending:
    """A trigger that waits for its partners; ``sample`` is None for a tick of the grid."""

    sample: Sample | None
    since: float


class Node:
    """Joins inputs by number, steps the service, moves its instrument."""

    def __init__(
        self, service: AnyService, rig: RigFile, device: Device = None, instance: int = 1
    ) -> None:
        self.service = service
        self.instance = instance
        self.digest = rig.digest()
        self.lockstep = rig.lockstep
        self.period_s = rig.rig.period_s
        self.calibration = Calibration()
        self.config: Any = service.configure(rig)
        self.state: Any = service.start(self.config)
        if service.adopt is not None:
            found_V = cast(VoltageOutput, device).read_V()
            self.state = service.adopt(self.config, self.state, found_V)
        self.steps = 0
        self.missed = 0
        self.refused = 0
        """Samples that were not taken for their number."""
        self._rig = rig
        self._now = 0.0
        # Judged before the loop turns: loading a driver takes longer than a tick.
        self._too_slow = too_slow(rig) if service.instrument == "voltage_output" else ""
        self._device = Instrument(device, self.period_s)
        self._instrument = service.instrument is not None
        self._joins = [item for item in service.inputs if item.role == "join"]
        self._roles: dict[type, Input] = {item.topic.message: item for item in service.inputs}
        self._columns = [
            item.topic.message for item in service.inputs if item.role in ("trigger", "join")
        ]
        self._paced = any(item.role == "pace" for item in service.inputs)
        self._waiting: dict[type, dict[tuple[int, int], Sample]] = {
            item.topic.message: {} for item in self._joins
        }
        self._pending: deque[Pending] = deque()
        self._notes = Notes(service)
        self._blank = (None,) * (len(self._columns) + self._instrument)

    def accept(self, message: Message, now: float) -> None:
        """Take a message from the bus."""
        sample = cast(Sample, message)
        role = self._roles[type(message)].role
        if role == "join":
            waiting = self._waiting[type(message)]
            waiting[sample.epoch, sample.seq] = sample
            if len(waiting) > KEPT:
                self._forget_one(waiting)
        elif role == "trigger":
            if not self.lockstep:
                self._drop_older(sample)
            self._pending.append(Pending(sample, now))
        elif self.lockstep and sample.seq >= 0 and not cast(Applied, message).final:
            # Arming began tick 0; the applied voltage of seq -1 is where it starts from.
            self._pending.append(Pending(None, (sample.seq + 1) * self.period_s))

    def _forget_one(self, waiting: dict[tuple[int, int], Sample]) -> None:
        """The oldest of another epoch, or else the oldest: no stranger pushes out what counts."""
        place = next((place for place in waiting if place[0] != self.state.epoch), None)
        del waiting[next(iter(waiting)) if place is None else place]

    def _drop_older(self, sample: Sample) -> None:
        """In real time only the newest sample of a stream counts; a backlog is never played.

        What another epoch or owner says is a stream of its own: it must not push out what counts.
        """
        stream = _stream(sample)
        for pending in self._pending:
            if pending.sample is not None and _stream(pending.sample) == stream:
                self._pending.remove(pending)
                self.missed += 1
                return
        if len(self._pending) >= KEPT:
            self._pending.popleft()
            self.missed += 1

    def due(self, now: float) -> bool:
        """Whether a step can be made."""
        if not self._pending:
            return False
        first = self._pending[0]
        if first.sample is None or self._complete(first.sample):
            return True
        # As ``patience`` counts it, to the last bit: or a driver would wait for no time, again and
        # again.
        return not self.lockstep and now >= first.since + JOIN_WAIT_PERIODS * self.period_s

    def patience(self, now: float) -> float | None:
        """Seconds until a step must be made without its partner; None where nothing waits."""
        if self.lockstep or not self._pending:
            return None
        return max(0.0, self._pending[0].since + JOIN_WAIT_PERIODS * self.period_s - now)

    def _complete(self, sample: Sample) -> bool:
        for item in self._joins:
            if (sample.epoch, sample.seq + item.offset) not in self._waiting[item.topic.message]:
                return False
        return True

    def fire(self, now: float) -> tuple[Message, ...]:
        """Make the step that is due; returns what is to be published."""
        pending = self._pending.popleft()
        sample = pending.sample
        if sample is None:
            return self.tick(pending.since)
        self._notes.newest = sample
        values: list[Any] = list(self._blank)
        values[self._columns.index(type(sample)) + self._instrument] = sample
        for item in self._joins:
            kind = item.topic.message
            partner = self._waiting[kind].pop((sample.epoch, sample.seq + item.offset), None)
            values[self._columns.index(kind) + self._instrument] = partner
        return self._step(values, sample.seq * self.period_s if self.lockstep else now)

    def tick(self, now: float) -> tuple[Message, ...]:
        """Step because the grid says so: read the sensor first."""
        values: list[Any] = list(self._blank)
        if self.service.instrument == "position_sensor":
            values[0] = self._device.read()
        return self._step(values, now)

    def wake(self, now: float) -> tuple[Message, ...]:
        """Step because time has passed; a watched instrument is fed only by a healthy service."""
        values: list[Any] = list(self._blank)
        healthy = self.service.may_feed is None or self.service.may_feed(
            self.config, self.state, now
        )
        if healthy and (fault := self._device.keep_alive(now)):
            values[0] = fault
        return self._step(values, now)

    def wind_down(self, now: float) -> bool:
        """Bring the instrument to rest before the program ends; true where it is."""
        if self.service.wind_down is None or self.lockstep:
            return True
        self.state, at_rest = self.service.wind_down(self.config, self.state, now)
        return at_rest

    def _step(self, values: list[Any], now: float) -> tuple[Message, ...]:
        self.steps += 1
        self._now = now
        service = self.service
        self.state, outputs = service.step(
            self.config, self.state, service.inputs_type(*values), now
        )
        if not self._instrument or not outputs or not isinstance(outputs[0], ForInstrument):
            return cast("tuple[Message, ...]", outputs)
        fault = self._device.put_out(outputs[0])
        if fault:
            values = list(self._blank)
            values[0] = fault
            self.state, outputs = service.step(
                self.config, self.state, service.inputs_type(*values), now
            )
            if outputs and isinstance(outputs[0], ForInstrument):
                self._device.put_out(outputs[0])
        return _published(outputs)

    def ask(self, request: Message, now: float) -> tuple[Message | str, tuple[Message, ...]]:
        """Answer a question: the reply, or the text of a refusal, and what is to be published.

        In lockstep it is the time of the last tick, whatever the clock on the wall says, and 0 s
        where an epoch begins.
        """
        if self.lockstep:
            now = 0.0 if isinstance(request, Arm) else self._now
        if isinstance(request, StatusRequest):
            return self._status(), ()
        config = self.config
        try:
            if isinstance(request, Arm):
                config = self._may_arm(request)
            found_V = self._device.recover() if isinstance(request, Reset) else None
            self.state, reply, outputs = self.service.answer(config, self.state, request, now)
        except RefusedError as error:
            return str(error), ()
        if isinstance(request, Arm):
            self.config, self.calibration = config, parse_calibration(request.calibration)
            self._now = now
            self._pending.clear()
            for waiting in self._waiting.values():
                for place in [place for place in waiting if place[0] != request.epoch]:
                    del waiting[place]
            if self._paced and self.lockstep:
                self._pending.append(Pending(None, 0.0))
        noted = self._notes.taken(request, self.config, self.state)
        if outputs and isinstance(outputs[0], ForInstrument):
            fault = self._device.put_out(outputs[0])
            if fault:
                return fault, noted
        elif found_V is not None and self.service.adopt is not None:
            self.state = self.service.adopt(self.config, self.state, found_V)
        return reply, (*_published(outputs), *noted)

    def _may_arm(self, request: Arm) -> Any:
        """Return what the service works with in the epoch asked for; raises RefusedError."""
        if request.digest != self.digest:
            raise RefusedError(
                f"{self.service.name} runs with rig file {self.digest}, the others with "
                f"{request.digest}: start all programs with the same file"
            )
        if COMMAND in self.service.outputs and request.owner != self.instance:
            raise RefusedError(
                f"this controller is instance {self.instance}, not {request.owner}: "
                "a second one runs on this rig"
            )
        if self._too_slow:
            raise RefusedError(f"the instruments are too slow: {self._too_slow}")
        if self.service.instrument == "position_sensor":
            self._device.capture(request.capture_hz)
        if request.calibration == self.calibration.text():
            return self.config
        try:
            return self.service.configure(
                calibrated(self._rig, parse_calibration(request.calibration))
            )
        except ConfigError as error:
            raise RefusedError(f"{self.service.name}: {error}") from error

    def _status(self) -> Status:
        state = self.state
        return Status(
            service=self.service.name,
            version=__version__,
            instance=self.instance,
            digest=self.digest,
            epoch=state.epoch,
            steps=self.steps,
            missed=self.missed,
            refused=self.refused + getattr(state, "refused", 0),
            detail=getattr(state, "detail", ""),
            calibration=self.calibration.digest,
        )

    def close(self) -> None:
        """Give the instrument back."""
        self._device.close()


def _stream(sample: Sample) -> tuple[type[Sample], int, int | None]:
    """Topic, epoch and owner."""
    return type(sample), sample.epoch, getattr(sample, "owner", None)


def _published(outputs: tuple[Message | ForInstrument, ...]) -> tuple[Message, ...]:
    """Outputs without what was for the instrument."""
    return tuple(output for output in outputs if not isinstance(output, ForInstrument))
