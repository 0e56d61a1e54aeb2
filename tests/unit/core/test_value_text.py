"""Values in messages have the words of JSON and TOML, which users write."""

import pytest

from pincette.core.validation_wording import value_text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (True, "true"),
        (None, "null"),
        (-1.5, "-1.5"),
        ("much", "'much'"),
        ([1, False, [None]], "[1, false, [null]]"),
        ({"queue": True}, "{'queue': true}"),
    ],
)
def test_booleans_and_null_are_written_as_in_json(value: object, text: str) -> None:
    assert value_text(value) == text


def test_a_long_text_is_shortened() -> None:
    assert len(value_text("x" * 1000, 50)) <= 50
