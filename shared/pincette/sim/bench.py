"""The bench: the plant with both simulated instruments, as a rig file describes them."""

from collections.abc import Callable
from dataclasses import dataclass

from pincette.config import ConfigError, RigFile
from pincette.sim.dcon import SimulatedI7024
from pincette.sim.keyence import SimulatedKeyence
from pincette.sim.rig import SimulatedRig, TruthSink

SENSOR = "keyence_lkg"
OUTPUT = "icpdas_i7024"


@dataclass(frozen=True, slots=True)
class Bench:
    """A simulated rig and its two instruments."""

    rig: SimulatedRig
    sensor: SimulatedKeyence
    output: SimulatedI7024


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
    for table, driver, simulated in (
        ("sensor", rig_file.sensor.driver, SENSOR),
        ("output", rig_file.output.driver, OUTPUT),
    ):
        if driver != simulated:
            raise ConfigError(f"{table}.driver = {driver!r}: only {simulated!r} is simulated")
    wanted = rig_file.output.options
    try:
        rig = SimulatedRig(simulation, rig_file.rig.period_s, rig_file.lockstep, clock, truth)
    except ValueError as error:
        raise ConfigError(f"[simulation] is no possible rig: {error}") from error
    output = SimulatedI7024(
        rig.put_out,
        rig.now_s,
        address=int(wanted.get("address", 1)),
        channel=int(wanted.get("channel", 0)),
        checksum=bool(wanted.get("checksum", False)),
    )
    unit = "mm" if rig_file.sensor.options.get("unit") == "mm" else "um"
    return Bench(rig, SimulatedKeyence(rig.measure_um, unit), output)
