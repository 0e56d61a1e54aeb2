"""One rule for every typed number: read as it is displayed, or refused."""

import pytest

from pincette.core import numerals


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2.5", 2.5),
        ("2,5", 2.5),
        (" 5 ", 5.0),
        ("\t5\n", 5.0),
        ("+5", 5.0),
        ("-5", -5.0),
        ("−5", -5.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("007", 7.0),
        ("1.000", 1.0),
        ("0,125", 0.125),
        ("0,000", 0.0),
        ("2,5e-3", 0.0025),
        ("2.5E−3", 0.0025),
        ("1e5", 1e5),
        ("0e-999", 0.0),
        ("12,5000", 12.5),
        ("0.1", 0.1),
    ],
)
def test_a_number_is_read_as_it_is_shown(text: str, value: float) -> None:
    assert numerals.number(text) == value


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "5,",
        ",5",
        "007,125",
        "5e",
        "e5",
        ".",
        "-",
        "1.000,5",
        "1,000.5",
        "1,000",
        "12,500",
        "-999,999",
        "1 000",
        "1\u00a0000",
        "1'000",
        "1_000",
        "0x10",
        "0b1",
        "nan",
        "inf",
        "-Infinity",
        "true",
        "5mN",
        "5 mN",
        "5%",
        "１５",
        "٣",
        "²",
        "½",
        "1e400",
        "-1e400",
        "1e-400",
        "--5",
        "+-5",
        "5-",
        "1,2,3",
        "1;2",
        "5\n6",
        "9" * 401,
    ],
)
def test_a_text_without_a_number_or_with_two_numbers_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        numerals.number(text)


@pytest.mark.parametrize(("text", "value"), [("5", 5), (" 007 ", 7), ("−3", -3), ("+3", 3)])
def test_a_whole_number_is_read(text: str, value: int) -> None:
    assert numerals.whole(text) == value


@pytest.mark.parametrize(
    "text", ["5.0", "5,0", "1e3", "1_000", "５", "", "1 000", "0x1", "9" * 5000]
)
def test_a_whole_number_has_only_digits(text: str) -> None:
    with pytest.raises(ValueError, match="whole number"):
        numerals.whole(text)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("5", [5.0]),
        ("2.5", [2.5]),
        ("5; 10", [5.0, 10.0]),
        ("0,5;1,0", [0.5, 1.0]),
        ("0,5 1,0", [0.5, 1.0]),
        ("5, 10, 2.5", [5.0, 10.0, 2.5]),
        ("5 10\n15", [5.0, 10.0, 15.0]),
        ("0.5,1.0,2.5", [0.5, 1.0, 2.5]),
        ("-5,-3", [-5.0, -3.0]),
        ("1 500", [1.0, 500.0]),
    ],
)
def test_a_list_is_read_as_it_is_shown(text: str, values: list[float]) -> None:
    assert numerals.numbers(text) == values


@pytest.mark.parametrize(
    "text",
    [
        "",
        "5,10",
        "5,10,20",
        "0,5,1,0",
        "2,5",
        "1.000,5",
        "5, 10,5",
        "5,10 15,",
        "1 000",
        "1 000;2",
        "5;;7",
        "5,,7",
        "5;",
        "5 10 x",
        "1,000 2",
    ],
)
def test_an_ambiguous_list_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        numerals.numbers(text)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("0:5,1.5:12", [["0", "5"], ["1.5", "12"]]),
        ("0:5; 1,5:12", [["0", "5"], ["1,5", "12"]]),
        ("0:0,5 1:1,5", [["0", "0,5"], ["1", "1,5"]]),
        ("0:5, 1:6", [["0", "5"], ["1", "6"]]),
    ],
)
def test_records_are_separated_by_characters_other_than_decimal_signs(
    text: str, found: list[list[str]]
) -> None:
    assert numerals.records(text, 2) == found


@pytest.mark.parametrize("text", ["0:5,7", "0:5,1:2,5", "0,5:1,1:2", "", "0:", "0:5;", "0:1:2"])
def test_an_incomplete_record_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"^"):
        numerals.records(text, 2)
