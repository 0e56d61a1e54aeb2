"""A running service: its state, its inputs, its instrument, its timer and its statistics.

A runner has no thread, no bus and no clock: its caller passes it messages and the time. So the same
runner works in a separate program over Zenoh, beside others in one process, in a replay, and in
the virtual time of the tests.
"""

from collections.abc import Callable
from math import floor
from time import monotonic
from typing import Any

from pincette import __version__
from pincette.config import Calibration, ConfigError, RigFile, calibrated, parse_calibration
from pincette.control.safety.confirmation import differs
from pincette.core.faults import Cause, Fault, Predecessor
from pincette.core.messages import Arm, Message, Reset, Status, StatusRequest, TimingRequest
from pincette.core.messages.requests import ExchangeTimes, InstrumentCounts
from pincette.core.service import AnyService, Busy, PutOut, ReadBack, RefusedError, Slept
from pincette.core.topics import COMMAND
from pincette.core.wording import fault_text
from pincette.engine.boot_note import FIRST, Before
from pincette.engine.exchange_times import with_hop
from pincette.engine.instrument import ORDERS, Device, ReadingWatch, longest_reading_s, published
from pincette.engine.instruments import Instruments
from pincette.engine.joiner import Joiner, Row
from pincette.engine.request_log import RequestRecorder
from pincette.engine.timing_budget import Budget, known_budget
from pincette.engine.timing_stats import TimingStats
from pincette.instruments.line.counts import LineCounts

IDLE_S = 0.5
"""Longest time that a program waits before it checks whether it is to stop, in s."""
EARLY = 1.5
"""Number of intervals. If the next timer step is due later than after this many timer intervals, it
is brought forward."""
NO_CLOCK = "in lockstep there is no clock, so nothing is late"

Outputs = tuple[Message, ...]


class Runner:
    """Takes samples, requests and the time; steps its service, and writes to its instrument.

    Messages lead to steps by ``fire``, and the timer by ``tick``. After the outputs of a step have
    been published, ``settle`` does the remaining work, for which no program waits.
    """

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
        recorded: bool = False,
    ) -> None:
        """Start the service.

        Parameters
        ----------
        check_timing
            True refuses to arm if the instruments do not fit into the period.
        line_counts
            Counts of the lines to ``device``.
        clock
            Clock that measures the duration of reading ``device``.
        recorded
            True for samples of a record: numbers are not checked, no step waits for a partner, and
            no statistics are collected.
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
        self.steps = 0
        self._rig = rig
        self._now = 0.0
        # Determined before the loop runs, since importing a driver takes longer than a tick.
        self._instrument = service.instrument is not None
        judges = check_timing and self._instrument
        self._budget: Budget | None = known_budget(rig) if judges else None
        """Planned durations of a tick, by which an arming may be refused; None: they are not
        checked."""
        self._reads = service.instrument == "position_sensor"
        self._drives = service.instrument == "voltage_output"
        self._urls = [arm.output.url if self._drives else arm.sensor.url for arm in rig.arms]
        self.joiner = Joiner(service, self.period_s, lockstep=self.lockstep, recorded=recorded)
        self.on_refused: Callable[[Any], object] | None = None
        """Function called with each sample that is refused because of its number."""
        self._paced = any(item.role == "pace" for item in service.inputs)
        self._requests = RequestRecorder(service)
        self._told_to_end: Predecessor | None = None
        self._at_rest = False
        self._outputs: Outputs = ()
        """Outputs of the newest step until it is settled."""
        self._stepped_s = 0.0
        """Time at which the newest step began, in s."""
        self._timed = False
        """True if the timer caused the newest step."""
        self.on_grid = self._reads and not self.lockstep
        """True if the timer takes samples; False if it only checks the time."""
        self.starts_tick = self._reads and self.lockstep
        self.due_at: float | None = None
        own_grid = self.interval_s is not None
        self.stats = (
            None
            if self.lockstep or recorded
            else TimingStats(service, self.period_s, own_grid=own_grid)
        )
        """Timing statistics; None in lockstep, which has no clock."""

    @property
    def missed(self) -> int:
        """Return the number of samples displaced by newer ones, and of missed grid points."""
        return self.joiner.missed

    @property
    def refused(self) -> int:
        """Return the number of samples that were refused because of their number."""
        return self.joiner.refused

    @property
    def interval_s(self) -> float | None:
        """Return the time between two timer steps, which an arming may change.

        None without a timer.
        """
        if self.on_grid:
            return self.period_s
        wake_s = self.service.wake_s
        return None if self.lockstep or wake_s is None else wake_s(self.config)

    def _until_next_s(self) -> float | None:
        """Return the time from one timer step to the next one in the present state."""
        interval_s, timer_s = self.interval_s, self.service.timer_s
        if interval_s is None or timer_s is None:
            return interval_s
        until_s = timer_s(self.config, self.state)
        # A heartbeat is sent to a watched output once per period.
        return min(until_s, self.period_s) if self._device.watched else until_s

    def _hasten(self, now: float) -> None:
        """Bring the next timer step forward if the state needs steps more often.

        The step stays on the grid of the shorter interval.
        """
        if self.due_at is None or self.service.timer_s is None:
            return
        ahead_s, until_next_s = self.due_at - now, self._until_next_s()
        if until_next_s is not None and ahead_s > EARLY * until_next_s:
            self.due_at -= floor(ahead_s / until_next_s) * until_next_s

    def _begin_from(self, found: PutOut) -> None:
        """Begin from the voltages that are applied, whatever program set them."""
        if self.service.initialize_from_output is not None:
            self.state = self.service.initialize_from_output(
                self.config, self.state, found.voltages_V
            )

    def begin(self, now: float) -> None:
        """Start the timer: its first step is one interval from now."""
        interval_s = self.interval_s
        self.due_at = None if interval_s is None else now + interval_s
        if self.stats is not None:
            self.stats.starts(now)

    def take(self, sample: Any, now: float, came_at: float | None = None) -> None:
        """Take a sample of one of its inputs, which arrived at ``came_at`` (None: now)."""
        role = self.joiner.take(sample, now, self.state.epoch)
        if role == "trigger":
            if self.stats is not None:
                self.stats.came(sample, now if came_at is None else came_at)
        elif role is None and self.on_refused is not None:
            self.on_refused(sample)

    def ready(self, now: float) -> bool:
        """Return whether ``fire`` would make a step."""
        return self.joiner.wait_s(now) == 0.0

    def wait_s(self, now: float) -> float:
        """Return the longest time to wait for a message."""
        wait_s = IDLE_S
        if self.joiner.pending:
            join_s = self.joiner.wait_s(now)
            if join_s is not None and join_s < wait_s:
                wait_s = join_s
        if self.due_at is not None and self.due_at - now < wait_s:
            wait_s = max(0.0, self.due_at - now)
        return wait_s

    def due(self, now: float) -> bool:
        """Return whether the timer step is due."""
        return self.due_at is not None and now >= self.due_at

    def fire(self, now: float) -> Outputs | None:
        """Make the step that messages have caused, and return what is to be published.

        None if no step can be made.
        """
        if not self.joiner.pending:
            return None
        joined = self.joiner.next(now)
        if joined is None:
            return None
        row, sample, at_s = joined
        if sample is None:
            if self._reads:
                row[0] = self._device.read()
        else:
            at_s = sample.seq * self.period_s if self.lockstep else now
        self._stepped_s, self._timed = now, False
        self._outputs = outputs = self._step(row, at_s)
        return outputs

    def tick(self, now: float) -> Outputs:
        """Make the timer step, and return what is to be published.

        If there is a sensor, it is read. An output's watchdog gets a heartbeat only if the service
        is healthy.
        """
        row = self.joiner.blank()
        if self._reads:
            row[0] = self._device.read()
        else:
            judge = self.service.may_kick_watchdog
            healthy = judge is None or judge(self.config, self.state, now)
            if healthy and (fault := self._device.keep_alive(now)):
                row[0] = fault
        self._stepped_s, self._timed = now, True
        self._outputs = outputs = self._step(row, now)
        return outputs

    def settle(self, now: float) -> None:
        """Complete the newest step, whose outputs have been published.

        Adds its times to the statistics. The next timer step stays on the grid; missed points are
        skipped.
        """
        stats, outputs, timed = self.stats, self._outputs, self._timed
        self._timed = False
        if stats is not None:
            if not timed:
                stats.fired(self.joiner.newest, self._stepped_s, outputs)
                stats.published(now)
            elif self.due_at is not None:
                stats.clocked(self.due_at, self._stepped_s, outputs)
                stats.published(now)
        if self.due_at is None:
            return
        if not timed:
            self._hasten(now)
            return
        interval_s = self._until_next_s()
        if interval_s is None:
            return
        late = int((now - self.due_at) / interval_s)
        if self.on_grid:
            self.joiner.missed += late
        self.due_at += (late + 1) * interval_s

    def account_for(self, stall: Slept | Busy, now: float) -> Outputs:
        """Make a step that reports that the machine slept or the program was busy, if the service
        has an output.
        """
        if not self._drives:
            return ()
        row = self.joiner.blank()
        row[0] = stall
        return self._step(row, now)

    def _step(self, row: Row, now: float) -> Outputs:
        self.steps += 1
        self._now = now
        service = self.service
        outputs: tuple[Any, ...]
        self.state, outputs = service.step(self.config, self.state, service.inputs_type(*row), now)
        if self._instrument and outputs and isinstance(outputs[0], ORDERS):
            return self._obey(outputs, now)
        return outputs

    def _obey(self, outputs: tuple[Any, ...], now: float) -> Outputs:
        """Pass the command of a step to the instrument, and let the service process the reply."""
        service = self.service
        found = self._device.put_out(outputs[0])
        while found is not None:
            row = self.joiner.blank()
            row[0] = found
            self.state, outputs = service.step(
                self.config, self.state, service.inputs_type(*row), now
            )
            if not outputs or not isinstance(outputs[0], ORDERS):
                break
            found = self._device.put_out(outputs[0])
            if not isinstance(outputs[0], ReadBack):
                break
        return published(outputs)

    def timing(self, now: float) -> Outputs:
        """Return the timing statistics if it is time to publish them."""
        stats = self.stats
        return (stats.timing(self.missed),) if stats is not None and stats.due(now) else ()

    def call(self, request: Message, now: float) -> tuple[Message | str, Outputs]:
        """Handle a request: return the reply or the text of a refusal, and the messages to
        publish.
        """
        stats = self.stats
        if isinstance(request, TimingRequest):
            return NO_CLOCK if stats is None else stats.timing(self.missed), ()
        reply, outputs = self._handle(request, now)
        if isinstance(request, Arm) and not isinstance(reply, str) and stats is not None:
            stats.begin(request.epoch, self.missed)
        self._hasten(now)
        return reply, outputs

    def _handle(self, request: Message, now: float) -> tuple[Message | str, Outputs]:
        # In lockstep the time is that of the last tick, whatever the wall clock states.
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
            self.joiner.begin(request.epoch, now)
            if self._paced and self.lockstep:
                self.joiner.begin_tick(0.0)
        noted = self._requests.taken(request, self.config, self.state, self.joiner.newest)
        if outputs and isinstance(outputs[0], ORDERS):
            fault = self._device.put_out(outputs[0])
            if isinstance(fault, Fault):
                if self.lockstep:
                    return fault_text(fault), noted
                # The request has been executed; the service checks the resulting voltage.
                row = self.joiner.blank()
                row[0] = fault
                return reply, (*published(outputs), *self._step(row, now), *noted)
        elif found is not None:
            self._begin_from(found)
        return reply, (*published(outputs), *noted)

    def _may_arm(self, request: Arm) -> Any:
        """Return the configuration for the requested epoch; raises RefusedError."""
        if request.digest != self.digest:
            raise RefusedError(
                f"{self.service.name} runs with rig file {self.digest}, the others with "
                f"{request.digest}: start all programs with the same file"
            )
        if COMMAND in self.service.outputs and request.owner != self.instance:
            raise RefusedError(
                f"this controller is instance {self.instance}, not {request.owner}: a second "
                "one is running on this rig"
            )
        if self._reads:
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

        The actuator checks the durations stated by the drivers, and each program those that it has
        measured itself.
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
        """Return the durations of exchanges for each arm, with the device server where known."""
        arrivals = self._device.counts.arrivals
        return tuple(
            with_hop(took, arrivals.get(url))
            for took, url in zip(self._device.exchanges, self._urls, strict=False)
        )

    def shutdown(self, now: float) -> bool:
        """Bring the instrument to rest before the program ends; return True once it is at rest."""
        if self._told_to_end is None and self.service.ending is not None:
            self._told_to_end = self.service.ending(self.state)
        if self.service.shutdown is None or self.lockstep:
            return True
        self.state, self._at_rest = self.service.shutdown(self.config, self.state, now)
        return self._at_rest

    @property
    def ending(self) -> Predecessor:
        """Return the report to the next program about the end of this one, which was stopped."""
        noted = self._told_to_end
        at_rest = self.lockstep or (self._at_rest and not getattr(self.state, "unconfirmed", False))
        return noted if noted is not None and at_rest else Predecessor.DIED

    def close(self) -> None:
        """Close the instrument."""
        self._device.close()
