"""Closes what a crash has left and deletes what shall not stay, beside the thread that records.

To close a long record takes many seconds, in which a job that is about to begin gets its answer.
"""

import logging
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pincette.core.messages import Finish, Message, Recorded
from pincette.engine.threads import log_failure
from pincette.records import mcap_reading
from pincette.records.mcap_file import NAME
from pincette_recorder import record_repair, retention
from pincette_recorder.config import RecorderConfig
from pincette_recorder.counted_time import CountedTime

log = logging.getLogger(__name__)
MOST_TEXT = 380
"""Length of a reply's detail; see ``codec.MAX_TEXT``."""
Reply = Callable[[Message | str], None]


class Mender:
    """One thread that works on folders of which no record is open."""

    def __init__(self, config: RecorderConfig, counted: CountedTime | None = None) -> None:
        self._config = config
        self.counted = counted or CountedTime(config.records)
        self._pool = ThreadPoolExecutor(1, "mender")
        self.mended = self.deleted = 0
        """Records since the start."""

    def tidy(self, left: Iterable[Path]) -> None:
        """Close these, then delete what the rig file asks for; errors are logged."""
        self._pool.submit(self.tidy_now, tuple(left)).add_done_callback(log_failure)

    def tell_end(self, request: Finish, reply: Reply) -> None:
        """Tell what became of a record that was closed without being asked, or broke off.

        One that broke off is closed first, and the reply comes later.
        """
        folder = self._config.records / request.job

        def answer(*, mending: bool) -> None:
            try:
                if mending:
                    self._mend(folder)
                reply(_end_of(folder / NAME, request))
            except OSError as error:
                reply(f"the record of job {request.job} cannot be read: {error}")

        try:
            whole = mcap_reading.is_closed(folder / NAME)
        except FileNotFoundError:
            reply(f"there is no record of job {request.job[:90]!r}")
            return
        except OSError:
            whole = True  # it is read once more, for the answer
        if whole:
            answer(mending=False)
        else:
            self._pool.submit(answer, mending=True).add_done_callback(log_failure)

    def close(self) -> None:
        """End what has begun, and begin nothing more."""
        self._pool.shutdown(cancel_futures=True)
        self.counted.close()

    def _mend(self, folder: Path) -> None:
        if not mcap_reading.is_closed(folder / NAME):
            record_repair.mend(folder, record_repair.KILLED)
            self.mended += 1

    def tidy_now(self, left: tuple[Path, ...]) -> None:
        """Do the same in the thread of the caller; raises OSError."""
        config = self._config
        for folder in left:
            self._mend(folder)
        retention.sweep(config.records)
        kept = retention.ended(config.records)
        ages_s = self.counted.ages_s([one.name for one in kept])
        if self.counted.step_s is not None:  # a person has to agree first
            return
        for name in retention.records_to_delete(kept, ages_s, config.keep_s, config.keep_bytes):
            retention.delete(config.records, name)
            self.deleted += 1


def _end_of(path: Path, request: Finish) -> Recorded | str:
    """How a record has ended; raises OSError."""
    about, closing = mcap_reading.read_closing(path)
    if closing is None:
        return f"the record of job {request.job} does not say how it has ended"
    if about.get("epoch", str(request.epoch)) != str(request.epoch):
        return f"the record of job {request.job} is of epoch {about['epoch']}"
    detail = closing["detail"]
    last = int(closing.get("last_seq", "-1"))
    if request.last_seq is not None and "last_seq" in closing and last < request.last_seq:
        missing = f"; samples {last + 1} to {request.last_seq} are missing"
        detail = detail[: MOST_TEXT - len(missing)] + missing
    return Recorded(
        job=request.job,
        messages=int(closing["messages"]),
        dropped=int(closing["dropped"]),
        complete=closing["complete"] == "true",
        detail=detail[:MOST_TEXT],
    )
