"""Samples of a run in bounded memory: all rows are kept, but a long hold is thinned out evenly."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, sqrt
from sys import intern
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.api.results import JobResult, LimitActed
from pincette.core.messages import Burst, Message
from pincette.records.columns import COLUMNS, SECOND_COLUMNS, Columns
from pincette.records.row_blocks import RowBlocks
from pincette_supervisor.plugin import figures
from pincette_supervisor.plugin.figures import series, within
from pincette_supervisor.plugin.result import LIMITS, PRESSED, force_error, phases, position_error

HELD_ROWS = 32_768
"""Largest number of rows of holds in memory; eleven minutes at 50 Hz are kept in full."""
PART_ROWS = 8192
"""Largest number of rows in one block."""
THINNED = frozenset({"hold", "stopped"})
"""Phases without an end, which may be thinned out evenly."""
EXTREME_ROWS, EXTREMES_OF = 4096, 32
"""Largest number of rows with extremes, and number of rows that are reduced to their common
extremes when there are more.
"""
EXTREMES = ("x_um", "force_mN")
"""Columns whose smallest and largest values are kept."""
HELD: Mapping[str, tuple[str, str]] = {
    "force": ("force_mN", ""),
    "true force": ("true_force_mN", ""),
    "force error": ("force_mN", "force_r_mN"),
    "position error": ("x_um", "x_r_um"),
}
"""Quantities of a hold that are summed over all samples: a column minus its reference."""
LAST_S, LAST_ROWS = 0.5, 500
"""Extent of the newest rows, which are kept in full: a time in s, and a largest number of rows."""
TEXTS = frozenset(column.name for column in (*COLUMNS, *SECOND_COLUMNS) if column.kind == "text")
KINDS: Mapping[str, type[Any]] = {
    "seq": int,
    **{
        column.name: {"int": int, "bool": bool}.get(column.kind, float)
        for column in (*COLUMNS, *SECOND_COLUMNS)
    },
}
Indices = NDArray[np.intp]


class Sums(NamedTuple):
    """Number, sum and sum of squares of values."""

    number: int = 0
    total: float = 0.0
    squares: float = 0.0

    def plus(self, values: NDArray[np.float64]) -> "Sums":
        """Return the sums with further values; missing ones are left out."""
        known = values[~np.isnan(values)]
        return Sums(
            self.number + known.size,
            self.total + float(known.sum()),
            self.squares + float(np.sum(known**2)),
        )


@dataclass(slots=True)
class LeftOut:
    """Summary of the rows that a table lacks."""

    rows: int = 0
    unanswered: int = 0
    limits: dict[int, tuple[int, int]] = field(default_factory=dict[int, tuple[int, int]])
    """First seq and number of rows, by the bits of ``limits_active``."""

    sums: dict[str, Sums] = field(default_factory=dict[str, Sums])
    """Sums over the rows of holds, by the names of ``HELD``."""

    def add(self, rows: "Rows") -> None:
        """Add rows to the summary."""
        self.rows += len(rows)
        self.unanswered += int(np.sum(rows.numbers["answered"] == 0.0))
        bits = rows.numbers["limits_active"]
        for value in np.unique(bits[bits > 0.0]):
            seqs = rows.numbers["seq"][bits == value]
            first, count = self.limits.get(int(value), (int(seqs.min()), 0))
            self.limits[int(value)] = min(first, int(seqs.min())), count + len(seqs)
        hold = np.array([name == "hold" for name in rows.texts["phase"]], dtype=np.bool_)
        for name, (column, reference) in HELD.items():
            values = rows.numbers[column][hold]
            if reference:
                values = values - rows.numbers[reference][hold]
            self.sums[name] = self.sums.get(name, Sums()).plus(values)

    def copy(self) -> "LeftOut":
        """Return a copy of the summary."""
        return LeftOut(self.rows, self.unanswered, {**self.limits}, {**self.sums})


class Rows:
    """Packed rows of a table: 8 bytes for each number, and shared texts."""

    def __init__(
        self, numbers: dict[str, NDArray[np.float64]], texts: dict[str, list[str | None]]
    ) -> None:
        self.numbers, self.texts = numbers, texts

    @classmethod
    def of(cls, table: Columns) -> "Rows":
        """Pack a table."""
        numbers = {
            name: np.array([np.nan if v is None else v for v in values], dtype=np.float64)
            for name, values in table.items()
            if name not in TEXTS
        }
        texts = {
            name: [None if v is None else intern(v) for v in values]
            for name, values in table.items()
            if name in TEXTS
        }
        return cls(numbers, texts)

    def __len__(self) -> int:
        return len(self.numbers["seq"])

    def at(self, places: Indices) -> "Rows":
        """Return some of the rows."""
        return Rows(
            {name: values[places] for name, values in self.numbers.items()},
            {name: [values[place] for place in places] for name, values in self.texts.items()},
        )

    def split(self, chosen: NDArray[np.bool_]) -> "tuple[Rows, Rows]":
        """Return the chosen rows, and the others."""
        return self.at(np.flatnonzero(chosen)), self.at(np.flatnonzero(~chosen))

    def extremes(self) -> "Rows":
        """Return rows with the smallest and the largest values of ``EXTREMES``."""
        places: set[int] = set()
        for name in EXTREMES:
            values = self.numbers[name]
            if not np.all(np.isnan(values)):
                places |= {int(np.nanargmin(values)), int(np.nanargmax(values))}
        return self.at(np.array(sorted(places), dtype=np.intp))


def joined(parts: Sequence[Rows]) -> Columns:
    """Unpack rows into one table, in the order of their numbers."""
    order = np.argsort(np.concatenate([part.numbers["seq"] for part in parts]), kind="stable")
    table: dict[str, list[Any]] = {}
    for name in parts[0].numbers:
        kind = KINDS.get(name, float)
        values = np.concatenate([part.numbers[name] for part in parts])[order].tolist()
        # NaN for a missing sample.
        table[name] = [None if v != v else kind(v) for v in values]
    for name in parts[0].texts:
        texts = [value for part in parts for value in part.texts[name]]
        table[name] = [texts[place] for place in order]
    names = ("seq", "t_s", *(one.name for one in (*COLUMNS, *SECOND_COLUMNS)))
    return {name: table[name] for name in names if name in table}


@dataclass(frozen=True, slots=True)
class RunTables:
    """Tables of a run, in which a long hold is thinned out."""

    even: Columns
    """Rows of the run. A long hold is thinned out evenly, so that means do not depend on the
    thinning.
    """
    extreme: Columns
    """Rows of ``even``, plus the extremes of the omitted rows, plus all of the newest rows."""
    left_out: LeftOut
    """Summary of the rows that ``even`` lacks."""
    bursts: Sequence[Message]
    """Buffered acquisitions of the sensor."""


class RunSamples:
    """Collects the messages of a run. A run without a long hold is kept in full."""

    # Rows of a hold are kept if their number is a multiple of the stride. The stride doubles
    # whenever there are too many rows, so that all parts of all holds are kept equally.

    def __init__(
        self, period_s: float, *, every_tick: bool = True, thinned: frozenset[str] = THINNED
    ) -> None:
        """Create the samples; see ``RowBlocks`` for ``every_tick``.

        Rows of the phases in ``thinned`` may be dropped.
        """
        self._blocks = RowBlocks(period_s, every_tick=every_tick)
        self._thinned = thinned
        self._last = min(LAST_ROWS, ceil(LAST_S / period_s))
        self._others: list[Rows] = []
        self._held: list[Rows] = []
        self._extremes: list[Rows] = []
        self._stride = 1
        self._course: tuple[str | None, str | None] = None, None
        """Phase and outcome of the newest row."""
        self._left_out = LeftOut()
        self._bursts: list[Message] = []

    @classmethod
    def of(cls, messages: Iterable[Message], period_s: float, **wishes: Any) -> "RunSamples":
        """Return the samples of all messages of a run."""
        samples = cls(period_s, **wishes)
        for message in messages:
            samples.add(message)
        return samples

    def add(self, message: Message) -> None:
        """Add a message, in order of arrival."""
        if isinstance(message, Burst):
            self._bursts.append(message)
        self._blocks.add(message)
        if self._blocks.full:
            self.add_rows(self._blocks.take())

    def add_rows(self, table: Columns) -> None:
        """Add rows that are already joined, in order."""
        rows = Rows.of(table)
        held, others = rows.split(self._may_go(rows))
        if len(rows):
            self._course = rows.texts["phase"][-1], rows.texts["outcome"][-1]
        _extend(self._others, others)
        kept, gone = held.split(self._even(held))
        _extend(self._held, kept)
        self._leave_out(gone)
        while sum(map(len, self._held)) > HELD_ROWS:
            self._stride *= 2
            held = _one(self._held)
            kept, gone = held.split(self._even(held))
            self._held = [kept]
            self._leave_out(gone)

    def _may_go(self, rows: Rows) -> NDArray[np.bool_]:
        """Find rows that may be dropped: those of long phases and pauses without a change."""
        texts = rows.texts
        course = [*zip(texts["phase"], texts["outcome"], strict=True)]
        # If a part is held after a stop, each row has the outcome "stopped".
        quiet = np.array(
            [
                not acted and now == before and state == "armed"
                for acted, now, before, state in zip(
                    texts["acted"],
                    course,
                    [self._course, *course][: len(course)],
                    texts["actuator_state"],
                    strict=True,
                )
            ],
            dtype=np.bool_,
        )
        long = np.array([name in self._thinned for name in texts["phase"]], np.bool_)
        if "hold" in self._thinned:
            long |= rows.numbers["paused"] == 1.0
        return quiet & long

    def _even(self, rows: Rows) -> NDArray[np.bool_]:
        return rows.numbers["seq"] % self._stride == 0.0

    def _leave_out(self, gone: Rows) -> None:
        if not len(gone):
            return
        self._left_out.add(gone)
        self._extremes.append(gone.extremes())
        if sum(map(len, self._extremes)) > EXTREME_ROWS:
            whole = _one(self._extremes)
            self._extremes = [
                whole.at(np.arange(begin, min(begin + EXTREMES_OF, len(whole)))).extremes()
                for begin in range(0, len(whole), EXTREMES_OF)
            ]

    def tables(self) -> RunTables:
        """Build the tables of the rows so far; more rows may be added later."""
        rest = self._blocks.rest()
        if not self._others:
            return RunTables(rest, rest, LeftOut(), self._bursts)
        left_out, parts = self._left_out.copy(), [*self._others, *self._held]
        newest = Rows.of(rest) if rest["seq"] else parts[0].at(np.array([], dtype=np.intp))
        may_go = self._may_go(newest) & ~self._even(newest)
        may_go[max(0, len(newest) - self._last) :] = False
        gone, kept = newest.split(may_go)
        left_out.add(gone)
        even = joined([*parts, kept])
        if not left_out.rows:
            return RunTables(even, even, left_out, self._bursts)
        extreme = joined([*parts, *self._extremes, newest])
        return RunTables(even, extreme, left_out, self._bursts)


def _extend(parts: list[Rows], rows: Rows) -> None:
    """Append rows to the last part as long as it is small, so that there are few parts."""
    if parts and len(parts[-1]) + len(rows) <= PART_ROWS:
        parts[-1] = _one([parts[-1], rows])
    else:
        parts.append(rows)


def _one(parts: Sequence[Rows]) -> Rows:
    numbers = {
        name: np.concatenate([part.numbers[name] for part in parts]) for name in parts[0].numbers
    }
    texts = {
        name: [value for part in parts for value in part.texts[name]] for name in parts[0].texts
    }
    order = np.argsort(numbers["seq"], kind="stable")
    return Rows(numbers, texts).at(order)


# Completes the result of a run whose hold was thinned out evenly; pure.


def completed(result: JobResult, tables: RunTables, period_s: float) -> JobResult:
    """Add the effect of the rows that were left out: counts, extremes, sums, and ends of phases.

    Percentiles, causes of errors, and the results of two arms are computed from the thinned rows.
    """
    left, extreme = tables.left_out, tables.extreme
    if not left.rows:
        return result
    found: dict[str, Any] = {
        "samples": result.samples + left.rows,
        "missed_ticks": result.missed_ticks - left.rows,
        "unanswered_ticks": result.unanswered_ticks + left.unanswered,
        "limits_acted": _limits(result.limits_acted, left),
        "phases": phases(extreme["phase"], extreme["t_s"], period_s),
    }
    if "peak_force_mN" in type(result).model_fields and "second_force_mN" not in extreme:
        zeroed = ~np.isnan(series(extreme, "zero_age_s"))
        found |= _means(result, tables, period_s)
        found["peak_force_mN"] = figures.largest(series(extreme, "force_mN"), zeroed)
    if "drift_um" in type(result).model_fields:
        hold = within(extreme, ["hold"])
        found["drift_um"] = figures.peak_to_peak(series(extreme, "x_um"), hold)
    return result.model_copy(update=found)


def _means(result: JobResult, tables: RunTables, period_s: float) -> dict[str, float]:
    """Return means and r.m.s. values over all samples of a hold."""
    table, sums = tables.even, tables.left_out.sums
    values = {
        "force": series(table, "force_mN"),
        "true force": series(table, "true_force_mN"),
        "force error": force_error(table),
        "position error": position_error(table),
    }
    hold = figures.settled(within(table, ["hold"]), period_s)
    found: dict[str, float] = {}
    for name, quantity, mask, squared in (
        ("force_held_mN", "force", hold, False),
        ("true_force_held_mN", "true force", hold, False),
        ("force_error_mN", "force error", hold, False),
        ("rmse_force_mN", "force error", hold, True),
        ("rmse_position_um", "position error", hold, True),
        ("contact_rmse_force_mN", "force error", within(table, PRESSED), True),
        ("contact_rmse_position_um", "position error", within(table, PRESSED), True),
    ):
        if getattr(result, name, None) is not None:
            whole = sums[quantity].plus(values[quantity][mask])
            mean = (whole.squares if squared else whole.total) / whole.number
            found[name] = sqrt(mean) if squared else mean
    return found


def _limits(known: list[LimitActed], left: LeftOut) -> list[LimitActed]:
    acted = {one.limit: (one.first_seq, one.samples) for one in known}
    for bits, (first_seq, rows) in left.limits.items():
        for bit, name in LIMITS.items():
            if bits & bit:
                first, count = acted.get(name, (first_seq, 0))
                acted[name] = min(first, first_seq), count + rows
    return [
        LimitActed(limit=name, first_seq=first_seq, samples=count)
        for name, (first_seq, count) in acted.items()
    ]
