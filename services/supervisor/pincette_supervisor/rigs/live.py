"""The last minute of a rig's samples for live charts, in a ring buffer."""

# ``take`` runs in threads of the bus and only fills rows. A listener has a cursor in the buffer and
# no queue: a slow listener gets fewer points, and the number of points that it has missed.

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from itertools import groupby
from math import ceil
from time import monotonic
from typing import Any

from pincette.api.live import LiveBatch, SecondColumns
from pincette.core.idle_sampling import idle_periods
from pincette.core.messages import Applied, Estimate, Message, Position, Telemetry
from pincette.core.topics import Topic
from pincette_supervisor.journal.events import TooManyListenersError

KEPT_S, KEPT_PER_S = 60.0, 60.0
"""Length in s and density in 1/s of the stored samples; at a higher sampling rate, every second,
third, … sample is stored."""
KEPT = int(KEPT_S * KEPT_PER_S)
EVENT_POINTS, HISTORY_POINTS = 60, 1200
"""Largest number of points of a reading, and of the first reading, which contains the last
minute."""
LATE_TICKS = 8
"""Number of ticks for which a row waits for its messages."""
STALL_S = 0.5
"""Longest additional wait of a row, in s, while a program's messages have not reached its number.
After a stall all messages of one program may arrive before those of the next one."""
EARLY_MOST = 64
"""Largest number of samples whose messages are kept before their position has arrived."""
LISTENERS_MAX = 16
"""Largest number of listeners of one client."""


@dataclass(slots=True)
class Row:
    """Values of one sample number of one epoch."""

    epoch: int
    seq: int
    at_s: float
    t_s: float
    number: int = -1
    """Number of the row since the start."""
    whole: bool = False
    """True if the row has the controller's telemetry; otherwise phase and playing keep their
    previous values."""
    estimated: bool = False
    """True if the row has the estimator's message, with or without a force."""
    applied: bool = False
    """True if the row has the actuator's message, with a confirmed voltage or not."""
    armed: bool = True
    """True if the actuator follows commands, as far as known."""
    after_gap: bool = False
    """True if samples are missing between the previous row and this one."""
    playing: bool = False
    phase: str = ""
    x_um: float | None = None
    x_r_um: float | None = None
    force_mN: float | None = None
    force_r_mN: float | None = None
    force_uncertainty_mN: float | None = None
    voltage_V: float | None = None
    sliding_um: float | None = None
    second: "SecondRow | None" = field(default=None, metadata={"column": False})


@dataclass(slots=True)
class SecondRow:
    """Values of the second arm in a row, and of the part between both arms."""

    x_um: float | None = None
    force_mN: float | None = None
    voltage_V: float | None = None
    place_um: float | None = None
    place_r_um: float | None = None


COLUMNS = [
    each.name for each in fields(Row) if each.default is None and each.metadata.get("column", True)
]
SECOND_COLUMNS = [each.name for each in fields(SecondRow)]


class LiveSamples:
    """Joins the samples of a rig by number, and keeps the newest rows."""

    def __init__(self, rig: str, period_s: float, clock: Callable[[], float] = monotonic) -> None:
        self.rig, self.clock = rig, clock
        self._stride = max(1, ceil(1.0 / (KEPT_PER_S * period_s) - 1e-9))
        self._lock = threading.Lock()
        self._pending: dict[int, Row] = {}
        """Rows of the newest epoch that still wait for messages, by seq."""
        self._early: dict[int, list[Estimate | Telemetry | Applied]] = {}
        """Messages that arrived before the position with the same seq, by seq. Each program has a
        connection of its own, and a busy machine may read these in any order."""
        self._newest = -1
        """Number of the newest position in the epoch."""
        self._epoch: int | None = None
        self._passed: dict[type[Message], int] = {}
        """Newest number of each kind of message in the epoch, except positions."""
        self._place = (-1, -1)
        """Epoch of the newest row, and its number divided by the stride.

        An idle rig skips numbers, so they need not be multiples of the stride.
        """
        self._idle_stride = max(self._stride, idle_periods(period_s))
        self._rows: deque[Row] = deque(maxlen=KEPT)
        self._count = 0
        self._listeners: Counter[str] = Counter()
        """Number of listeners by client."""

    def take(self, _topic: Topic, message: Message) -> None:
        """Add a message to its row; called in threads of the bus."""
        if not isinstance(message, Position | Estimate | Telemetry | Applied):
            return
        with self._lock:
            if isinstance(message, Position):
                place = message.epoch, message.seq // self._stride
                self._newest = message.seq
                if place != self._place:
                    self._place = place
                    self._begin(message)
                return
            if message.epoch != self._epoch:
                return
            self._passed[type(message)] = message.seq
            row = self._pending.get(message.seq)
            if row is not None:
                self._add(row, message)
            elif message.seq > self._newest:
                self._keep_early(message)

    def _add(self, row: Row, message: Estimate | Telemetry | Applied) -> None:
        """Add a message to its row, and close the row if it is complete."""
        _fill(row, message)
        if row.whole and row.estimated and row.applied:
            self._close(row.seq)

    def _keep_early(self, message: Estimate | Telemetry | Applied) -> None:
        """Keep a message until the position of its number has arrived."""
        self._early.setdefault(message.seq, []).append(message)
        if len(self._early) > EARLY_MOST:
            del self._early[min(self._early)]

    def _begin(self, position: Position) -> None:
        """Open the row of a sample, and close those of an earlier epoch."""
        if position.epoch != self._epoch:
            if self._pending:
                self._close(max(self._pending))
            self._epoch = position.epoch
            self._passed.clear()
            self._early.clear()
        self._close_late(position.seq - LATE_TICKS * self._stride)
        row = Row(position.epoch, position.seq, self.clock(), position.t_s)
        first, *others = position.arms
        row.x_um = first.x_um if first.valid else None
        for other in others:
            row.second = SecondRow(x_um=other.x_um if other.valid else None)
        self._pending[position.seq] = row
        for message in self._early.pop(position.seq, ()):
            self._add(row, message)
        for seq in [seq for seq in self._early if seq < position.seq]:
            del self._early[seq]

    def _close_late(self, seq: int) -> None:
        """Close the rows up to a number for which no more messages can be expected."""
        now_s = self.clock()
        for key in sorted(key for key in self._pending if key <= seq):
            row = self._pending[key]
            awaited = row.armed and any(passed < key for passed in self._passed.values())
            if awaited and now_s - row.at_s < STALL_S and len(self._pending) < KEPT:
                break
            self._close(key)

    def _close(self, seq: int) -> None:
        """Close every row up to a number, in order."""
        for key in sorted(key for key in self._pending if key <= seq):
            row = self._pending.pop(key)
            before = self._rows[-1] if self._rows else row
            if not row.whole and row.armed and before.epoch == row.epoch:
                row.playing, row.phase = before.playing, before.phase
            stride = self._stride if row.armed else self._idle_stride
            row.after_gap = before.epoch != row.epoch or row.seq - before.seq > stride
            row.number = self._count
            self._count += 1
            self._rows.append(row)

    def read(self, place: int, most: int) -> tuple[int, int, list[Row]]:
        """Return the next place, the number of lost rows, and rows thinned out to ``most``."""
        with self._lock:
            fresh: list[Row] = []
            for row in reversed(self._rows):
                if row.number < place:
                    break
                fresh.append(row)
            count = self._count
        step = max(1, ceil(len(fresh) / most))
        if step == 1:
            return count, count - place - len(fresh), fresh[::-1]
        thinned = [
            replace(fresh[i], after_gap=any(row.after_gap for row in fresh[i : i + step]))
            for i in range(0, len(fresh), step)
        ]
        return count, count - place - len(fresh), thinned[::-1]

    def open(self, client: str = "", most: int = LISTENERS_MAX) -> "LiveCursor":
        """Start listening at the oldest row.

        Raises TooManyListenersError if the client has ``most`` listeners already.
        """
        with self._lock:
            if self._listeners[client] >= most:
                raise TooManyListenersError(
                    f"{client} has {most} listeners to live samples, the maximum"
                )
            self._listeners[client] += 1
            oldest = self._rows[0].number if self._rows else self._count
        return LiveCursor(self, oldest)

    def since(self, place: int | None) -> "LiveCursor":
        """Return a cursor for one reading; a place from before a restart starts at the oldest
        row."""
        with self._lock:
            oldest = self._rows[0].number if self._rows else self._count
            count = self._count
        if place is None or place > count:
            return LiveCursor(self, oldest)
        return LiveCursor(self, place, EVENT_POINTS)

    def leave(self, client: str = "") -> None:
        """Remove a listener of a client."""
        with self._lock:
            self._listeners[client] -= 1
            if not self._listeners[client]:
                del self._listeners[client]


def _fill_second(row: SecondRow, message: Estimate | Telemetry | Applied) -> None:
    if isinstance(message, Estimate):
        second = message.arms[1] if len(message.arms) > 1 else None
        if second is not None and message.valid and second.zero_age_s is not None:
            row.force_mN = second.force_mN
    elif isinstance(message, Applied):
        row.voltage_V = message.confirmed_V(1)
    else:
        row.place_um = message.place_um
        row.place_r_um = message.place_r_um if message.playing else None


def _fill(row: Row, message: Estimate | Telemetry | Applied) -> None:
    if row.second is not None:
        _fill_second(row.second, message)
    if isinstance(message, Estimate):
        row.estimated = True
        arm = message.arms[0]
        if message.valid and arm.zero_age_s is not None:
            row.force_mN = arm.force_mN
            row.force_uncertainty_mN = arm.force_uncertainty_mN
    elif isinstance(message, Applied):
        row.applied, row.armed = True, message.state == "armed"
        row.voltage_V = message.confirmed_V()
    else:
        row.whole, row.playing = True, message.playing
        if message.playing:
            row.phase = message.phase
            row.x_r_um, row.force_r_mN = message.arms[0].x_r_um, message.force_r_mN
            row.sliding_um = message.sliding_um


class LiveCursor:
    """Position of one listener in the rows of a rig."""

    def __init__(self, live: LiveSamples, place: int, most: int = HISTORY_POINTS) -> None:
        self.live, self.place = live, place
        self._most = most
        self._sent_at: float | None = None

    def batches(self, silence_s: float) -> list[LiveBatch]:
        """Return batches since the last call; an empty one after a silence, to show that the
        connection works."""
        self.place, dropped, rows = self.live.read(self.place, self._most)
        self._most = EVENT_POINTS
        now_s = self.live.clock()
        if not rows:
            if self._sent_at is not None and now_s - self._sent_at < silence_s:
                return []
            found = [_batch(self.live.rig, now_s, [])]
        else:
            found = [_batch(self.live.rig, now_s, group) for group in _grouped(rows)]
        self._sent_at = now_s
        return [found[0].model_copy(update={"dropped": dropped}), *found[1:]]


def _grouped(rows: list[Row]) -> Iterator[list[Row]]:
    """Yield rows in groups of one epoch and one phase."""
    for _, group in groupby(rows, key=lambda row: (row.epoch, row.playing, row.phase)):
        yield list(group)


def _batch(rig: str, now_s: float, rows: list[Row]) -> LiveBatch:
    first = rows[0] if rows else Row(0, 0, now_s, 0.0)
    columns: dict[str, Any] = {
        name: [_rounded(getattr(row, name)) for row in rows] for name in COLUMNS
    }
    return LiveBatch(
        rig=rig,
        epoch=first.epoch,
        playing=first.playing,
        phase=first.phase,
        now_s=now_s,
        dropped=0,
        seq=[row.seq for row in rows],
        at_s=[round(row.at_s, 4) for row in rows],
        t_s=[round(row.t_s, 6) for row in rows],
        after_gap=[row.after_gap for row in rows],
        second=_second_columns(rows),
        **columns,
    )


def _second_columns(rows: list[Row]) -> SecondColumns | None:
    if all(row.second is None for row in rows):
        return None
    seconds = [row.second or SecondRow() for row in rows]
    columns: dict[str, Any] = {
        name: [_rounded(getattr(each, name)) for each in seconds] for name in SECOND_COLUMNS
    }
    return SecondColumns(**columns)


def _rounded(value: float | None) -> float | None:
    """Return a value with the resolution of a screen: 0.1 nm, 0.1 µN or 0.1 mV."""
    return None if value is None else round(value, 4)
