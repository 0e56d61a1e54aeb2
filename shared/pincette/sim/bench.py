"""The bench: the plant with both simulated instruments, as a rig file describes them."""

from collections.abc import Callable
from dataclasses import dataclass

from pincette.config import ConfigError, Output, RigFile
from pincette.sim import dc205
from pincette.sim.dc205 import SimulatedDC205
from pincette.sim.dcon import SimulatedI7024
from pincette.sim.instrument import TERMINATOR, Instrument
from pincette.sim.keyence import SimulatedKeyence
from pincette.sim.rig import SimulatedRig, TruthSink

SENSOR = "keyence_lkg"
ICPDAS, SRS = "icpdas_i7024", "srs_dc205"
SIMULATED = {"sensor": (SENSOR,), "output": (ICPDAS, SRS)}


@dataclass(frozen=True, slots=True)
class Bench:
    """A simulated rig and its two instruments."""

    rig: SimulatedRig
    sensor: SimulatedKeyence
    output: Instrument
    output_terminator: bytes
    """Ends each line of the output; those of the sensor end as the wire's do by default."""


def open_bench(
    rig_file: RigFile, clock: Callable[[], float], truth: TruthSink | None = None
) -> Bench:
    """Set up the instruments that the rig file's drivers expect to meet.

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
            verb = "is" if len(SIMULATED[table]) == 1 else "are"
            raise ConfigError(f"{table}.driver = {driver!r}: only {known} {verb} simulated")
    try:
        rig = SimulatedRig(simulation, rig_file.rig.period_s, rig_file.lockstep, clock, truth)
    except ValueError as error:
        raise ConfigError(f"[simulation] is no possible rig: {error}") from error
    unit = "mm" if rig_file.sensor.options.get("unit") == "mm" else "um"
    output, terminator = _output(rig_file.output, rig)
    return Bench(rig, SimulatedKeyence(rig.measure_um, unit), output, terminator)


def _output(output: Output, rig: SimulatedRig) -> tuple[Instrument, bytes]:
    """The voltage output that the driver expects, and what ends its lines."""
    if output.driver == SRS:
        return SimulatedDC205(rig.put_out), dc205.TERMINATOR
    wanted = output.options
    module = SimulatedI7024(
        rig.put_out,
        rig.now_s,
        address=int(wanted.get("address", 1)),
        channel=int(wanted.get("channel", 0)),
        checksum=bool(wanted.get("checksum", False)),
    )
    return module, TERMINATOR
