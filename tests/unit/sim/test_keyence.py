import pytest

from pincette.sim.keyence import SimulatedKeyence, Unit, value


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
        (b"MS,13", b"ER,MS,22"),
        (b"MS,1", b"ER,MS,22"),
        (b"MS", b"ER,MS,21"),
        (b"MM,110000000000", b"MM,110000000000,+0001.50,+0001.50"),
        (b"MM,000000000000", b"ER,MM,22"),
        (b"MA", b"MA" + 12 * b",+0001.50"),
        (b"R0", b"ER,R0,01"),
        (b"Q0", b"Q0"),
        (b"VR,1", b"VR"),
        (b"KL,1", b"KL"),
        (b"SW,CA,3", b"ER,SW,01"),
        (b"ZZ", b"ER,ZZ,00"),
        (b"", None),
    ],
)
def test_in_measuring_mode(line: bytes, reply: bytes | None) -> None:
    assert SimulatedKeyence(lambda: 1.5).answer(line) == reply


def test_set_up_mode_stops_measuring_until_it_is_left() -> None:
    instrument = SimulatedKeyence(lambda: 1.5)
    lines = [b"Q0", b"Q0", b"MS,01", b"SW,CA,3", b"SW,OC,01,0,5", b"R0", b"MS,01"]
    assert [instrument.answer(line) for line in lines] == [
        b"Q0",
        b"ER,Q0,01",
        b"ER,MS,01",
        b"SW,CA",
        b"SW,OC",
        b"R0",
        b"MS,01,+0001.50",
    ]
