"""Tables of a record, made from its messages part by part, and the gaps in them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pincette.core.messages import Applied, Burst, GroundTruth, Message, Timing
from pincette.core.topics import APPLIED, GROUND_TRUTH
from pincette.records import folder as files
from pincette.records import mcap_reading
from pincette.records.columns import numbers_every_tick
from pincette.records.mcap_file import NAME
from pincette.records.record_times import RecordTimes
from pincette.records.row_blocks import RowBlocks
from pincette.records.timings import loop_timing

NO_PERIOD = "the record does not state its control period: no table can be made from it"


class Tables:
    """Tables of one record while its messages arrive; memory is bounded.

    Samples beyond the newest rows are written at once, to a draft beside the table.
    """

    def __init__(
        self, folder: Path, about: Mapping[str, str], period_s: float, *, every_tick: bool = True
    ) -> None:
        """Begin the tables of a record; for ``every_tick`` see ``RowBlocks``."""
        self._folder, self._about = folder, about
        self._times = RecordTimes(about, period_s)
        self._rows = RowBlocks(period_s, every_tick=every_tick)
        self._samples: files.SamplesDraft | None = None
        self._timings: dict[str, Timing] = {}
        self._bursts: dict[int, Burst] = {}
        self._trouble: OSError | None = None

    def add(self, message: Message, arrival_ns: int) -> None:
        """Add a message, in order of arrival, with its arrival in ns of UTC."""
        self._times.add(message, arrival_ns)
        if isinstance(message, Timing):
            self._timings[message.service] = message
        elif isinstance(message, Burst):
            self._bursts[message.seq] = message
        self._rows.add(message)
        if self._rows.full:
            self._write_block()

    def _write_block(self) -> None:
        block = self._rows.take()
        if self._trouble is not None:
            return
        try:
            if self._samples is None:
                path, two = self._folder / files.SAMPLES, self._rows.two_arms
                self._samples = files.SamplesDraft(path, self._about, two_arms=two)
            self._samples.add(block)
        except OSError as error:
            self._trouble = error  # the error is reported with the table

    def write(self) -> list[str]:
        """Write the tables of all messages so far; return their errors; raises OSError."""
        if self._trouble is not None:
            raise self._trouble
        about = {**self._about, **self.times}
        if self._samples is None:
            files.write_samples(self._folder / files.SAMPLES, self._rows.rest(), about)
        else:
            self._samples.publish(self._rows.rest(), about)
        timing = loop_timing(self._timings.values())
        if timing is not None:
            files.write_json(self._folder / files.TIMING, timing.model_dump(exclude={"silent"}))
        try:
            acquired = joined(self._bursts.values())
        except ValueError as error:
            return [str(error)]
        if acquired is not None:
            about["rate_hz"] = repr(acquired.rate_hz)
            path = self._folder / files.BURST
            files.write_burst(path, acquired.x_um, acquired.drive_V, about)
        return []

    @property
    def times(self) -> dict[str, str]:
        """Return the UTC times of the record so far; see ``RecordTimes.texts``."""
        return self._times.texts()

    @property
    def missing(self) -> dict[str, int]:
        """Return the number of samples that were sent and never arrived, by topic."""
        return self._rows.missing

    def close(self) -> None:
        """Delete the draft."""
        if self._samples is not None:
            self._samples.discard()
            self._samples = None


@dataclass(frozen=True, slots=True)
class Written:
    """Findings about the tables of a record that was read from its file."""

    wrong: list[str]
    """Errors of the tables."""
    missing: dict[str, int]
    """Number of samples that never arrived, by topic."""
    times: dict[str, str]
    """UTC times of the record."""


def write_tables_of_file(folder: Path) -> Written:
    """Write the tables of the record in a folder; reads its file part by part.

    Raises OSError, or ValueError for messages of another version.
    """
    path = folder / NAME
    every_tick = numbers_every_tick(
        one
        for one in mcap_reading.messages_of(path, (APPLIED.name, GROUND_TRUTH.name))
        if isinstance(one, Applied | GroundTruth)
    )
    about = mcap_reading.read_about(path)
    try:
        period_s = float(about["period_s"])
    except (KeyError, ValueError):
        return Written([NO_PERIOD], lost(mcap_reading.messages_of(path)), {})
    tables = Tables(folder, about, period_s, every_tick=every_tick)
    try:
        for message, arrival_ns in mcap_reading.arrivals_of(path):
            tables.add(message, arrival_ns)
        return Written(tables.write(), tables.missing, tables.times)
    finally:
        tables.close()


@dataclass(frozen=True, slots=True)
class Joined:
    """N samples at intervals of 1/``rate_hz``: position in µm and drive in V."""

    rate_hz: float
    x_um: list[float]
    drive_V: list[float]


def joined(messages: Iterable[Message]) -> Joined | None:
    """Join the bursts of one epoch.

    Returns None without a burst; raises ValueError if one is missing or invalid.
    """
    bursts = {message.seq: message for message in messages if isinstance(message, Burst)}
    if not bursts:
        return None
    for seq in range(min(bursts), max(bursts) + 1):
        if seq not in bursts:
            raise ValueError(f"the acquisition of sample {seq} was not received")
        if not bursts[seq].valid:
            raise ValueError(f"the acquisition of sample {seq} was out of the sensor's range")
    ordered = [bursts[seq] for seq in sorted(bursts)]
    return Joined(
        ordered[0].rate_hz,
        [value for burst in ordered for value in burst.x_um],
        [value for burst in ordered for value in burst.drive_V],
    )


def lost(messages: Iterable[Message]) -> dict[str, int]:
    """Return the number of samples of an epoch that were sent and never arrived, by topic."""
    rows = RowBlocks(1.0)
    for message in messages:
        rows.add(message)
        if rows.full:
            rows.take()
    return rows.missing
