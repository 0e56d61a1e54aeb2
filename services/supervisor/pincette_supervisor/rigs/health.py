"""Decision whether the programs of a rig can take part in a job, with the reasons in words."""

import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, ThreadPoolExecutor
from functools import partial
from itertools import count
from time import monotonic
from typing import NamedTuple, cast

from pincette.api.live import LoopTiming
from pincette.api.rig_states import RigState
from pincette.bus.protocol import Bus, BusError
from pincette.config import ConfigError, RigFile
from pincette.core.faults import Cause, Fault, FaultCode, Mode, Predecessor
from pincette.core.idle_sampling import SAMPLE_S
from pincette.core.messages import Applied, Idle, Position, Reset, Status, Timing, TimingRequest
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.plugins import PluginError
from pincette.core.topics import IDLE, LOOP, RESET, TIMING_OF
from pincette.core.wording import fault_text
from pincette.engine.arming import status
from pincette.engine.timing_budget import Budget, budget, lets_go_s
from pincette.records.timings import program_timing
from pincette_supervisor.alarms import TripReason, reason_of
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.rigs.observer import Observer

ASK_S = 0.7
FRESH_S = 0.5
"""Age up to which a status is used before the programs are queried again, in s."""
SENSOR_PERIODS, SENSOR_S = 10.0, 0.2
"""Longest silence of the sensor, or time without a position, in periods and in s; the larger one
counts."""
IDLE_SENSOR_S = 5.0 * SAMPLE_S
"""Longest silence in s while the sensor of an idle rig samples at its slow rate."""
PROGRAMS = (*LOOP, "recorder")
"""Programs that a job needs."""
SIMULATION = "rig"
"""Program of a simulated rig in real time; a job does not wait for its status."""
SHOWN: dict[Mode, RigState] = {
    Mode.IDLE: "idle",
    Mode.ARMED: "armed",
    Mode.FROZEN: "frozen",
    Mode.RAMPING: "ramping",
    Mode.LATCHED: "latched",
}
UNTRUSTED = -1
"""Instance number that no program has."""
MET, CLEARED = "actuator_met", "actuator_boot_cleared"
HOLDER = "part_holder"
"""Name of the note about the actuator that holds a part."""


class LatchState(NamedTuple):
    """Mode of the actuator, None before its first sample, and the reason of its latch."""

    mode: Mode | None = None
    reason: TripReason = TripReason(Cause.NONE)

    @property
    def shown(self) -> str:
        """Return the mode in words; see ``Health.state`` for REST."""
        return "unknown" if self.mode is None else str(self.mode)


class Health:
    """Statuses of the programs, and the actuator's latch."""

    # An actuator starts latched. If none was recorded before it, or the last one ended cleanly,
    # that latch means only that the rig was switched on, and it is cleared once without
    # confirmation; in any other case an actuator has ended unexpectedly, and a person must confirm
    # that.

    def __init__(
        self,
        rig: RigFile,
        bus: Bus,
        observer: Observer,
        store: Store,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._rig, self._bus, self._observer, self._store = rig, bus, observer, store
        self._digest = rig.digest()
        self.clock = clock
        self._write_queue = WriteQueue()
        """Queue of notes, so that no reset waits for a disk."""
        self._met, self._cleared, self._holder = (
            f"{note}: {rig.rig.name}" for note in (MET, CLEARED, HOLDER)
        )
        self._holder_instance = store.get_note(self._holder) or ""
        """Instance of the actuator that was last known to hold a part; empty if the gripper was
        last known to be empty. It is kept in memory like ``_cleared_instance``."""
        self._budget = _budget(rig)
        self.lets_go_s = lets_go_s(rig)
        """Time without its host after which the output may have released a part, in s."""
        self._asked_at = float("-inf")
        self._asked_of = -1
        """Programs that were present at the last query; see ``Observer.tokens_changed``."""
        self._rounds, self._round = count(1), 0
        self._turn = threading.Lock()
        self._pool = ThreadPoolExecutor(len(PROGRAMS) + 1, thread_name_prefix="status")
        self.statuses: dict[str, Status | str] = {}
        """Status of each service, or why there is none."""
        self.simulation: Status | None = None
        """Status of the program that simulates the rig, if any."""
        self._armed: tuple[int, str] | None = None
        self._trusted: int | None = None
        self._met_before = False
        self._seldom: tuple[int, int] | None = None
        """Instance and epoch of the sensor that was set to its slow rate."""
        self._cleared_instance = ""
        """Instance of the actuator whose latch was last cleared. It is kept in memory: streams read
        it on the event loop, where no read may wait for a disk."""
        self.changed = ""
        """Difference of the served rig file from that of the programs, in words."""

    def refresh(self, *, force: bool = False) -> None:
        """Query all programs concurrently, unless they have just replied and none came or went."""
        there, number = self._observer.tokens_changed, next(self._rounds)
        if not force and there == self._asked_of and self.clock() - self._asked_at < FRESH_S:
            return
        try:
            programs: list[str] = [*PROGRAMS]
            if self._observer.alive(SIMULATION):
                programs.append(SIMULATION)
            answers = dict(zip(programs, self._pool.map(self._ask, programs), strict=True))
        except (RuntimeError, CancelledError):
            return  # closed, since the rig is being reopened: the last replies are kept
        with self._turn:
            if number < self._round:
                return  # a later query of another thread is already complete
            simulation = answers.pop(SIMULATION, None)
            self.simulation = simulation if isinstance(simulation, Status) else None
            self.statuses = answers
            self._round, self._asked_at, self._asked_of = number, self.clock(), there
        actuator = self.status("actuator")
        if actuator is not None and self._trusted is None:
            self._meet(actuator)

    def _meet(self, actuator: Status) -> None:
        """Trust the first actuator, unless it replaced one that is not known to have ended cleanly.

        An earlier actuator that was trusted, and was only switched on and off, counts as ended
        cleanly.
        """
        self._cleared_instance = self._store.get_note(self._cleared) or ""
        noted = self._store.get_note(self._met)
        self._met_before = noted == str(actuator.instance)
        ended_well = actuator.predecessor is Predecessor.CLEAN or (
            actuator.predecessor is Predecessor.NONE and noted == str(actuator.replaces)
        )
        if noted is None or self._met_before or ended_well:
            self._trusted = actuator.instance
            self._note(self._met, actuator.instance)
        else:
            self._trusted = UNTRUSTED

    def status(self, service: str) -> Status | None:
        """Return the last status of a service; None if it did not reply."""
        answer = self.simulation if service == SIMULATION else self.statuses.get(service)
        return answer if isinstance(answer, Status) else None

    def findings(self, service: str, code: FaultCode) -> list[Fault]:
        """Return the faults of a service with one code; empty if it does not reply."""
        answer = self.status(service)
        return [] if answer is None else [one for one in answer.findings if one.code is code]

    def _ask(self, service: str) -> Status | str:
        try:
            return status(self._bus, service, ASK_S)
        except BusError as error:
            return str(error)

    @property
    def asked_age_s(self) -> float | None:
        """Return the time since the programs were queried, in s; None before the first query."""
        return None if self._asked_at == float("-inf") else self.clock() - self._asked_at

    def actuator_answer_age_s(self) -> float | None:
        """Return the age of the actuator's reply, in s.

        None without a reply, or after the actuator was replaced.
        """
        actuator = self.status("actuator")
        if actuator is None or actuator.instance != self._trusted:
            return None
        return self.asked_age_s

    def note_armed(self, epoch: int, model_digest: str) -> None:
        """Set the model with which the rig was armed in an epoch.

        All programs must use this model until the rig is armed again.
        """
        self._armed = (epoch, model_digest)

    def latch(self) -> LatchState:
        """Return the state of the actuator and the reason of its latch, as far as known."""
        actuator = self.status("actuator")
        if actuator is not None and actuator.instance != self._trusted:
            return LatchState(Mode.LATCHED, TripReason(Cause.RESTART))
        applied = self._observer.newest(Applied)
        if applied is None and actuator is not None and actuator.cause == Cause.RESTART:
            return LatchState(actuator.mode, TripReason(actuator.cause))
        return LatchState() if applied is None else LatchState(applied.state, reason_of(applied))

    @property
    def state(self) -> RigState:
        """Return the last state of the actuator; a latch that no person must clear is a separate
        state."""
        if self._boot_may_be_cleared():
            return "switched_on"
        mode = self.latch().mode
        return "unknown" if mode is None else SHOWN[mode]

    def _boot_may_be_cleared(self) -> bool:
        actuator = self.status("actuator")
        if actuator is None or actuator.instance != self._trusted:
            return False
        if self._cleared_instance == str(actuator.instance):
            return False
        mode, reason = self.latch()
        if mode is None:
            return actuator.epoch == 0 and not self._met_before
        return mode == Mode.LATCHED and reason.cause == Cause.BOOT

    def clear_boot(self) -> None:
        """Clear the latch of a rig that was switched on; raises BusError."""
        if self._boot_may_be_cleared():
            self._reset(acknowledge=False)

    def reset(self) -> None:
        """Clear the latch after a person has seen the cause; raises BusError."""
        self._reset(acknowledge=True)
        self.refresh(force=True)

    def _reset(self, *, acknowledge: bool) -> None:
        self._bus.call(RESET, Reset(acknowledge=acknowledge))
        actuator = status(self._bus, "actuator")
        self._trusted = actuator.instance
        self._cleared_instance = str(actuator.instance)
        self._note(self._cleared, actuator.instance)
        self._note(self._met, actuator.instance)

    def note_part(self, held: bool | None) -> None:
        """Store whether the gripper holds a part, across restarts of all programs.

        Parameters
        ----------
        held
            None if the present actuator holds no part and nothing else shows that the gripper is
            empty. A part that this actuator held has then been released; one that an earlier
            actuator held may still be in the gripper.
        """
        actuator = self.status("actuator")
        if actuator is None or (held is None and self.earlier_held()):
            return
        found = str(actuator.instance) if held else ""
        if found != self._holder_instance:
            self._holder_instance = found
            self._write_queue.submit(partial(self._store.set_note, self._holder, found))

    def earlier_held(self) -> bool:
        """Return True if an earlier actuator held a part that is not known to be released."""
        actuator = self.status("actuator")
        present = "" if actuator is None else str(actuator.instance)
        return self._holder_instance not in ("", present)

    def _note(self, name: str, instance: int) -> None:
        """Store a note for the next supervisor, which otherwise requires one more reset."""
        self._write_queue.submit(partial(self._store.set_note, name, str(instance)))

    def latched(self) -> TripReason | None:
        """Return why a person must reset the actuator before a job; None if not needed."""
        mode, reason = self.latch()
        if mode != Mode.LATCHED or self._boot_may_be_cleared():
            return None
        if reason.cause == Cause.BOOT and self.status("actuator") is None:
            return None  # unknown which actuator it is; its missing reply is reported elsewhere
        return reason

    def troubles(self) -> dict[str, str]:
        """Return the reason for each program that cannot take part."""
        found: dict[str, str] = {}
        digest = self._digest
        for service, answer in self.statuses.items():
            if not isinstance(answer, Status):
                found[service] = answer
            elif answer.digest != digest:
                found[service] = (
                    f"runs with rig file {answer.digest}, the supervisor with {digest}: "
                    "start all programs with the same file"
                )
            elif service in LOOP and self._armed and answer.epoch == self._armed[0]:
                epoch_digest = self._armed[1]
                if answer.calibration != epoch_digest:
                    found[service] = (
                        f"uses model {answer.calibration or 'of the rig file'}, armed with "
                        f"{epoch_digest or 'that of the rig file'}"
                    )
        if not self._rig.lockstep and (trouble := self.sensor_trouble()):
            found.setdefault("sensor", trouble)
        return found

    def sensor_limit_s(self) -> float:
        """Return the longest permitted silence of an idle rig's sensor, in s; the sensor
        determines the sampling times."""
        most_s = IDLE_SENSOR_S if self.samples_seldom() else SENSOR_S
        return max(most_s, SENSOR_PERIODS * self._rig.rig.period_s)

    def reduce_sampling(self) -> None:
        """Request the sensor's slow rate until the next arming; no error if it does not reply."""
        sensor = self.status("sensor")
        if sensor is None or self.samples_seldom():
            return
        try:
            self._bus.call(IDLE, Idle(sensor.epoch), ASK_S)
        except BusError:
            return  # its next status shows whether it was armed or has ended
        self._seldom = sensor.instance, sensor.epoch

    def samples_seldom(self) -> bool:
        """Return True if the sensor was set to its slow rate, and has not been armed since."""
        position = self._observer.newest(Position)
        sensor = self.status("sensor")
        if position is None or sensor is None or self._seldom is None:
            return False
        return self._seldom == (sensor.instance, position.epoch)

    def sensor_trouble(self) -> str:
        """Return why the sensor is unusable according to its samples; empty if it is usable."""
        position = self._observer.newest(Position)
        silent_s, limit_s = self._observer.silent_s(Position), self.sensor_limit_s()
        if position is None or silent_s is None:
            return "no sample has come yet"
        if silent_s > limit_s:
            return f"silent for {1e3 * silent_s:.0f} ms, limit {1e3 * limit_s:.0f} ms"
        blind_s = self._observer.blind_s()
        if position.arms[0].valid or (blind_s is not None and blind_s <= limit_s):
            return ""  # one missing reply of an instrument is no fault, as in the loop
        return f"reads no position: {fault_text(position.arms[0].fault) or 'reason unknown'}"

    def reasons(self) -> list[str]:
        """Return why the programs cannot play a job, except for the actuator's state."""
        found = [f"{service}: {trouble}" for service, trouble in self.troubles().items()]
        return found + [why for why in (self.changed, self.too_slow()) if why]

    def exchanges(self) -> dict[str, tuple[ExchangeTimes, ...]]:
        """Return the duration of exchanges for each program with an instrument, and each arm."""
        answers = ((name, self.status(name)) for name in LOOP)
        return {name: answer.exchanges for name, answer in answers if answer and answer.exchanges}

    def too_slow(self) -> str:
        """Return why the instruments do not fit into the control period; empty if they do.

        The larger of the drivers' statement and the programs' measurement counts.
        """
        if isinstance(self._budget, str):
            return self._budget
        took = self.exchanges()
        needed = self._budget.measured(took.get("sensor", ()), took.get("actuator", ()))
        return "" if needed.fits else f"the instruments are too slow: {needed.words()}"

    def close(self) -> None:
        """End the query threads."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _budget(rig: RigFile) -> Budget | str:
    """Return the duration of a tick as the drivers state it, or why it is unknown."""
    try:
        return budget(rig)
    except (PluginError, ConfigError) as error:
        return str(error)


def loop_timing(bus: Bus) -> LoopTiming:
    """Query the programs of the loop concurrently for their timing."""
    with ThreadPoolExecutor(len(LOOP), thread_name_prefix="timing") as pool:
        answers = dict(zip(LOOP, pool.map(partial(_timing_of, bus), LOOP), strict=True))
    return LoopTiming(
        programs=[program_timing(one) for one in answers.values() if isinstance(one, Timing)],
        silent={name: why for name, why in answers.items() if isinstance(why, str)},
    )


def _timing_of(bus: Bus, name: str) -> Timing | str:
    try:
        return cast(Timing, bus.call(TIMING_OF[name], TimingRequest(), ASK_S))
    except BusError as error:
        return str(error)
