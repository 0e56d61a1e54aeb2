"""From a rig file without a model to a grip, over REST, on randomly drawn rigs."""

from collections.abc import Iterable

import pytest

from tests.support.twenty_rigs import COUNT, PAIRS, Row, runs, table


def check(coming: Iterable[Row]) -> None:
    rows: list[Row] = []
    for row in coming:
        print(row, flush=True)
        rows.append(row)
    print(table(rows))
    assert [row.outcome for row in rows] == ["gripped"] * len(rows)
    assert {row.seed: row.misses for row in rows if row.misses} == {}


def test_an_unknown_rig_is_brought_up() -> None:
    check(runs("fast", [1]))


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS)
def test_twenty_unknown_rigs_are_brought_up(pair: str) -> None:
    check(runs(pair, range(1, COUNT + 1)))
