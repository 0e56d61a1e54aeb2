"""Time counted by the recorder itself, which determines the age of records.

The time of day may be changed by years, and begins in 1970 if a clock has no battery. So a record's
age grows only while a recorder runs, by its monotonic clock. The time of day is compared with the
counted time. While the two disagree nothing is deleted, until a person confirms the new time.
"""

import json
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import isfinite
from pathlib import Path
from time import monotonic, time
from typing import Annotated

import msgspec

from pincette.core.files import replace_file
from pincette.records import folder as files

log = logging.getLogger(__name__)
STATE = ".counted.json"
"""File in the folder of records that stores the counted time."""
LONGEST_S = 60.0
"""Longest time that is counted between two calls, in s; in a longer gap no recorder ran."""
SAVE_S = 600.0
"""Interval at which the counted time is written, in s."""
BEHIND_S = 3_600.0
"""Time by which the time of day may lag behind the counted time, in s."""
AHEAD_S = 7 * 86_400.0
"""Time by which the time of day may be ahead of the counted time, in s: as long as a recorder may
have been off.
"""

Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=1e12)]


class _State(msgspec.Struct):
    """Content of the file."""

    counted_s: Seconds = 0.0
    """Total running time of recorders, in s."""
    wall_s: float | None = None
    """Newest time of day that agreed with the counted time, in s of UTC; None before the first."""
    wall_at_s: Seconds = 0.0
    """Counted time at ``wall_s``, in s."""
    stepped: bool = False
    """True if the time of day has stepped since ``wall_s`` and no person has confirmed it yet."""
    ended: dict[str, Seconds] = msgspec.field(default_factory=dict[str, float])
    """Counted time at which each record was first seen closed, by record name, in that order."""


class CountedTime:
    """Counts time, and keeps the count over restarts; safe to use from several threads."""

    def __init__(
        self,
        records: Path,
        wall_s: Callable[[], float] = time,
        steady_s: Callable[[], float] = monotonic,
    ) -> None:
        self._records, self._wall_s, self._steady_s = records, wall_s, steady_s
        self._lock = threading.Lock()
        self._counted_at_s = steady_s()
        self._state = self._read()
        self._saved_s = self._state.counted_s
        self._off_s = 0.0

    def _read(self) -> _State:
        path = self._records / STATE
        try:
            state = msgspec.json.decode(path.read_bytes(), type=_State)
            if state.wall_s is not None and not isfinite(state.wall_s):
                raise ValueError(f"wall_s = {state.wall_s}")
        except FileNotFoundError:
            return _State()
        except (OSError, ValueError, msgspec.MsgspecError) as error:
            log.error(
                "%s cannot be used, so the age of all records is counted from now: %s",
                path,
                error,
            )
            return _State()
        return state

    @property
    def step_s(self) -> float | None:
        """Deviation of the time of day in s; None if it agrees, or a person has confirmed it."""
        with self._lock:
            return self._off_s if self._state.stepped else None

    def count(self) -> None:
        """Count the time since the last call, and compare the time of day with it."""
        with self._lock:
            self._count()

    def _count(self) -> None:
        state, now_s = self._state, self._steady_s()
        state.counted_s += min(max(now_s - self._counted_at_s, 0.0), LONGEST_S)
        self._counted_at_s = now_s
        wall_s = self._wall_s()
        before_s = wall_s if state.wall_s is None else state.wall_s
        self._off_s = wall_s - before_s - (state.counted_s - state.wall_at_s)
        if -BEHIND_S <= self._off_s <= AHEAD_S:
            agrees, why = True, "the time of day agrees again with the counted time"
        else:
            agrees, why = state.stepped and self._taken(), "a person has confirmed the time of day"
        if agrees:
            state.wall_s, state.wall_at_s = wall_s, state.counted_s
            if state.stepped:
                log.warning("%s: records are deleted again", why)
                state.stepped = False
                self._save()
        elif not state.stepped:
            with suppress(OSError):  # discard the confirmation of an earlier step
                (self._records / files.CLOCK_AGREED).unlink()
            state.stepped = True
            log.error(
                "the time of day has stepped by %+.0f s against the counted time: no record "
                "is deleted until a person acknowledges the alarm `clock`",
                self._off_s,
            )
            self._save()
        if state.counted_s - self._saved_s >= SAVE_S:
            self._save()

    def _taken(self) -> bool:
        try:
            (self._records / files.CLOCK_AGREED).unlink()
        except OSError:
            return False
        return True

    def ages_s(self, names: Sequence[str]) -> Mapping[str, float]:
        """Return the ages of closed records in s, in the order in which they were first seen.

        Newly seen records have age 0.
        """
        with self._lock:
            self._count()
            state, present = self._state, set(names)
            known = {name: at_s for name, at_s in state.ended.items() if name in present}
            ended = known | {name: state.counted_s for name in names if name not in known}
            if ended != state.ended:
                state.ended = ended
                self._save()
            return {name: max(0.0, state.counted_s - at_s) for name, at_s in ended.items()}

    def close(self) -> None:
        """Write the counted time."""
        with self._lock:
            self._count()
            self._save()

    def _save(self) -> None:
        self._saved_s = self._state.counted_s
        if not self._records.is_dir():  # there is no record that could age
            return
        try:
            content = json.dumps(msgspec.to_builtins(self._state), indent=1, ensure_ascii=False)
            replace_file(self._records / STATE, content.encode() + b"\n")
        except OSError as error:
            log.error("%s cannot be written: %s", self._records / STATE, error)
