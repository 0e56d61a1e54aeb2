"""The rig program offers the output that the rig file's driver expects, in its own line ends."""

import threading
from pathlib import Path
from typing import cast

import pytest

from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import Output
from pincette.instruments.keyence_lkg import open_sensor
from pincette.instruments.srs_dc205 import open_output
from pincette.messages import Message, Truth
from pincette.runtime.context import Context
from pincette_rig import PROGRAM
from tests.support.rigs import demo_rig


class Bus:
    """Keeps what is published."""

    def __init__(self) -> None:
        self.told: list[Message] = []

    def publish(self, message: Message) -> None:
        self.told.append(message)

    def serve(self, *_question: object) -> None:
        pass

    def announce(self, _name: str) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.mark.parametrize("pace", ["lockstep", "real"])
def test_each_write_over_the_line_is_one_of_the_rig(tmp_path: Path, pace: str) -> None:
    demo, bus, ready = demo_rig(time=pace), Bus(), threading.Event()
    output = Output(driver="srs_dc205", url=str(tmp_path / "output"), timeout_s=0.5)
    rig = demo.model_copy(update={"output": output})
    context = Context(
        rig, tmp_path, lambda: cast(ZenohBus, bus), lambda _line: ready.set(), threading.Event()
    )
    thread = threading.Thread(target=PROGRAM, args=(context,))
    thread.start()
    try:
        assert ready.wait(timeout=5.0)
        sensor, source = open_sensor(rig.sensor), open_output(rig.output)
        for voltage_V in (1.0, 1.0, 0.5):
            source.write_V(voltage_V)
            sensor.read_um()
        assert source.read_V() == 0.5
        sensor.close()
        source.close()
    finally:
        context.stop.set()
        thread.join(timeout=5.0)
    assert not thread.is_alive()
    told = [message for message in bus.told if isinstance(message, Truth)]
    assert [truth.seq for truth in told] == [0, 1, 2]
    assert [truth.voltage_V for truth in told] == pytest.approx([1.0, 1.0, 0.5], abs=0.0007)
