"""Script for a simulated rig: orders that are executed at their time on the rig's clock.

The script acts between the rig and its instruments, and between the instruments and their lines. In
lockstep the rig's time passes only when voltages reach it, so no time passes while an output is
unplugged. Faults of readings and voltages affect single values only: buffered acquisitions and
waveforms are correct unless their line fails.
"""

import logging
import threading
from collections.abc import Callable, Mapping, Sequence

from pincette.config import RigFile
from pincette.config.script import (
    LONGEST_DELAY_S,
    OF_SECOND,
    ScriptedOrder,
    objection,
    operation_of,
)
from pincette.core.messages import SimCommand
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.rig.commands import Orders
from pincette.sim.rig.wave import PutOutWave
from pincette.sim.script.faults import (
    EDGE_S,
    Fault,
    Faults,
    Past,
    fault_of,
    holding,
    left,
    misput_V,
    misread_um,
)
from pincette.sim.script.scripted_line import ScriptedLine

FORBIDDEN = (
    "this rig takes no commands: write `scripts = true` into [simulation] of its rig file "
    "and restart it"
)

log = logging.getLogger(__name__)


class Script:
    """Orders of the rig file, timed from the first write, and orders submitted by any thread."""

    def __init__(
        self,
        orders: Sequence[ScriptedOrder] = (),
        *,
        allowed: bool = True,
        seed: int = 1,
        lockstep: bool = True,
        timeouts_s: Mapping[str, float] | None = None,
        two_arms: bool = False,
    ) -> None:
        self._lockstep = lockstep
        self._seed = seed
        self._allowed = allowed
        self._timeouts_s = dict(timeouts_s or {})
        self._rig: Orders | None = None
        self._waiting = [entry.order() for entry in orders]
        self._faults: list[Fault] = []
        self._operations: list[tuple[float, SimCommand]] = []
        self._two_arms = two_arms
        self._voltages: dict[str, Past] = {}
        """Requested voltages of each output."""
        self._lock = threading.Lock()

    def operate(self, rig: Orders) -> None:
        """Use this rig from now on."""
        self._rig = rig

    def order(self, order: SimCommand) -> str:
        """Accept an order; returns the reason for a rejection, empty if it is accepted."""
        if not self._allowed:
            return FORBIDDEN
        if self._rig is None:
            return "there is no rig to operate"
        if words := objection(order):
            return words
        if order.target in OF_SECOND and not self._two_arms:
            return f"{order.target}: this rig has one driven arm; name {order.target[7:]}"
        with self._lock:
            self._take(self._rig.now_s(), order)
        return self._act(self._rig)

    def _take(self, now_s: float, order: SimCommand) -> None:
        operation = operation_of(order.target, order.what)
        if operation is not None and (operation.lasts or operation.what == "heal"):
            self._faults = left(self._faults, now_s)
            self._faults.append(fault_of(order, now_s, operation.default or 0.0))
        else:
            self._operations.append((now_s + order.after_s, order))

    def _act(self, rig: Orders) -> str:
        """Execute all due orders; returns their errors."""
        if not self._operations:
            return ""
        now_s = rig.now_s() + EDGE_S
        with self._lock:
            due = sorted(
                (one for one in self._operations if one[0] <= now_s), key=lambda one: one[0]
            )
            self._operations = [one for one in self._operations if one[0] > now_s]
        trouble = ""
        for _, order in due:
            try:
                carry_out(rig, order)
            except ValueError as error:
                trouble = f"{order.target} {order.what}: {error}"
                log.warning("%s", trouble)
        return trouble

    def _look(self, target: str) -> tuple[float, Faults]:
        """Execute all due orders; returns the time and the active faults of a target."""
        rig = self._rig
        if rig is None:
            return 0.0, Faults()
        self._act(rig)
        now_s = rig.now_s()
        with self._lock:
            return now_s, holding(self._faults, target, now_s) if self._faults else Faults()

    def measure(
        self, measure_um: Callable[[], float], target: str = "sensor"
    ) -> Callable[[], float]:
        """Return the measurement of a sensor with the effects of its faults."""
        readings = Past(LONGEST_DELAY_S)

        def measured_um() -> float:
            now_s, faults = self._look(target)
            x_um = measure_um()
            if faults.value("stuck") is None:
                readings.note(now_s, x_um)
            return misread_um(faults, readings, now_s) if faults else x_um

        return measured_um

    def put_out(
        self, put_out_V: Callable[[float], None], target: str = "output"
    ) -> Callable[[float], None]:
        """Return the output of voltages with the effects of its faults."""
        voltages = self._voltages.setdefault(target, Past(LONGEST_DELAY_S))

        def put_V(voltage_V: float) -> None:
            self._begin()
            now_s, faults = self._look(target)
            if faults.value("stuck") is None:
                voltages.note(now_s, voltage_V)
            put_out_V(misput_V(faults, voltages, now_s) if faults else voltage_V)

        return put_V

    def put_out_wave(self, put_out_wave: PutOutWave, target: str = "output") -> PutOutWave:
        """Return the waveform output of an instrument with the effects of its faults.

        A fault that is active when a waveform begins applies to the whole waveform.
        """
        past = self._voltages.setdefault(target, Past(LONGEST_DELAY_S))

        def put_wave(voltages_V: Sequence[float], rate_hz: float) -> None:
            self._begin()
            now_s, faults = self._look(target)
            if not faults or not voltages_V:
                if voltages_V:
                    past.note(now_s, voltages_V[-1])
                put_out_wave(voltages_V, rate_hz)
                return
            put_V = list[float]()
            for voltage_V in voltages_V:
                if faults.value("stuck") is None:
                    past.note(now_s, voltage_V)
                put_V.append(misput_V(faults, past, now_s))
            put_out_wave(put_V, rate_hz)

        return put_wave

    def _begin(self) -> None:
        """Set the first write as the origin of times in the rig file's orders."""
        if self._waiting and self._rig is not None:
            with self._lock:
                waiting, self._waiting = self._waiting, []
                for order in waiting:
                    self._take(self._rig.now_s(), order)

    def link(self, name: str, instrument: Instrument) -> Instrument:
        """Return an instrument behind a line with faults; ``name`` is its target in orders."""
        patience_s = self._timeouts_s.get(name, LONGEST_DELAY_S) if self._lockstep else None
        return ScriptedLine(
            instrument, lambda: self._look(name)[1], f"{self._seed}/{name}", patience_s
        )


def script_of(rig_file: RigFile) -> Script:
    """Return the script of a rig file: its entries, and whether orders may arrive."""
    simulation = rig_file.simulation
    return Script(
        () if simulation is None else simulation.script,
        allowed=simulation is not None and simulation.scripts,
        seed=1 if simulation is None else simulation.seed,
        lockstep=rig_file.lockstep,
        timeouts_s=timeouts_of(rig_file),
        two_arms=rig_file.second is not None,
    )


def timeouts_of(rig_file: RigFile) -> dict[str, float]:
    """Return the timeout of each instrument in s, by its target in orders."""
    timeouts_s = {"sensor": rig_file.sensor.timeout_s, "output": rig_file.output.timeout_s}
    if (second := rig_file.second) is not None:
        timeouts_s |= {
            "second_sensor": second.sensor.timeout_s,
            "second_output": second.output.timeout_s,
        }
    return timeouts_s


def carry_out(rig: Orders, order: SimCommand) -> None:
    """Execute an order; raises ValueError if it is not possible on this rig."""
    value = order.value
    match order.target, order.what:
        case "part", "remove":
            rig.remove_part()
        case "part", "place":
            rig.place_part(value)
        case "part", "slip":
            rig.slip_part(value or 0.0)
        case "part", _:
            rig.lose_part()
        case "weight", _:
            rig.hang(value or 0.0)
        case _, "stiffen":
            rig.scale_stiffness(1.0 if value is None else value)
        case _:
            rig.scale_hysteresis(1.0 if value is None else value)
