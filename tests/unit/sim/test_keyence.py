import pytest

from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.keyence_commands import Fault, Unit, value


@pytest.mark.parametrize(
    ("position_um", "unit", "text"),
    [
        (30.02, "um", b"+0030.02"),
        (-0.012, "um", b"-0000.01"),
        (-0.001, "um", b"+0000.00"),
        (9999.99, "um", b"+9999.99"),
        (9999.996, "um", b"+FFFFFFF"),
        (-20000.0, "um", b"-FFFFFFF"),
        (0.26, "mm", b"+0.00026"),
        (-1234.5, "mm", b"-1.23450"),
        (10000.0, "mm", b"+FFFFFFF"),
        (None, "um", b"XXXXXXXX"),
        (float("nan"), "um", b"XXXXXXXX"),
    ],
)
def test_values_have_eight_characters(position_um: float | None, unit: Unit, text: bytes) -> None:
    assert value(position_um, unit) == text
    assert len(text) == 8


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"MS,01", b"MS,01,+0001.50"),
        (b"ms,12", b"MS,12,+0001.50"),
        (b"MS,13", b"ER,MS,62"),
        (b"MS,00", b"ER,MS,62"),
        (b"MS,1", b"ER,MS,62"),
        (b"MS", b"ER,MS,61"),
        (b"MM,110000000000", b"MM,110000000000,+0001.50,+0001.50"),
        (b"MM,000000000000", b"ER,MM,62"),
        (b"MM,1100000000000", b"ER,MM,62"),
        (b"MM,11000000000x", b"ER,MM,62"),
        (b"MA", b"MA" + 12 * b",+0001.50"),
        (b"R0", b"ER,R0,01"),
        (b"Q0", b"Q0"),
        (b"VR,1", b"VR"),
        (b"VR,13", b"ER,VR,62"),
        (b"KL,1", b"KL"),
        (b"KL,2", b"ER,KL,62"),
        (b"SW,CA,3", b"ER,SW,51"),
        (b"ZZ", b"ER,ZZ,50"),
        (b"M1", b"ER,M1,50"),
        (b"MS," + 40 * b"0", b"ER,MS,60"),
        (b"", None),
    ],
)
def test_the_laser_answers_readings_in_measuring_mode(line: bytes, reply: bytes | None) -> None:
    assert SimulatedKeyence(lambda: 1.5).answer(line) == reply


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"M0", b"M0,+0001.50,+0001.50"),
        (b"M1", b"M1,+0001.50"),
        (b"m2", b"M2,+0001.50"),
        (b"M1,1", b"ER,M1,21"),
        (b"MS,01", b"ER,MS,00"),
        (b"SW,CA,3", b"ER,SW,01"),
        (b"KL,7", b"ER,KL,22"),
        (b"M1" + 40 * b" ", b"ER,M1,20"),
        (b"R0", b"ER,R0,01"),
    ],
)
def test_the_older_controller_uses_its_own_protocol(line: bytes, reply: bytes) -> None:
    assert SimulatedKeyence(lambda: 1.5, dialect="LK-G3000").answer(line) == reply


@pytest.mark.parametrize(("trouble", "code"), [("timeout", b"88"), ("other", b"99")])
def test_internal_faults_are_reported(trouble: Fault, code: bytes) -> None:
    instrument = SimulatedKeyence(lambda: 1.5)
    instrument.trouble = trouble
    assert instrument.answer(b"MS,01") == b"ER,MS," + code
    instrument.trouble = None
    assert instrument.answer(b"MS,01") == b"MS,01,+0001.50"


def test_set_up_mode_stops_measuring_until_it_is_left() -> None:
    instrument = SimulatedKeyence(lambda: 1.5)
    lines = [b"Q0", b"Q0", b"MS,01", b"SW,CA,3", b"SW,OC,01,0,5", b"R0", b"MS,01"]
    assert [instrument.answer(line) for line in lines] == [
        b"Q0",
        b"ER,Q0,01",
        b"ER,MS,51",
        b"SW,CA",
        b"SW,OC",
        b"R0",
        b"MS,01,+0001.50",
    ]


def test_a_change_of_mode_takes_time() -> None:
    now_s = 10.0
    instrument = SimulatedKeyence(lambda: 1.5, clock=lambda: now_s, mode_change_s=1.0)
    assert instrument.answer(b"MS,01") == b"MS,01,+0001.50"
    assert instrument.answer(b"Q0") == b"Q0"
    now_s = 10.9
    assert instrument.answer(b"SW,CA,3") == b"ER,SW,51"
    now_s = 11.0
    assert instrument.answer(b"SW,CA,3") == b"SW,CA"
    assert instrument.answer(b"R0") == b"R0"
    assert instrument.answer(b"R0") == b"ER,R0,01"
    assert instrument.answer(b"MS,01") == b"ER,MS,51"
    now_s = 12.0
    assert instrument.answer(b"MS,01") == b"MS,01,+0001.50"


def test_settings_of_sampling_and_averaging_are_applied_to_the_simulated_sensor() -> None:
    told_s = list[float]()
    instrument = SimulatedKeyence(lambda: 1.5, set_averaging=told_s.append)
    assert instrument.averaging_s == 20e-6
    instrument.answer(b"Q0")
    for line in (b"SW,OC,01,0,5", b"SW,OC,02,0,9", b"SW,CA,8", b"SW,CA,8", b"SW,OC,1,0,0"):
        assert instrument.answer(line) == line[:5]
    assert told_s == pytest.approx([1024 * 20e-6, 1024 * 1e-3, 1e-3])
    assert instrument.averaging_s == 1e-3
    for line, code in (
        (b"SW,CA,9", b"62"),
        (b"SW,OC,01,0,10", b"62"),
        (b"SW,OC,13,0,1", b"62"),
        (b"SW,OC,01,1,1", b"62"),
        (b"SW,CA,3,3", b"61"),
        (b"SW,OC,01,0", b"61"),
        (b"SW,XX,0", b"62"),
        (b"SW,CA", b"61"),
    ):
        assert instrument.answer(line) == b"ER,SW," + code
    assert len(told_s) == 3


def test_a_zero_lasts_until_it_is_reset_and_cannot_be_set_while_the_panel_is_locked() -> None:
    x_um = 1.5
    instrument = SimulatedKeyence(lambda: x_um)
    instrument.answer(b"KL,1")
    instrument.press_zero()
    assert instrument.answer(b"MS,01") == b"MS,01,+0001.50"
    instrument.answer(b"KL,0")
    instrument.press_zero()
    x_um = 2.0
    assert instrument.answer(b"VR,2") == b"VR"
    assert instrument.answer(b"MM,110000000000") == b"MM,110000000000,+0000.50,+0002.00"


def test_unsolicited_lines_precede_an_answer_except_in_set_up_mode() -> None:
    instrument = SimulatedKeyence(lambda: 1.5, unsolicited_every=2)
    replies = [instrument.answer(b"MS,01") for _ in range(4)]
    alone, both = b"MS,01,+0001.50", b"TG,01,+0001.50\rMS,01,+0001.50"
    assert replies == [alone, both, alone, both]
    assert [instrument.answer(line) for line in (b"Q0", b"SW,CA,3")] == [b"Q0", b"SW,CA"]
