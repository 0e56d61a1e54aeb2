"""Whether the programs of a rig can take part in a job, and if not, why, in words."""

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from time import monotonic
from typing import cast

from pincette.bus.protocol import Bus, BusError
from pincette.config import ConfigError, RigFile
from pincette.messages import Applied, Position, Reset, Status
from pincette.plugins import PluginError
from pincette.runtime.arming import status
from pincette.runtime.timing import budget
from pincette.topics import APPLIED, LOOP, POSITION, RESET
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.running.observer import Observer

log = logging.getLogger(__name__)
ASK_S = 0.7
FRESH_S = 0.5
"""How long an answer is good before the programs are asked again."""
SENSOR_PERIODS, SENSOR_S = 10.0, 0.2
"""The sensor may be silent, or read no position, this long, whichever is longer."""
PROGRAMS = (*LOOP, "recorder")
"""Those that a job needs."""
MET, CLEARED = "actuator_met", "actuator_boot_cleared"
RESTARTED = "restart"


class Health:
    """Answers of the programs, and the actuator's latch.

    An actuator boots latched. For the first one this supervisor meets that latch means only that
    the rig was switched on, so it is cleared once without asking; for one that took another's
    place it means that the other died, and a person must have seen that.
    """

    def __init__(
        self,
        rig: RigFile,
        bus: Bus,
        observer: Observer,
        store: Store,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._rig, self._bus, self._observer, self._store = rig, bus, observer, store
        self._clock = clock
        self._met, self._cleared = (f"{note}: {rig.rig.name}" for note in (MET, CLEARED))
        self._too_slow = _too_slow(rig)
        self._asked_at = float("-inf")
        self._pool = ThreadPoolExecutor(len(PROGRAMS), thread_name_prefix="status")
        self.statuses: dict[str, Status | str] = {}
        """For each service its answer, or why there is none."""
        self._armed: tuple[int, str] | None = None
        self._trusted: int | None = None
        self._met_before = False
        self.changed = ""
        """Why what is served here is not what the programs work with, in words."""

    def refresh(self, *, force: bool = False) -> None:
        """Ask all programs side by side, unless they have just answered."""
        if not force and self._clock() - self._asked_at < FRESH_S:
            return
        self.statuses = dict(zip(PROGRAMS, self._pool.map(self._ask, PROGRAMS), strict=True))
        self._asked_at = self._clock()
        actuator = self.statuses["actuator"]
        if isinstance(actuator, Status) and self._trusted is None:
            self._trusted = actuator.instance
            self._met_before = self._store.noted(self._met) == str(actuator.instance)
            self._note(self._met, actuator.instance)

    def _ask(self, service: str) -> Status | str:
        try:
            return status(self._bus, service, ASK_S)
        except BusError as error:
            return str(error)

    @property
    def asked_age_s(self) -> float | None:
        """How long ago the programs were asked; None before the first time."""
        return None if self._asked_at == float("-inf") else self._clock() - self._asked_at

    def note_armed(self, epoch: int, model_digest: str) -> None:
        """Note with which model an epoch was armed; until the next one all must work with it."""
        self._armed = (epoch, model_digest)

    def latch(self) -> tuple[str, str]:
        """State of the actuator and cause of its latch, as far as they are known."""
        actuator = self.statuses.get("actuator")
        if isinstance(actuator, Status) and actuator.instance != self._trusted:
            return "latched", RESTARTED
        applied = cast("Applied | None", self._observer.newest(APPLIED))
        return ("unknown", "") if applied is None else (applied.state, applied.cause)

    def _boot_may_be_cleared(self) -> bool:
        actuator = self.statuses.get("actuator")
        if not isinstance(actuator, Status) or actuator.instance != self._trusted:
            return False
        if self._store.noted(self._cleared) == str(actuator.instance):
            return False
        state, cause = self.latch()
        if state == "unknown":
            return actuator.epoch == 0 and not self._met_before
        return state == "latched" and cause == "boot"

    def clear_boot(self) -> None:
        """Clear the latch of a rig that was switched on; raises BusError."""
        if self._boot_may_be_cleared():
            self._reset()

    def reset(self) -> None:
        """Clear the latch because a person has seen the cause; raises BusError."""
        self._reset()
        self.refresh(force=True)

    def _reset(self) -> None:
        self._bus.ask(RESET, Reset(acknowledge=True))
        actuator = status(self._bus, "actuator")
        self._trusted = actuator.instance
        self._note(self._cleared, actuator.instance)
        self._note(self._met, actuator.instance)

    def _note(self, name: str, instance: int) -> None:
        """Keep what the next supervisor must know; where it cannot, it asks for one more reset."""
        try:
            self._store.note(name, str(instance))
        except StoreError as error:
            log.error("%s", error)

    def latched(self) -> str:
        """Why a person must reset the actuator before a job; empty where nobody needs to."""
        state, cause = self.latch()
        if state != "latched" or self._boot_may_be_cleared():
            return ""
        if cause == "boot" and not isinstance(self.statuses.get("actuator"), Status):
            return ""  # until it answers nobody knows which one it is, and that is told
        return cause or "unknown"

    def troubles(self) -> dict[str, str]:
        """For each program that cannot take part, why."""
        found: dict[str, str] = {}
        digest = self._rig.digest()
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
                        f"works with model {answer.calibration or 'of the rig file'}, armed with "
                        f"{epoch_digest or 'that of the rig file'}"
                    )
        if not self._rig.lockstep and "sensor" not in found:
            trouble = self.sensor_trouble()
            if trouble:
                found["sensor"] = trouble
        return found

    def sensor_limit_s(self) -> float:
        """How long the sensor of an idle rig may be silent; it owns the clock in real time."""
        return max(SENSOR_S, SENSOR_PERIODS * self._rig.rig.period_s)

    def sensor_trouble(self) -> str:
        """Why the sensor cannot be relied on, by its samples; empty where it can."""
        position = cast("Position | None", self._observer.newest(POSITION))
        silent_s, limit_s = self._observer.silent_s(POSITION), self.sensor_limit_s()
        if position is None or silent_s is None:
            return "no sample has come yet"
        if silent_s > limit_s:
            return f"silent for {1e3 * silent_s:.0f} ms, limit {1e3 * limit_s:.0f} ms"
        blind_s = self._observer.blind_s()
        if position.valid or (blind_s is not None and blind_s <= limit_s):
            return ""  # one answer that an instrument owes is no trouble, as for the loop
        return f"reads no position: {position.fault or 'not known why'}"

    def reasons(self) -> list[str]:
        """Why no job can start, the actuator's latch apart."""
        found = [f"{service}: {trouble}" for service, trouble in self.troubles().items()]
        found += [why for why in (self.changed, self._too_slow) if why]
        state, cause = self.latch()
        cause = self._observer.trips.words(cause, self._rig.rig.period_s)
        if state == "frozen":
            found.append(
                f"actuator: frozen ({cause}); reset it to keep the part held, then hold or "
                "release it by a job, or wait until it has been let go"
            )
        if state == "ramping":
            found.append(f"actuator: ramping ({cause}); wait until it is safe, then reset it")
        return found

    def close(self) -> None:
        """End the threads that ask."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _too_slow(rig: RigFile) -> str:
    """Why the instruments do not fit into the control period; empty where they do."""
    try:
        needed = budget(rig)
    except (PluginError, ConfigError) as error:
        return str(error)
    return "" if needed.fits else f"the instruments are too slow: {needed.words()}"
