"""Simulated NI-DAQmx devices, as the tables of a rig file connect them."""

from collections.abc import Callable
from urllib.parse import urlsplit

from pincette.config import ConfigError, RigFile
from pincette.sim.instruments.daq import SimulatedDaq
from pincette.sim.instruments.daq_task import Fed, Terminals
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.rig.streamed_wave import StreamingRig

DRIVER = "nidaqmx"


class ScriptedTerminals:
    """A rig whose readings and single voltages pass through a script."""

    def __init__(
        self,
        rig: StreamingRig,
        measure_um: Callable[[], float],
        put_out: Callable[[float], None],
    ) -> None:
        self._rig = rig
        self.measure_um = measure_um
        self.put_out = put_out
        self.put_out_wave = rig.put_out_wave
        self.extend_wave = rig.extend_wave
        self.go_on = rig.go_on
        self.begin_capture = rig.begin_capture
        self.drain = rig.drain
        self.end_capture = rig.end_capture

    @property
    def wave_over(self) -> bool:
        """Whether the wave has come to its last voltage."""
        return self._rig.wave_over


class Sides:
    """One device behind one port: calls for its input and for its output go each their own way."""

    def __init__(self, daq: SimulatedDaq, sensor: Instrument, output: Instrument) -> None:
        self._daq = daq
        self._ways = {"sensor": sensor, "output": output}

    def idle(self) -> None:
        """Do nothing: these instruments act only when told to."""

    def answer(self, line: bytes) -> bytes | None:
        """Carry out one call; silence where there is none."""
        return self._ways.get(self._daq.side(line), self._daq).answer(line)


def server_of(url: str) -> str:
    """Where the calls of a url go: host and port, or this machine."""
    return urlsplit(url).netloc


def devices(rig_file: RigFile, fed: Fed) -> dict[str, SimulatedDaq]:
    """Devices of the tables ``sensor`` and ``output`` that name this driver.

    They are one where both are reached at one server.

    Raises
    ------
    ConfigError
        Where the rig file does not say how a device is connected.
    """
    sensor, output = rig_file.sensor, rig_file.output
    wanted = {
        table: settings
        for table, settings in (("sensor", sensor), ("output", output))
        if settings.driver == DRIVER
    }
    connected: dict[str, Terminals] = {}
    scale = 1.0
    if "sensor" in wanted:
        scale = float(sensor.options.get("um_per_V", 0.0))
        if scale == 0.0:
            raise ConfigError("sensor.options.um_per_V is missing: the monitor output's scale")
        connected["sensor"] = Terminals(
            um_per_V=scale,
            offset_um=float(sensor.options.get("offset_um", 0.0)),
            position=_channel(sensor.url, sensor.options.get("channel")),
            drives=_names(sensor.options.get("drive_channel")),
        )
    if "output" in wanted:
        connected["output"] = Terminals(
            output=_channel(output.url, output.options.get("channel")),
            drives=_names(output.options.get("read_channel")),
        )
    if len(wanted) == 2 and server_of(sensor.url) == server_of(output.url):
        ai, ao = connected["sensor"], connected["output"]
        both = Terminals(
            ai.um_per_V, ai.offset_um, ai.position, (*ai.drives, *ao.drives), ao.output
        )
        daq = SimulatedDaq(fed, both, lockstep=rig_file.lockstep)
        return {"sensor": daq, "output": daq}
    return {
        table: SimulatedDaq(fed, terminals, lockstep=rig_file.lockstep)
        for table, terminals in connected.items()
    }


def _channel(url: str, channel: object) -> str:
    """Physical channel, as the driver takes it from its table."""
    if url.startswith("ni:"):
        return url.removeprefix("ni:")
    return urlsplit(url).path.strip("/") or str(channel or "")


def _names(channel: object) -> tuple[str, ...]:
    return (str(channel),) if channel else ()
