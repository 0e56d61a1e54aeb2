"""Simulated NI-DAQmx devices, connected by the tables of a rig file."""

from urllib.parse import urlsplit

from pincette.config import ConfigError, RigFile
from pincette.sim.instruments.fitting import Fitted, Setting
from pincette.sim.instruments.protocol import Instrument
from pincette_nidaqmx.simulated.daq import SimulatedDaq
from pincette_nidaqmx.simulated.daq_task import Terminals, WiredRig
from pincette_nidaqmx.simulated.server import DaqServer


class ScriptedTerminals:
    """Rig whose readings and single voltages a script of faults may change."""

    def __init__(self, setting: Setting) -> None:
        rig = self._rig = setting.rig
        self.measure_um = setting.measure_um
        self.put_out = setting.put_out
        self.put_out_wave = setting.put_out_wave or rig.put_out_wave
        self.extend_wave = rig.extend_wave
        self.go_on = rig.go_on
        self.begin_capture = rig.begin_capture
        self.drain = rig.drain
        self.end_capture = rig.end_capture

    @property
    def wave_over(self) -> bool:
        """Return whether the waveform has reached its last voltage."""
        return self._rig.wave_over


class Sides:
    """One device behind one port, with separate simulated lines for its input and its output."""

    def __init__(self, daq: SimulatedDaq, sensor: Instrument, output: Instrument) -> None:
        self._daq = daq
        self._ways = {"sensor": sensor, "output": output}

    def idle(self) -> None:
        """Do nothing: these instruments act only on commands."""

    def answer(self, line: bytes) -> bytes | None:
        """Execute one call; returns None if the request is not a call."""
        return self._ways.get(self._daq.side(line), self._daq).answer(line)


def fit(setting: Setting, tables: frozenset[str]) -> dict[str, Fitted]:
    """Connect the devices of some tables, each behind the server in its url."""
    made = devices(setting.rig_file, tables, ScriptedTerminals(setting))
    lines = {table: setting.line(table, daq) for table, daq in made.items()}
    servers = {
        id(daq): Sides(daq, *(lines.get(table, daq) for table in ("sensor", "output")))
        for daq in made.values()
    }
    urls = {"sensor": setting.rig_file.sensor.url, "output": setting.rig_file.output.url}
    return {
        table: Fitted(lines[table], urls[table], None, None, servers[id(daq)], DaqServer)
        for table, daq in made.items()
    }


def devices(rig_file: RigFile, tables: frozenset[str], rig: WiredRig) -> dict[str, SimulatedDaq]:
    """Return the devices of the tables that name this driver; raises ConfigError.

    Input and output belong to one device if both are reached at one server.
    """
    sensor, output = rig_file.sensor, rig_file.output
    connected: dict[str, Terminals] = {}
    scale = 1.0
    if "sensor" in tables:
        scale = float(sensor.options.get("um_per_V", 0.0))
        if scale == 0.0:
            raise ConfigError("sensor.options.um_per_V is missing: the monitor output's scale")
        connected["sensor"] = Terminals(
            um_per_V=scale,
            offset_um=float(sensor.options.get("offset_um", 0.0)),
            position=_channel(sensor.url, sensor.options.get("channel")),
            drives=_names(sensor.options.get("drive_channel")),
        )
    if "output" in tables:
        connected["output"] = Terminals(
            output=_channel(output.url, output.options.get("channel")),
            drives=_names(output.options.get("read_channel")),
        )
    if len(tables) == 2 and urlsplit(sensor.url).netloc == urlsplit(output.url).netloc:
        ai, ao = connected["sensor"], connected["output"]
        both = Terminals(
            ai.um_per_V, ai.offset_um, ai.position, (*ai.drives, *ao.drives), ao.output
        )
        daq = SimulatedDaq(rig, both, lockstep=rig_file.lockstep)
        return {"sensor": daq, "output": daq}
    return {
        table: SimulatedDaq(rig, terminals, lockstep=rig_file.lockstep)
        for table, terminals in connected.items()
    }


def _channel(url: str, channel: object) -> str:
    """Return the physical channel of a table, as the driver determines it."""
    if url.startswith("ni:"):
        return url.removeprefix("ni:")
    return urlsplit(url).path.strip("/") or str(channel or "")


def _names(channel: object) -> tuple[str, ...]:
    return (str(channel),) if channel else ()
