"""Rows joined block by block equal the rows joined at once."""

from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace

from pincette.core.messages import Applied, Command, Estimate, GroundTruth, Message, Position
from pincette.records import folder, mcap_reading, parquet
from pincette.records.columns import columns
from pincette.records.row_blocks import RowBlocks
from pincette.records.tables import Tables, lost, write_tables_of_file
from tests.support.recorded import ABOUT, PERIOD_S, START_NS, loop, write

ROWS = 16
TICKS = 10 * ROWS


def joined(messages: Sequence[Message], *, every_tick: bool = True) -> dict[str, list[Any]]:
    """The columns of all blocks, one after another."""
    blocks = RowBlocks(PERIOD_S, every_tick=every_tick, rows=ROWS)
    parts: list[dict[str, list[Any]]] = []
    for message in messages:
        blocks.add(message)
        if blocks.full:
            parts.append(blocks.take())
    assert len(parts) > 5
    parts.append(blocks.rest())
    assert parts[-1] == blocks.rest()
    return {name: [value for part in parts for value in part[name]] for name in parts[0]}


def unanswered(messages: Sequence[Message], *, lockstep: bool) -> list[Message]:
    """Return the same loop with ticks without a command, which a rig in real time does not
    count."""
    skipped = {20, 21, 77, 140}
    found: list[Message] = []
    for message in messages:
        if isinstance(message, Command) and message.seq in skipped:
            continue
        if isinstance(message, Applied) and message.seq in skipped:
            found.append(replace(message, answered=False))
        elif isinstance(message, GroundTruth) and not lockstep:
            found += _counted_without(message, skipped)
        else:
            found.append(message)
    return found


def _counted_without(truth: GroundTruth, skipped: set[int]) -> list[Message]:
    tick = truth.seq - next(one.seq for one in loop(1) if isinstance(one, GroundTruth))
    if tick in skipped:
        return []
    return [replace(truth, seq=truth.seq - sum(1 for one in skipped if one < tick))]


def test_joined_row_blocks_equal_the_whole_table() -> None:
    assert joined(loop(TICKS)) == columns(loop(TICKS), PERIOD_S)


@pytest.mark.parametrize("lockstep", [True, False])
def test_true_values_are_in_the_row_of_their_tick(lockstep: bool) -> None:
    messages = unanswered(loop(TICKS), lockstep=lockstep)
    assert joined(messages, every_tick=lockstep) == columns(messages, PERIOD_S)


def test_messages_may_be_late_or_lost() -> None:
    random = Random(1)
    messages = [one for one in loop(TICKS) if random.random() > 0.05]
    messages.sort(key=lambda one: getattr(one, "seq", 0) % 1000 + random.uniform(0.0, 5.0))
    found, whole = joined(messages), columns(messages, PERIOD_S)
    for name in whole:
        if not name.startswith("true_"):  # some of which are lost, which never happens on a rig
            assert found[name] == whole[name], name


def test_missing_rows_are_counted_across_blocks() -> None:
    gone = {(Position, 15), (Estimate, 40), (Command, 41), (Applied, 31), (Applied, 100)}
    messages = [one for one in loop(TICKS) if (type(one), getattr(one, "seq", 0)) not in gone]
    whole = lost(messages)
    blocks = RowBlocks(1.0, rows=ROWS)
    for message in messages:
        blocks.add(message)
        if blocks.full:
            blocks.take()
    assert blocks.missing == whole == {"position": 1, "estimate": 1, "command": 1, "applied": 2}


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks and row groups of few rows."""
    monkeypatch.setattr(RowBlocks.__init__, "__kwdefaults__", {"every_tick": True, "rows": ROWS})
    monkeypatch.setattr(parquet.writer, "__defaults__", (3 * ROWS,))


def written(path: Path) -> dict[str, list[Any]]:
    source = parquet.opened(path / folder.SAMPLES)
    return source.read().to_pydict()


@pytest.mark.usefixtures("small")
def test_a_table_that_is_published_early_continues(tmp_path: Path) -> None:
    messages, tables = loop(TICKS), Tables(tmp_path, ABOUT, PERIOD_S)
    for place, message in enumerate(messages):
        tables.add(message, START_NS + place)
        if place in (400, 401, 700):
            assert tables.write() == []
            assert written(tmp_path) == columns(messages[: place + 1], PERIOD_S)
    assert tables.write() == []
    assert written(tmp_path) == columns(messages, PERIOD_S)
    assert parquet.opened(tmp_path / folder.SAMPLES).num_row_groups > 1
    tables.close()
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.usefixtures("small")
def test_the_table_of_a_file_is_made_in_parts(tmp_path: Path) -> None:
    messages = unanswered(loop(TICKS), lockstep=False)
    write(tmp_path / "job.mcap", messages, finish=False)
    kept = mcap_reading.read(tmp_path / "job.mcap").messages
    found = write_tables_of_file(tmp_path)
    assert (found.wrong, found.missing) == ([], lost(kept))
    assert written(tmp_path) == columns(kept, PERIOD_S)
