"""The bench: the plant with both simulated instruments, as a rig file describes them."""

from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pincette.config import ConfigError, Output, RigFile, Sensor, Simulation
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette.sim.instruments.traits import resolved
from pincette.sim.rig.rig import SimulatedRig, TruthSink
from pincette.sim.rig.streamed_wave import StreamingRig
from pincette.sim.script.script import Script
from pincette.sim.wires.wire import serve

KEYENCE, ICPDAS, SRS, NIDAQMX = "keyence_lkg", "icpdas_i7024", "srs_dc205", "nidaqmx"
SIMULATED = {"sensor": (KEYENCE, NIDAQMX), "output": (ICPDAS, SRS, NIDAQMX)}
BAUD = 115200
"""As the drivers' own default."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """An instrument at the end of its line."""

    instrument: Instrument
    url: str
    """Of the driver."""
    terminator: bytes | None
    """Ends each line; None where the instrument is called, and answers are taken whole."""
    baud: int | None = None
    """Of a serial line in real time; None where bytes take no time."""
    server: Instrument | None = None
    """What answers at the port that this instrument shares with the other one."""


@dataclass(frozen=True, slots=True)
class Bench:
    """A simulated rig and its two instruments."""

    rig: StreamingRig
    fitted: dict[str, Fitted]
    """By table of the rig file: ``sensor`` and ``output``."""

    @property
    def sensor(self) -> Instrument:
        """The position sensor."""
        return self.fitted["sensor"].instrument

    @property
    def output(self) -> Instrument:
        """The voltage output."""
        return self.fitted["output"].instrument

    @contextmanager
    def offer(self) -> Generator[dict[str, str]]:
        """Offer both instruments at their urls; yields where each one is.

        Raises
        ------
        WireError
            Where a port is taken, or is none.
        """
        with ExitStack() as ports:
            at: dict[str, str] = {}
            servers: dict[int, str] = {}
            for table, fitted in self.fitted.items():
                if fitted.server is None:
                    wire = serve(
                        fitted.url,
                        fitted.instrument,
                        fitted.baud,
                        fitted.terminator or b"",
                        afterwards=self.rig.pass_time,
                    )
                    at[table] = ports.enter_context(wire).url
                    continue
                if id(fitted.server) not in servers:
                    from pincette.sim.wires.daq_server import DaqServer

                    front = ports.enter_context(DaqServer(fitted.url, fitted.server))
                    servers[id(fitted.server)] = front.url
                at[table] = servers[id(fitted.server)]
            yield at


def open_bench(
    rig_file: RigFile,
    clock: Callable[[], float],
    truth: TruthSink | None = None,
    script: Script | None = None,
) -> Bench:
    """Set up the instruments that the rig file's drivers expect to meet.

    Parameters
    ----------
    script
        Stands between the rig, its instruments and their lines.

    Raises
    ------
    ConfigError
        Where the rig file has no [simulation], names a driver whose instrument is not simulated,
        or describes no possible plant.
    """
    simulation = rig_file.simulation
    if simulation is None:
        raise ConfigError("[simulation] is missing: this rig file describes a real rig")
    drivers = {"sensor": rig_file.sensor.driver, "output": rig_file.output.driver}
    for table, driver in drivers.items():
        if driver not in SIMULATED[table]:
            known = " and ".join(map(repr, SIMULATED[table]))
            raise ConfigError(f"{table}.driver = {driver!r}: only {known} are simulated")
    plant = resolved(simulation, rig_file.output.driver)
    try:
        rig = StreamingRig(plant, rig_file.rig.period_s, rig_file.lockstep, clock, truth)
    except ValueError as error:
        raise ConfigError(f"[simulation] is no possible rig: {error}") from error
    if script is not None:
        script.operate(rig)
    return Bench(rig, _fitted(rig_file, simulation, rig, script))


def _fitted(
    rig_file: RigFile, simulation: Simulation, rig: StreamingRig, script: Script | None
) -> dict[str, Fitted]:
    measure_um, put_out = rig.measure_um, rig.put_out
    if script is not None:
        measure_um, put_out = script.measure(measure_um), script.put_out(put_out)

    def lined(table: str, instrument: Instrument) -> Instrument:
        return instrument if script is None else script.link(table, instrument)

    def baud(settings: Sensor | Output) -> int | None:
        if rig_file.lockstep:
            return None
        own = "baud" in simulation.model_fields_set
        return simulation.baud if own else int(settings.options.get("baud", BAUD))

    fitted: dict[str, Fitted] = {}
    sensor, output = rig_file.sensor, rig_file.output
    if sensor.driver == KEYENCE:
        unit = "mm" if sensor.options.get("unit") == "mm" else "um"
        laser = SimulatedKeyence(measure_um, unit, set_averaging=rig.set_averaging)
        fitted["sensor"] = Fitted(lined("sensor", laser), sensor.url, TERMINATOR, baud(sensor))
    if output.driver == SRS:
        source = lined("output", SimulatedDC205(put_out))
        fitted["output"] = Fitted(source, output.url, dc205.TERMINATOR, baud(output))
    elif output.driver == ICPDAS:
        module = lined("output", _module(output, rig, put_out))
        fitted["output"] = Fitted(module, output.url, TERMINATOR, baud(output))
    if len(fitted) < len(SIMULATED):
        fitted |= _called(rig_file, rig, measure_um, put_out, lined)
    return fitted


def _module(output: Output, rig: SimulatedRig, put_out: Callable[[float], None]) -> SimulatedI7024:
    wanted = output.options
    return SimulatedI7024(
        put_out,
        rig.now_s,
        address=int(wanted.get("address", 1)),
        channel=int(wanted.get("channel", 0)),
        checksum=bool(wanted.get("checksum", False)),
    )


def _called(
    rig_file: RigFile,
    rig: StreamingRig,
    measure_um: Callable[[], float],
    put_out: Callable[[float], None],
    lined: Callable[[str, Instrument], Instrument],
) -> dict[str, Fitted]:
    """The instruments that are called by gRPC, for which the package nidaqmx is needed."""
    try:
        from pincette.sim.instruments.daq_fitted import ScriptedTerminals, Sides, devices
    except ImportError as error:
        raise ConfigError(
            f"driver = {NIDAQMX!r}: simulating it needs the package nidaqmx ({error}); install "
            "pincette with its extra: pip install 'pincette[nidaqmx]'"
        ) from error
    made = devices(rig_file, ScriptedTerminals(rig, measure_um, put_out))
    lines = {table: lined(table, daq) for table, daq in made.items()}
    urls = {"sensor": rig_file.sensor.url, "output": rig_file.output.url}
    fronts = {
        id(daq): Sides(daq, *(lines.get(table, daq) for table in ("sensor", "output")))
        for daq in made.values()
    }
    return {
        table: Fitted(lines[table], urls[table], None, server=fronts[id(daq)])
        for table, daq in made.items()
    }
