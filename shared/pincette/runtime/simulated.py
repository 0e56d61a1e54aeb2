"""The instruments of a rig, simulated within this process."""

from collections.abc import Callable

from pincette import plugins
from pincette.config import RigFile
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import Link
from pincette.messages import Truth
from pincette.runtime.instrument import Device
from pincette.sim.bench import Bench, Fitted, open_bench
from pincette.sim.script.script import Script, script_of


def simulated_bench(rig: RigFile, publish: Callable[[Truth], None]) -> Bench:
    """Set up the simulated rig of this process, with its script where it has one.

    The time of the bench is the lockstep's own, so its clock is never asked.
    """
    return open_bench(
        rig,
        lambda: 0.0,
        lambda seq, x_um, F_mN, u_V: publish(Truth(seq, x_um, F_mN, u_V)),
        scripted(rig),
    )


def scripted(rig: RigFile) -> Script | None:
    """Script of a rig file; None where it has none and takes no orders."""
    simulation = rig.simulation
    wanted = simulation is not None and (simulation.scripts or simulation.script)
    return script_of(rig) if wanted else None


def devices_on(bench: Bench, rig: RigFile) -> dict[str, Device]:
    """Both instruments, as their drivers meet them: the real bytes, over memory."""
    sensor = plugins.load(plugins.POSITION_SENSORS, rig.sensor.driver)
    output = plugins.load(plugins.VOLTAGE_OUTPUTS, rig.output.driver)
    return {
        "sensor": sensor(rig.sensor, _link(bench.fitted["sensor"])),
        "actuator": output(rig.output, _link(bench.fitted["output"])),
    }


def simulated_devices(rig: RigFile, publish: Callable[[Truth], None]) -> dict[str, Device]:
    """Both instruments of a simulated rig in this process, by the name of their service."""
    return devices_on(simulated_bench(rig, publish), rig)


def _link(fitted: Fitted) -> Link:
    """A line to an instrument in this process."""
    if fitted.terminator is not None:
        return MemoryLink(fitted.instrument.answer, fitted.terminator)
    from pincette.instruments.line.rpc_link import RpcMemoryLink

    return RpcMemoryLink(fitted.instrument.answer)
