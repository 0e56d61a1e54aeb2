"""Samples of a run: all of them, but only evenly spaced ones of a long hold."""

import pytest
from msgspec.structs import replace

from pincette.core.messages import Applied, Estimate, GroundTruth, Message, Sample
from pincette.records.columns import columns
from pincette.records.row_blocks import RowBlocks
from pincette_supervisor.kinds.grip.functions import evaluate
from pincette_supervisor.results import run_samples
from pincette_supervisor.results.run_samples import RunSamples, RunTables, completed
from tests.support.arms import with_arm

from . import samples
from .samples import PERIOD_S, run_of

HOLD_TICKS = 10_000
PEAK_MN, LIMITED = 31.0, 3


def long_grip(hold_ticks: int = HOLD_TICKS) -> list[Message]:
    """Return a grip with a long hold that contains one peak of force and a few ticks at a limit."""
    ticks = samples.slow_grip(3)
    names = [tick.telemetry.phase for tick in ticks]
    begin = names.index("hold") + 100  # where the hold is settled
    found = [message for tick in ticks[:begin] for message in tick.messages()]
    for more in range(hold_ticks):
        for message in ticks[begin + more % 50].messages():
            found.append(_moved(message, begin + more - (begin + more % 50), more))
    for tick in ticks[begin + 50 :]:
        found += [_moved(message, hold_ticks - 50, -1) for message in tick.messages()]
    return found


def _moved(message: Message, by: int, place: int) -> Message:
    if not isinstance(message, Sample | GroundTruth):
        return message
    message = replace(message, seq=message.seq + by)
    if isinstance(message, Estimate) and place == HOLD_TICKS // 3:
        return with_arm(message, force_mN=PEAK_MN)
    if isinstance(message, Applied) and HOLD_TICKS // 2 <= place < HOLD_TICKS // 2 + LIMITED:
        return with_arm(message, limits_active=1, answered=False)
    return message


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use blocks of few rows, of which few are stored."""
    monkeypatch.setattr(RowBlocks.__init__, "__kwdefaults__", {"every_tick": True, "rows": 256})
    monkeypatch.setattr(run_samples, "HELD_ROWS", 1024)
    monkeypatch.setattr(run_samples, "EXTREME_ROWS", 32)


def result_of(tables: RunTables) -> dict[str, object]:
    made = evaluate(run_of("grip", tables.even)).result
    return completed(made, tables, PERIOD_S).model_dump()


def test_a_usual_run_is_stored_in_full() -> None:
    messages = long_grip(1000)
    tables = RunSamples.of(messages, PERIOD_S).tables()
    assert tables.even == tables.extreme == columns(messages, PERIOD_S)


@pytest.mark.usefixtures("small")
def test_a_run_without_a_long_hold_is_stored_in_full() -> None:
    messages = [
        replace(one, phase="track") if hasattr(one, "phase") else one for one in long_grip(2000)
    ]
    tables = RunSamples.of(messages, PERIOD_S).tables()
    assert tables.even == tables.extreme == columns(messages, PERIOD_S)
    messages = long_grip(2000)
    whole = RunSamples.of(messages, PERIOD_S, thinned=frozenset()).tables()
    assert whole.even == columns(messages, PERIOD_S)


@pytest.mark.usefixtures("small")
def test_the_result_of_a_long_hold_is_that_of_all_its_samples() -> None:
    messages = long_grip()
    tables = RunSamples.of(messages, PERIOD_S).tables()
    assert tables.left_out.rows > 0.8 * HOLD_TICKS
    assert len(tables.extreme["seq"]) < 3300
    whole = RunSamples.of(messages, PERIOD_S, thinned=frozenset()).tables()
    found, expected = result_of(tables), result_of(whole)
    exact = (
        "outcome",
        "phases",
        "limits_acted",
        "samples",
        "missed_ticks",
        "unanswered_ticks",
        "peak_force_mN",
        "contact_x_um",
        "final_force_mN",
    )
    for name in exact:
        assert found[name] == expected[name], name
    assert found["peak_force_mN"] == PEAK_MN
    for name in (
        "force_held_mN",
        "true_force_held_mN",
        "force_error_mN",
        "rmse_force_mN",
        "rmse_position_um",
        "contact_rmse_force_mN",
        "contact_rmse_position_um",
    ):
        assert found[name] == pytest.approx(expected[name], rel=1e-4), name


@pytest.mark.usefixtures("small")
def test_stored_rows_do_not_grow_with_the_hold() -> None:
    kept = [
        len(RunSamples.of(long_grip(ticks), PERIOD_S).tables().extreme["seq"])
        for ticks in (4000, 16_000)
    ]
    assert kept[1] < 1.3 * kept[0]
