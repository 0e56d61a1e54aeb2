"""A service at work: its state, the samples that wait for a partner, its instrument.

A node knows no thread and no bus, so the same node runs in an own process over Zenoh and beside
its neighbours in one process; what drives it hands it messages and the time.
"""

from collections import deque
from collections.abc import Callable
from time import monotonic
from typing import Any

from pincette import __version__
from pincette.config import Calibration, ConfigError, RigFile, calibrated, parse_calibration
from pincette.control.safety.confirmation import differs
from pincette.core.faults import Cause, Fault, Predecessor
from pincette.core.idle_sampling import idle_periods
from pincette.core.messages import Arm, Message, Reset, Sample, Status, StatusRequest
from pincette.core.messages.requests import ExchangeTimes, InstrumentCounts
from pincette.core.service import AnyService, Busy, PutOut, ReadBack, RefusedError, Role, Slept
from pincette.core.topics import COMMAND
from pincette.core.wording import fault_text
from pincette.engine.boot_note import FIRST, Before
from pincette.engine.exchange_times import with_hop
from pincette.engine.instrument import ORDERS, Device, ReadingWatch, longest_reading_s, published
from pincette.engine.instruments import Instruments
from pincette.engine.request_log import RequestRecorder
from pincette.engine.synchronizer import KEPT, Pending, Synchronizer, stream_of
from pincette.engine.timing_budget import Budget, known_budget
from pincette.instruments.line.counts import LineCounts

JOIN_WAIT_PERIODS = 0.25


class Node:
    """Joins inputs by number, steps the service, moves its instrument."""

    def __init__(
        self,
        service: AnyService,
        rig: RigFile,
        device: Device = None,
        instance: int = 1,
        *,
        check_timing: bool = True,
        before: Before = FIRST,
        line_counts: LineCounts | None = None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """``check_timing``: no arming where the instruments do not fit into the period.

        ``line_counts`` are those of the lines to ``device``; ``clock`` measures how long it takes
        to read it.
        """
        self.service = service
        self.instance, self._before = instance, before
        self.digest = rig.digest()
        self.lockstep = rig.lockstep
        self.period_s = rig.rig.period_s
        self.calibration = Calibration()
        self.config: Any = service.configure(rig)
        self.state: Any = service.start(self.config)
        oldest_s = longest_reading_s(self.period_s)
        watch = None if rig.lockstep else ReadingWatch(oldest_s, clock)
        self._device = Instruments(device, self.period_s, watch, line_counts)
        if service.booted is not None:
            self.state = service.booted(self.state, before.ended)
        if service.initialize_from_output is not None:
            self._begin_from(self._device.read_back())
        self.steps = self.missed = 0
        self.refused = 0
        """Samples that were not taken for their number."""
        self._rig = rig
        self._now = 0.0
        # Judged before the loop turns: loading a driver takes longer than a tick.
        self._instrument = service.instrument is not None
        judges = check_timing and self._instrument
        self._budget: Budget | None = known_budget(rig) if judges else None
        """What a tick takes, by which an arming is refused; None where that is not judged."""
        self._said: tuple[Any, ...] = ()  # outputs of the newest step
        self._drives = service.instrument == "voltage_output"
        self._urls = [arm.output.url if self._drives else arm.sensor.url for arm in rig.arms]
        self._joins = Synchronizer(service)
        self._roles: dict[type, Role] = {item.topic.message: item.role for item in service.inputs}
        self._paced = any(item.role == "pace" for item in service.inputs)
        self._pending: deque[Pending] = deque()
        self._notes = RequestRecorder(service)
        self._told_to_end: Predecessor | None = None
        self._at_rest = False
        self._idle_periods = idle_periods(self.period_s)

    def _begin_from(self, found: PutOut) -> None:
        """Begin from what is put out, whoever set it."""
        if self.service.initialize_from_output is not None:
            self.state = self.service.initialize_from_output(
                self.config, self.state, found.voltages_V
            )

    def accept(self, sample: Any, now: float) -> None:
        """Take a sample of one of its inputs."""
        role = self._roles[type(sample)]
        if role == "join":
            self._joins.keep(sample, self.state.epoch)
            if self.service.ahead is not None:
                self.state = self.service.ahead(self.config, self.state, sample)
        elif role == "trigger":
            if self.lockstep or self._displaces(sample):
                self._pending.append(Pending(sample, now))
        elif self.lockstep and sample.seq >= 0 and not sample.final:
            # Arming began tick 0; the applied voltage of seq -1 is where it starts from.
            self._pending.append(Pending(None, (sample.seq + 1) * self.period_s))

    def _displaces(self, sample: Sample) -> bool:
        """In real time only the newest sample of a stream counts; a backlog is never played.

        What another epoch or owner says is a stream of its own, and one that is repeated is older:
        neither must push out what counts.
        """
        stream = stream_of(sample)
        for pending in self._pending:
            if pending.sample is not None and stream_of(pending.sample) == stream:
                if sample.seq <= pending.sample.seq:
                    self.refused += 1
                    return False
                self._pending.remove(pending)
                self.missed += 1
                return True
        if len(self._pending) >= KEPT:
            self._pending.popleft()
            self.missed += 1
        return True

    def due(self, now: float) -> bool:
        """Whether a step can be made."""
        if not self._pending:
            return False
        first = self._pending[0]
        if first.sample is None or self._joins.complete(first.sample):
            return True
        # As ``patience`` counts it, to the last bit: or a driver would wait for no time, again and
        # again.
        return not self.lockstep and now >= first.since + self._join_wait_s(first.sample)

    def patience(self, now: float) -> float | None:
        """Seconds until a step must be made without its partner; None where nothing waits."""
        if self.lockstep or not self._pending:
            return None
        first = self._pending[0]
        return max(0.0, first.since + self._join_wait_s(first.sample) - now)

    def _join_wait_s(self, sample: Sample | None) -> float:
        """Return how long a step waits for its partners.

        The actuator publishes the partner of an idle sensor's sample only when it has the sample,
        so there is more time: as much as for each of the samples that are left out. A sample that
        was lost changes nothing, since an armed loop has no time to wait.
        """
        newest = self._notes.newest
        if sample is None or newest is None or newest.epoch != sample.epoch:
            return JOIN_WAIT_PERIODS * self.period_s
        idle = sample.seq - newest.seq >= self._idle_periods
        return (self._idle_periods if idle else 1) * JOIN_WAIT_PERIODS * self.period_s

    def fire(self, now: float) -> tuple[Message, ...]:
        """Make the step that is due; returns what is to be published."""
        pending = self._pending.popleft()
        sample = pending.sample
        if sample is None:
            return self.tick(pending.since)
        self._notes.newest = sample
        values = self._joins.row_of(sample)
        return self._step(values, sample.seq * self.period_s if self.lockstep else now)

    @property
    def newest(self) -> Sample | None:
        """The sample of the newest step that one has led to."""
        return self._notes.newest

    def tick(self, now: float) -> tuple[Message, ...]:
        """Step because the grid says so: read the sensor first."""
        values = self._joins.row()
        if self.service.instrument == "position_sensor":
            values[0] = self._device.read()
        return self._step(values, now)

    def wake(self, now: float) -> tuple[Message, ...]:
        """Step because time has passed; a watched instrument is fed only by a healthy service."""
        values = self._joins.row()
        judge = self.service.may_kick_watchdog
        healthy = judge is None or judge(self.config, self.state, now)
        if healthy and (fault := self._device.keep_alive(now)):
            values[0] = fault
        return self._step(values, now)

    def told(self, said: Slept | Busy, now: float) -> tuple[Message, ...]:
        """Step because of what the machine or the program did, where an output is driven."""
        if not self._drives:
            return ()
        values = self._joins.row()
        values[0] = said
        return self._step(values, now)

    def shutdown(self, now: float) -> bool:
        """Bring the instrument to rest before the program ends; true where it is."""
        if self._told_to_end is None and self.service.ending is not None:
            self._told_to_end = self.service.ending(self.state)
        if self.service.shutdown is None or self.lockstep:
            return True
        self.state, self._at_rest = self.service.shutdown(self.config, self.state, now)
        return self._at_rest

    @property
    def ending(self) -> Predecessor:
        """What this program, which was told to end, is to the next one."""
        told = self._told_to_end
        at_rest = self.lockstep or (self._at_rest and not getattr(self.state, "unconfirmed", False))
        return told if told is not None and at_rest else Predecessor.DIED

    def _step(self, values: list[Any], now: float) -> tuple[Message, ...]:
        self.steps += 1
        self._now = now
        service = self.service
        outputs: tuple[Any, ...]
        self.state, outputs = service.step(
            self.config, self.state, service.inputs_type(*values), now
        )
        if not self._instrument or not outputs or not isinstance(outputs[0], ORDERS):
            self._said = outputs
            return outputs
        said = self._device.put_out(outputs[0])
        while said is not None:
            values = self._joins.row()
            values[0] = said
            self.state, outputs = service.step(
                self.config, self.state, service.inputs_type(*values), now
            )
            if not outputs or not isinstance(outputs[0], ORDERS):
                break
            said = self._device.put_out(outputs[0])
            if not isinstance(outputs[0], ReadBack):
                break
        return published(outputs)

    def look_ahead(self) -> None:
        """The outputs of the newest step are published: work out what the next one will need."""
        if self.service.ahead is not None and self._said:
            self.state = self.service.ahead(self.config, self.state, self._said[0])
            self._said = ()

    def call(self, request: Message, now: float) -> tuple[Message | str, tuple[Message, ...]]:
        """Answer a request: the reply, or the text of a refusal, and what is to be published."""
        # In lockstep it is the time of the last tick, whatever the clock on the wall says.
        if self.lockstep:
            now = 0.0 if isinstance(request, Arm) else self._now
        if isinstance(request, StatusRequest):
            return self._status(), ()
        config = self.config
        try:
            if isinstance(request, Arm):
                config = self._may_arm(request)
            resets = self._drives and isinstance(request, Reset)
            found = self._device.recover() if resets else None
            self.state, reply, outputs = self.service.handle(config, self.state, request, now)
        except RefusedError as error:
            return str(error), ()
        if isinstance(request, Arm):
            self.config, self.calibration = config, parse_calibration(request.calibration)
            self._now = now
            self._pending.clear()
            self._joins.begin(request.epoch)
            if self._paced and self.lockstep:
                self._pending.append(Pending(None, 0.0))
        noted = self._notes.taken(request, self.config, self.state)
        if outputs and isinstance(outputs[0], ORDERS):
            fault = self._device.put_out(outputs[0])
            if isinstance(fault, Fault):
                if self.lockstep:
                    return fault_text(fault), noted
                # The request has been obeyed; what its voltage became is for the service to judge.
                values = self._joins.row()
                values[0] = fault
                return reply, (*published(outputs), *self._step(values, now), *noted)
        elif found is not None:
            self._begin_from(found)
        return reply, (*published(outputs), *noted)

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
        if self.service.instrument == "position_sensor":
            self._device.capture(request.capture_hz)
        if self.service.initialize_from_output is not None:
            found = self._device.read_back()
            if differs(self.state, found.voltages_V):
                self._begin_from(found)
            self._device.measure()
        self._check_timing()
        if request.calibration == self.calibration.text():
            return self.config
        try:
            rig = calibrated(self._rig, parse_calibration(request.calibration))
            return self.service.configure(rig)
        except ConfigError as error:
            raise RefusedError(f"{self.service.name}: {error}") from error

    def _check_timing(self) -> None:
        """Refuse an arming if the instruments do not fit into the period; raises RefusedError.

        The actuator judges what the drivers state, and each program what it has measured itself.
        """
        stated, exchanges = self._budget, self._device.exchanges
        if stated is None:
            return
        sensors, outputs = ((), exchanges) if self._drives else (exchanges, ())
        needed = stated.measured(sensors, outputs)
        if not needed.fits and (self._drives or stated.fits):
            raise RefusedError(f"the instruments are too slow: {needed.words()}")

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
            calibration=self.calibration.digest,
            mode=getattr(state, "mode", None),
            cause=getattr(state, "cause", Cause.NONE),
            faults=getattr(state, "faults", ()),
            findings=getattr(state, "findings", ()),
            predecessor=getattr(state, "predecessor", None),
            replaces=self._before.instance,
            instrument=self._instrument_counts(),
            exchanges=self._exchanges(),
        )

    def _instrument_counts(self) -> InstrumentCounts | None:
        counts = self._device.counts
        if not self._instrument:
            return None
        return InstrumentCounts(
            counts.late, counts.lost, counts.unexpected, counts.reopened, counts.retried
        )

    def _exchanges(self) -> tuple[ExchangeTimes, ...]:
        """Return what exchanges took for each arm, and what device server was found on the way."""
        arrivals = self._device.counts.arrivals
        return tuple(
            with_hop(took, arrivals.get(url))
            for took, url in zip(self._device.exchanges, self._urls, strict=False)
        )

    def close(self) -> None:
        """Give the instrument back."""
        self._device.close()
