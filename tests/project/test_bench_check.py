"""`make bench-check` finds ratios that are worse than expected."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from tests.bench.check.expected import Expected, Judged, expected, judged

RATE = Expected(value=0.8, noise=0.1, better="higher")
TAIL = Expected(value=1.5, noise=0.2, better="lower")


@pytest.mark.parametrize(
    ("one", "found", "holds"),
    [
        (RATE, 0.9, True),
        (RATE, 0.73, True),
        (RATE, 0.71, False),
        (RATE, float("nan"), False),
        (TAIL, 1.0, True),
        (TAIL, 1.79, True),
        (TAIL, 1.81, False),
        (TAIL, float("nan"), False),
    ],
)
def test_a_ratio_that_is_worse_by_more_than_its_noise_fails(
    one: Expected, found: float, holds: bool
) -> None:
    assert one.holds(found) is holds


def test_a_missing_measurement_fails() -> None:
    (one,) = judged({"rate": RATE}, {"tail": 1.0})
    assert one == Judged("rate", RATE, None)
    assert not one.holds


@pytest.mark.parametrize(
    "line", ["value = 0.0, noise = 0.1", "value = 1.0, noise = -0.1", "value = 1.0"]
)
def test_an_expected_value_that_no_result_can_miss_is_refused(tmp_path: Path, line: str) -> None:
    path = tmp_path / "expected.toml"
    path.write_text(f'[timed]\nrate = {{ {line}, better = "higher" }}\n[counted]\n')
    with pytest.raises(ValidationError):
        expected("timed", path)
