"""A device server that delays answers is distinguished from slow lines, instruments and socat."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing
from functools import partial
from pathlib import Path
from time import sleep

import pytest

from pincette.diagnostics.hops import DEFAULT_HELD_S, NEXT_HELD_S, hop_findings
from pincette.diagnostics.instruments import instruments
from pincette.instruments import keyence_lkg
from pincette.instruments.line.arrivals import Arrivals, Hop
from pincette.instruments.line.counts import LineCounts, counting
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.wires.wire import serve
from tests.contract.test_late_answers import sensor_settings
from tests.contract.test_measured_exchanges import bench
from tests.support.device_servers import DeviceServer, ser2net, socat

READINGS = 40
Start = Callable[..., AbstractContextManager[DeviceServer]]
LENGTHS = ((3, 9), (6, 15))
"""Sizes in bytes of requests and replies of the Keyence: measuring mode, one reading."""
OVERHEAD_S = 0.0003


def arrivals(baud: int, line_baud: int, held_s: float, *, in_pieces: bool) -> Arrivals:
    """Simulate exchanges over a line at ``line_baud`` for which the rig file states ``baud``."""
    found = Arrivals(baud)
    for _ in range(READINGS):
        for sent, received in LENGTHS:
            last_s = 10 * (sent + received) / line_baud + held_s + OVERHEAD_S
            pieces = received if in_pieces else 1
            arrived_s = [last_s - 10 * later / line_baud for later in reversed(range(pieces))]
            found.add(sent, received, 0.0, arrived_s)
    return found


@pytest.mark.parametrize("baud", [9600, 19200, 38400, 115200])
@pytest.mark.parametrize("held_s", [0.001, 0.003, 0.007, 0.020])
def test_answers_that_arrive_late_and_in_one_piece_are_attributed_to_the_device_server(
    baud: int, held_s: float
) -> None:
    hop = arrivals(baud, baud, held_s, in_pieces=False).hop()
    assert hop.held_s == pytest.approx(held_s, abs=2.0 * OVERHEAD_S)
    assert hop.line_baud == 0


@pytest.mark.parametrize("baud", [1200, 9600, 115200])
@pytest.mark.parametrize("thinks_s", [0.0, 0.003])
def test_an_answer_in_pieces_is_not_reported_as_delayed(baud: int, thinks_s: float) -> None:
    assert arrivals(baud, baud, thinks_s, in_pieces=True).hop() == Hop()


@pytest.mark.parametrize("line_baud", [9600, 19200, 57600])
def test_the_speed_of_a_line_that_is_slower_than_stated_is_estimated(line_baud: int) -> None:
    assert arrivals(115200, line_baud, 0.0, in_pieces=True).hop() == Hop(line_baud=line_baud)


def test_a_busy_machine_is_not_mistaken_for_a_server_that_holds_answers() -> None:
    found = arrivals(9600, 9600, 0.0, in_pieces=True)
    for _ in range(READINGS // 3):
        found.add(6, 15, 0.0, [0.025])
    assert found.hop() == Hop()


def test_too_few_or_too_short_answers_give_no_finding() -> None:
    found = Arrivals(115200)
    for _ in range(4):
        found.add(6, 15, 0.0, [0.005])
    for _ in range(READINGS):
        found.add(10, 2, 0.0, [0.004])
    assert found.hop() == Hop()


class Thinking:
    """An instrument that replies after a time of its own."""

    def __init__(self, instrument: Instrument, takes_s: float) -> None:
        self._instrument, self._takes_s = instrument, takes_s

    def idle(self) -> None:
        self._instrument.idle()

    def answer(self, line: bytes) -> bytes | None:
        sleep(self._takes_s)
        return self._instrument.answer(line)


def measured(
    folder: Path, server: str, options: str, baud: int, line_baud: int, thinks_s: float = 0.0
) -> Hop:
    """Measure the readings of a simulated laser behind a real server."""
    laser = Thinking(SimulatedKeyence(lambda: 12.34), thinks_s)
    start: Start = partial(ser2net, baud=line_baud) if server == "ser2net" else socat
    with ExitStack() as running:
        wire = running.enter_context(serve(str(folder / "tty"), laser, baud=line_baud))
        behind = running.enter_context(start(wire.url, folder, options=options))
        counts = LineCounts()
        settings = sensor_settings("keyence_lkg", 1.0)
        changes = {"url": behind.url, "options": {"baud": baud}}
        with counting(counts):
            sensor = keyence_lkg.open_sensor(settings.model_copy(update=changes))
        with closing(sensor):
            for _ in range(READINGS):
                sensor.read_um()
        return counts.arrivals[behind.url].hop()


def is_default(held_s: float) -> bool:
    return DEFAULT_HELD_S <= held_s < NEXT_HELD_S


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize("baud", [9600, 115200])
def test_the_default_of_ser2net_is_recognised_at_any_rate(baud: int, tmp_path: Path) -> None:
    hop = measured(tmp_path, "ser2net", "", baud, baud)
    assert is_default(hop.held_s), hop
    assert hop.line_baud == 0
    (found,) = hop_findings("sensor", hop.held_s, hop.line_baud)
    assert "chardelay: false" in found.remedy


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize(
    ("options", "held_s", "baud"),
    [
        ("chardelay-scale: 50", 6e-3, 9600),
        ("chardelay-min: 5000", 5e-3, 38400),
    ],
)
def test_another_delay_of_ser2net_is_measured(
    options: str, held_s: float, baud: int, tmp_path: Path
) -> None:
    hop = measured(tmp_path, "ser2net", options, baud, baud)
    assert held_s - 1e-4 <= hop.held_s < held_s + 1.5e-3, hop
    assert hop.line_baud == 0


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize(
    ("server", "options", "thinks_s", "baud"),
    [("ser2net", "chardelay: false", 0.003, 9600), ("socat", "", 0.0, 38400)],
)
def test_a_server_that_forwards_at_once_is_not_mistaken_for_one_that_holds_answers(
    server: str, options: str, thinks_s: float, baud: int, tmp_path: Path
) -> None:
    assert measured(tmp_path, server, options, baud, baud, thinks_s) == Hop()


@pytest.mark.usefixtures("stalls")
def test_a_line_that_is_slower_than_the_rig_file_states_is_named(tmp_path: Path) -> None:
    hop = measured(tmp_path, "ser2net", "chardelay: false", 115200, 9600)
    assert hop == Hop(line_baud=9600)


@pytest.mark.usefixtures("stalls")
def test_a_slow_line_behind_a_holding_server_is_not_reported_as_the_default(tmp_path: Path) -> None:
    hop = measured(tmp_path, "ser2net", "", 115200, 9600)
    assert hop.held_s > 0.015
    (found,) = hop_findings("sensor", hop.held_s, hop.line_baud)
    assert "options.baud" in found.remedy


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize("options", ["", "chardelay: false"])
def test_doctor_names_the_server_that_holds_answers(options: str, tmp_path: Path) -> None:
    with ExitStack() as running:
        rig = running.enter_context(bench(0.0, 0.0))
        laser = SimulatedKeyence(lambda: 12.34)
        wire = running.enter_context(serve(str(tmp_path / "tty"), laser, baud=115200))
        behind = running.enter_context(ser2net(wire.url, tmp_path, options=options))
        sensor = rig.sensor.model_copy(update={"url": behind.url})
        found = list(instruments(rig.model_copy(update={"sensor": sensor})))
    named = [one for one in found if "chardelay" in one.remedy and behind.url in one.what]
    assert len(named) == (0 if options else 1)
    assert all(one.mark == "note" for one in named)
