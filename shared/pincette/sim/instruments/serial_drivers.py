"""Simulated instruments on serial lines, by the drivers that use them."""

from pincette.config import ConfigError
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.fitting import Fitted, OutputTraits, Setting, SimulatedDriver
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import TERMINATOR

SENSOR, OUTPUT = frozenset({"sensor"}), frozenset({"output"})


def _keyence(setting: Setting, _tables: frozenset[str]) -> dict[str, Fitted]:
    sensor = setting.rig_file.sensor
    unit = "mm" if sensor.options.get("unit") == "mm" else "um"
    laser = SimulatedKeyence(setting.measure_um, unit, set_averaging=setting.rig.set_averaging)
    line = setting.line("sensor", laser)
    return {"sensor": Fitted(line, sensor.url, TERMINATOR, setting.baud(sensor))}


def _i7024(setting: Setting, _tables: frozenset[str]) -> dict[str, Fitted]:
    output, baud = setting.rig_file.output, setting.baud(setting.rig_file.output)
    address = int(output.options.get("address", 1))
    channel = int(output.options.get("channel", 0))
    checksum = bool(output.options.get("checksum", False))
    for there in setting.beside.values():
        if there.url == output.url:
            module = there.module
            if not isinstance(module, SimulatedI7024) or module.address != address:
                raise ConfigError(
                    f"second.output.url = {output.url!r}: another instrument is simulated "
                    "there, and a line of several modules cannot be simulated; give the "
                    "address of [output], or another url"
                )
            module.connect(channel, setting.put_out)
            line = setting.line("output", there.instrument)
            return {"output": Fitted(line, output.url, TERMINATOR, baud, module=module)}
    module = SimulatedI7024(
        setting.put_out, setting.rig.now_s, address=address, channel=channel, checksum=checksum
    )
    line = setting.line("output", module)
    return {"output": Fitted(line, output.url, TERMINATOR, baud, module=module)}


def _dc205(setting: Setting, _tables: frozenset[str]) -> dict[str, Fitted]:
    output = setting.rig_file.output
    line = setting.line("output", SimulatedDC205(setting.put_out))
    return {"output": Fitted(line, output.url, dc205.TERMINATOR, setting.baud(output))}


KEYENCE_LKG = SimulatedDriver(SENSOR, _keyence)
ICPDAS_I7024 = SimulatedDriver(OUTPUT, _i7024, OutputTraits(20.0 / 2**14, 0.0033))
"""14 bit over ±10 V, and a lag of 10 ms to 5 %, from the manual."""
SRS_DC205 = SimulatedDriver(OUTPUT, _dc205, OutputTraits(1e-6, 0.001))
"""Step of 1 µV from the manual; the lag is assumed."""
