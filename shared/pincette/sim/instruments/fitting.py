"""How a simulated instrument is fitted to a rig; one is registered under its driver's name."""

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
"""Default baud rate, that of the drivers."""


class OutputTraits(NamedTuple):
    """Properties of a voltage output: its step and first-order lag."""

    step_V: float
    lag_s: float


class Served(Protocol):
    """A server that listens."""

    @property
    def url(self) -> str:
        """What a driver opens to get here."""
        ...


OpenServer = Callable[[str, Instrument], AbstractContextManager[Served]]


@dataclass(frozen=True, slots=True)
class Fitted:
    """An instrument at the end of its line."""

    instrument: Instrument
    url: str
    """Address for the driver."""
    terminator: bytes | None
    """Ends each line; None where an answer is taken whole."""
    baud: int | None = None
    """Of a serial line in real time; None where bytes take no time."""
    server: Instrument | None = None
    """What answers at a port that both instruments may share, and"""
    open_server: OpenServer | None = None
    """what serves it at a url; None: a serial line or a socket."""
    module: Instrument | None = None
    """``instrument`` without what a script does to its line, where another arm may share it."""


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
    """Puts what a script does to a line before the instrument of a table."""
    beside: Mapping[str, Fitted]
    """Instruments of the first arm while the second one's are made; empty for the first."""
    put_out_wave: PutOutWave | None = None
    """Puts out a wave through a script; None: the rig does."""

    def baud(self, settings: Sensor | Output) -> int | None:
        """Of a serial line; None in lockstep, where bytes take no time."""
        if self.rig_file.lockstep:
            return None
        own = "baud" in self.simulation.model_fields_set
        return self.simulation.baud if own else int(settings.options.get("baud", BAUD))


@dataclass(frozen=True, slots=True)
class SimulatedDriver:
    """The simulated instruments that a driver meets."""

    tables: frozenset[str]
    """Tables of the rig file in which the driver can stand."""
    fit: Callable[[Setting, frozenset[str]], dict[str, Fitted]]
    """Makes the instruments of the tables that name the driver.

    Raises ConfigError where the rig file does not say how one is connected."""
    traits: OutputTraits | None = None
    """Of its voltage output; None: to be given in [simulation]."""


@cache
def simulated_driver(name: str) -> SimulatedDriver | None:
    """Return what is registered for a driver; None where its instrument is not simulated."""
    if name not in plugins.names(plugins.SIMULATED_INSTRUMENTS):
        return None
    driver: SimulatedDriver = plugins.load(plugins.SIMULATED_INSTRUMENTS, name)
    return driver


def simulated_in(table: str) -> list[str]:
    """Return drivers of a table whose instruments are simulated."""
    names = plugins.names(plugins.SIMULATED_INSTRUMENTS)
    return [name for name in names if (one := simulated_driver(name)) and table in one.tables]


def resolved(simulation: Simulation, output_driver: str) -> Simulation:
    """The simulation with step and lag of the output, by default its driver's; or ConfigError."""
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
