"""Registration and set-up of a simulated instrument, under the name of its driver."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

from pincette.config import ConfigError, Output, RigFile, Sensor, Simulation
from pincette.core import plugins
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.rig.pair_rig import ArmOfPair
from pincette.sim.rig.rig import SimulatedRig
from pincette.sim.rig.wave import PutOutWave

TABLES = ("sensor", "output")
"""Tables of the rig file that name a driver."""
BAUD = 115200
"""Default baud rate of the drivers."""


class OutputTraits(NamedTuple):
    """Properties of a voltage output: its step and first-order lag."""

    step_V: float
    lag_s: float


class Served(Protocol):
    """Server through which a driver can open an instrument."""

    @property
    def url(self) -> str:
        """Return the url for a driver."""
        ...


OpenServer = Callable[[str, Instrument], AbstractContextManager[Served]]


@dataclass(frozen=True, slots=True)
class Fitted:
    """Instrument with the properties of its line."""

    instrument: Instrument
    url: str
    """Address for the driver."""
    terminator: bytes | None
    """End of each line; None if an answer is sent as a whole."""
    baud: int | None = None
    """Baud rate of a serial line in real time; None if bytes take no time."""
    server: Instrument | None = None
    """Instrument that answers at a port that both arms' instruments may share; see ``open_server``.
    """
    open_server: OpenServer | None = None
    """Function that opens the server of ``server`` at a url; None for a serial line or a socket."""
    module: Instrument | None = None
    """The ``instrument`` without the script's effect on its line, to be shared with another arm."""


@dataclass(frozen=True, slots=True)
class Setting:
    """Environment of a simulated instrument."""

    rig_file: RigFile
    """Rig file of one arm; see ``RigFile.arms``."""
    simulation: Simulation
    rig: SimulatedRig | ArmOfPair
    measure_um: Callable[[], float]
    put_out: Callable[[float], None]
    line: Callable[[str, Instrument], Instrument]
    """Function that adds the script's effects on the line to the instrument of a table."""
    beside: Mapping[str, Fitted]
    """Instruments of the first arm, while those of the second arm are set up; empty for the first
    arm."""
    put_out_wave: PutOutWave | None = None
    """Function that outputs a waveform with the script's effects; None if the rig does so
    itself."""

    def baud(self, settings: Sensor | Output) -> int | None:
        """Return the baud rate of a serial line; None in lockstep, where bytes take no time."""
        if self.rig_file.lockstep:
            return None
        own = "baud" in self.simulation.model_fields_set
        return self.simulation.baud if own else int(settings.options.get("baud", BAUD))


@dataclass(frozen=True, slots=True)
class SimulatedDriver:
    """Simulated instruments for one driver."""

    tables: frozenset[str]
    """Tables of the rig file that can name the driver."""
    fit: Callable[[Setting, frozenset[str]], dict[str, Fitted]]
    """Function that sets up the instruments of the tables that name the driver.

    It raises ConfigError if the rig file does not define how an instrument is connected.
    """
    traits: OutputTraits | None = None
    """Properties of the driver's voltage output; None if [simulation] must define them."""


@cache
def simulated_driver(name: str) -> SimulatedDriver | None:
    """Return the simulation of a driver's instrument; None if the instrument is not simulated."""
    if name not in plugins.names(plugins.SIMULATED_INSTRUMENTS):
        return None
    driver: SimulatedDriver = plugins.load(plugins.SIMULATED_INSTRUMENTS, name)
    return driver


def simulated_in(table: str) -> list[str]:
    """Return the drivers of a table whose instruments are simulated."""
    names = plugins.names(plugins.SIMULATED_INSTRUMENTS)
    return [name for name in names if (one := simulated_driver(name)) and table in one.tables]


def resolved(simulation: Simulation, output_driver: str) -> Simulation:
    """Return the simulation with step and lag of the output; the defaults are its driver's.

    Raises ConfigError if neither defines them.
    """
    if simulation.output_step_V is not None and simulation.output_lag_s is not None:
        return simulation
    driver = simulated_driver(output_driver)
    if driver is None or driver.traits is None:
        raise ConfigError(
            f"output.driver = {output_driver!r}: step and lag of its instrument are not known; "
            "give output_step_V and output_lag_s in [simulation]"
        )
    wanted = simulation.output_step_V, simulation.output_lag_s
    step_V, lag_s = (
        known if value is None else value
        for value, known in zip(wanted, driver.traits, strict=True)
    )
    return simulation.model_copy(update={"output_step_V": step_V, "output_lag_s": lag_s})
