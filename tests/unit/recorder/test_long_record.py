"""The record of a long hold: memory stays bounded while it is written and closed; no sample is
missing."""

import random
from collections import Counter
from itertools import pairwise
from typing import Any, cast

import pyarrow.parquet as untyped_parquet
import pytest
from mcap.reader import make_reader
from msgspec.structs import replace

from pincette.core.messages import Ack, GroundTruth, Message, Position, Recorded, Sample
from pincette.records import finished_copy, mcap_file, mcap_reading, parquet
from pincette.records.mcap_file import NAME
from pincette.records.row_blocks import RowBlocks
from pincette_recorder import record_repair
from tests.support.memory import peak_MB, reset_peak, resident_MB
from tests.support.recorded import PERIOD_S, tick

from .conftest import Bench

files = cast(Any, untyped_parquet)
BATCH = 12
"""Number of ticks between two checks of the recorder: a quarter of a second, so one chunk each."""


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use small blocks, row groups and indexes, so that each limit is reached soon."""
    monkeypatch.setattr(RowBlocks.__init__, "__kwdefaults__", {"every_tick": True, "rows": 256})
    monkeypatch.setattr(parquet.writer, "__defaults__", (1024,))
    monkeypatch.setattr(mcap_file, "INDEXED_CHUNKS", 100)
    monkeypatch.setattr(finished_copy, "AT_ONCE", 500)


class LongRecord:
    """A record into which the same tick is written repeatedly."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.ticks, self.counts = bench, 0, Counter[type[Message]]()
        chance = random.Random(3)
        self._tick = [*tick(2, chance, final=False)]
        self._last = [*tick(2, chance, final=True)]
        assert bench.begin() == Ack(0)

    def feed(self, ticks: int, *, final: bool = False) -> None:
        """Record this many ticks; the last one may be that of the arming."""
        end = self.ticks + ticks
        while self.ticks < end:
            batch: list[Message] = []
            for _ in range(min(BATCH, end - self.ticks)):
                made = self._last if final and self.ticks == end - 1 else self._tick
                batch += [numbered(message, self.ticks) for message in made]
                self.ticks += 1
            self.counts.update(map(type, batch))
            self.bench.feed(batch)
            self.bench.wait(BATCH * PERIOD_S + 0.02)


def numbered(message: Message, seq: int) -> Message:
    if isinstance(message, GroundTruth):
        return replace(message, seq=1000 + seq)
    return replace(message, seq=seq) if isinstance(message, Sample) else message


def check(bench: Bench, warm_up: int, ticks: int, growth_MB: float) -> None:
    record = LongRecord(bench)
    record.feed(warm_up)
    begin_MB = resident_MB()
    record.feed(ticks)
    grown_MB = resident_MB() - begin_MB
    record.feed(BATCH, final=True)
    reset_peak()
    recorded = bench.finish(record.ticks - 1)
    closing_MB = peak_MB() - begin_MB
    print(f"{record.counts.total()} messages: {grown_MB:+.1f} MB, closing {closing_MB:+.1f} MB")
    assert isinstance(recorded, Recorded)
    assert recorded.complete, recorded.detail
    assert recorded.messages == record.counts.total()
    path = bench.jobs / "j-1" / NAME
    seqs = [
        one.seq
        for one in mcap_reading.messages_of(path, ("position",))
        if isinstance(one, Position)
    ]
    assert seqs == list(range(record.ticks))
    assert Counter(map(type, mcap_reading.messages_of(path))) == record.counts
    with path.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True)
        summary = found.get_summary()
        assert summary is not None
        assert not summary.chunk_indexes  # longer than an index may be
        times = [one.log_time for _, _, one in found.iter_messages(topics=["position"])]
    assert len(times) == record.ticks
    assert all(first < second for first, second in pairwise(times))
    table = files.ParquetFile(path.with_name("samples.parquet"))
    assert table.metadata.num_rows == record.ticks
    rows = [row for part in parquet.parts(path.with_name("samples.parquet")) for row in part["seq"]]
    assert rows == list(range(record.ticks))
    assert grown_MB < growth_MB
    assert closing_MB < 2.0 * growth_MB


@pytest.mark.usefixtures("small")
def test_a_record_beyond_all_size_bounds_is_complete(bench: Bench) -> None:
    check(bench, 1300, 1500, 4.0)


@pytest.mark.slow
def test_a_record_of_two_million_messages_needs_bounded_memory(bench: Bench) -> None:
    check(bench, 30_000, 270_000, 40.0)


@pytest.mark.usefixtures("small")
def test_a_long_interrupted_record_is_closed_in_bounded_memory(bench: Bench) -> None:
    record = LongRecord(bench)
    record.feed(1400)
    path = bench.jobs / "j-1" / NAME
    copy = bench.jobs / "j-2"
    copy.mkdir()
    (copy / NAME).write_bytes(path.read_bytes())
    closing = record_repair.finish_record(copy, record_repair.KILLED)
    assert closing["complete"] == "false"
    kept = Counter(map(type, mcap_reading.messages_of(copy / NAME)))
    assert kept[Position] >= record.ticks - 2 * BATCH
    table = files.ParquetFile(copy / "samples.parquet")
    assert table.metadata.num_rows == kept[Position]
