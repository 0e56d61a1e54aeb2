"""The dialogues of tests/data/dialogues: recorded exchanges of each driver with its simulated
instrument.

``python -m tests.support.dialogues`` records them again.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from pincette.config import Output, Sensor
from pincette.instruments import icpdas_i7024, keyence_lkg, srs_dc205
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.line.recording import Recorder, RecordingLink
from pincette.instruments.protocols import InstrumentError, Link
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR, Instrument

FOLDER = Path(__file__).parents[1] / "data" / "dialogues"
TICK_S = 0.001

Said = float | str | None
"""Outcome of a call: a number, nothing, or the cause of its error."""


@dataclass
class World:
    """Surroundings of the instruments; they have no effect in a replay."""

    x_um: float | None = 0.0
    now_s: float = 0.0
    plugged: bool = True
    voltages_V: list[float] = field(default_factory=list[float])
    instrument: Instrument | None = None

    def answer(self, line: bytes) -> bytes | None:
        """Return the reply over the line."""
        return self.instrument.answer(line) if self.plugged and self.instrument else None


@dataclass(frozen=True)
class Dialogue:
    """An instrument, and the calls of its driver."""

    instrument: Callable[[World], Instrument]
    perform: Callable[[World, str, Link | None], Iterator[Said]]
    terminator: bytes = TERMINATOR


def attempt(act: Callable[[], float | None]) -> Said:
    """Return the result of a call, or the cause of its error."""
    try:
        return act()
    except InstrumentError as error:
        return error.code


def read_positions(world: World, url: str, link: Link | None) -> Iterator[Said]:
    """Read positions within and beyond the range, no position, and over an unplugged line."""
    settings = Sensor(
        driver="keyence_lkg", url=url, minimum_um=-9999.0, maximum_um=9999.0, noise_um=0.03
    )
    sensor = keyence_lkg.open_sensor(settings, link)
    for x_um in (0.0, 30.02, -12.57, 9999.99, 10_000.0, -10_000.0, None):
        world.x_um = x_um
        yield attempt(sensor.read_um)
    world.x_um, world.plugged = 1.0, False
    yield attempt(sensor.read_um)
    world.plugged = True
    yield attempt(sensor.read_um)
    sensor.close()


def watch_over_voltages(world: World, url: str, link: Link | None) -> Iterator[Said]:
    """Write voltages and heartbeats, unplug the line, trip the watchdog and clear it."""
    settings = Output(driver="icpdas_i7024", url=url, options={"address": 0x1A, "checksum": True})
    output = icpdas_i7024.open_output(settings, link)
    for voltage_V in (0.0, 1.2345, -10.0, 10.001):
        yield attempt(lambda voltage_V=voltage_V: output.write_V(voltage_V))
        yield attempt(output.read_V)
    output.keep_alive()
    world.plugged = False
    yield attempt(lambda: output.write_V(1.0))
    world.plugged, world.now_s = True, 0.4
    yield attempt(lambda: output.write_V(1.0))
    world.now_s = 1.0
    yield attempt(lambda: output.write_V(1.1))
    yield attempt(output.read_V)
    yield attempt(output.clear_trip)
    yield attempt(lambda: output.write_V(0.5))
    output.close()


def put_out_voltages(world: World, url: str, link: Link | None) -> Iterator[Said]:
    """Write voltages, unplug the line, overload the output, and switch it off by hand."""
    output = srs_dc205.open_output(Output(driver="srs_dc205", url=url), link)
    yield attempt(output.read_V)
    for voltage_V in (1.5, -0.0004, 10.0, 10.1):
        yield attempt(lambda voltage_V=voltage_V: output.write_V(voltage_V))
        yield attempt(output.read_V)
    world.plugged = False
    yield attempt(lambda: output.write_V(1.0))
    world.plugged = True
    if isinstance(world.instrument, SimulatedDC205):
        world.instrument.overloaded = True
    yield attempt(output.read_V)
    if world.instrument is not None:
        world.instrument.answer(b"SOUT OFF")
    yield attempt(lambda: output.write_V(1.0))
    output.close()


DIALOGUES = {
    "keyence_lkg": Dialogue(lambda world: SimulatedKeyence(lambda: world.x_um), read_positions),
    "icpdas_i7024": Dialogue(
        lambda world: SimulatedI7024(
            world.voltages_V.append, lambda: world.now_s, address=0x1A, checksum=True
        ),
        watch_over_voltages,
    ),
    "srs_dc205": Dialogue(
        lambda world: SimulatedDC205(world.voltages_V.append),
        put_out_voltages,
        dc205.TERMINATOR,
    ),
}


def record(name: str, path: Path) -> list[Said]:
    """Play a dialogue with the simulated instrument and record it; returns the exchanges."""
    dialogue, world, times = DIALOGUES[name], World(), count()
    world.instrument = dialogue.instrument(world)
    recorder = Recorder(path, f"memory:{name}", dialogue.terminator, lambda: TICK_S * next(times))
    link = RecordingLink(MemoryLink(world.answer, dialogue.terminator), recorder)
    return list(dialogue.perform(world, "memory:", link))


def replay(name: str, path: Path) -> list[Said]:
    """Play a dialogue with its recording; returns the exchanges."""
    return list(DIALOGUES[name].perform(World(), f"replay:{path}", None))


def main() -> None:
    """Record every dialogue again."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in DIALOGUES:
        record(name, FOLDER / f"{name}.txt")
        sys.stdout.write(f"{FOLDER / name}.txt\n")


if __name__ == "__main__":
    main()
