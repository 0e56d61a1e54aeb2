"""The simulated instruments of a rig within this process; commands to them arrive over the bus."""

from collections.abc import Callable
from typing import cast

from pincette.bus.protocol import Bus
from pincette.config import RigFile
from pincette.core import plugins
from pincette.core.messages import Ack, GroundTruth, Message, SimCommand
from pincette.core.topics import SIM_COMMAND, Request
from pincette.engine.instrument import Device, of_arms
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import Link, PositionSensor, VoltageOutput
from pincette.sim.bench import PREFIXES, Bench, Fitted, open_bench
from pincette.sim.script.script import Script, script_of


def simulated_bench(rig: RigFile, publish: Callable[[GroundTruth], None]) -> Bench:
    """Set up the simulated rig of this process, in lockstep, with its script if any."""

    simulation = rig.simulation
    scripted = simulation is not None and (simulation.scripts or simulation.script)
    return open_bench(
        rig,
        lambda: 0.0,
        publish,
        script_of(rig) if scripted else None,
    )


def devices_on(bench: Bench, rig: RigFile) -> dict[str, Device]:
    """Return all instruments behind their drivers: the real bytes, over memory."""
    each: dict[str, list[PositionSensor | VoltageOutput]] = {"sensor": [], "actuator": []}
    for prefix, arm in zip(PREFIXES, rig.arms, strict=False):
        sensor = plugins.load(plugins.POSITION_SENSORS, arm.sensor.driver)
        output = plugins.load(plugins.VOLTAGE_OUTPUTS, arm.output.driver)
        each["sensor"].append(sensor(arm.sensor, _link(bench.fitted[f"{prefix}sensor"])))
        each["actuator"].append(output(arm.output, _link(bench.fitted[f"{prefix}output"])))
    return {name: of_arms(found) for name, found in each.items()}


def simulated_devices(rig: RigFile, publish: Callable[[GroundTruth], None]) -> dict[str, Device]:
    """Return all instruments of a simulated rig in this process, by the name of their service."""
    return devices_on(simulated_bench(rig, publish), rig)


def _link(fitted: Fitted) -> Link:
    return MemoryLink(fitted.instrument.answer, fitted.terminator)


def serve_sim_commands(bus: Bus, script: Script) -> None:
    """Pass each command to the script; if the script objects, refuse the request with its text."""

    def answer(_request: Request, message: Message, reply: Callable[[Message | str], None]) -> None:
        reply(script.order(cast(SimCommand, message)) or Ack(0))

    bus.serve(SIM_COMMAND, answer)
