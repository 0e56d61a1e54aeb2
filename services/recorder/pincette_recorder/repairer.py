"""Closes, repairs and deletes records, in a thread beside the recording thread.

Closing a long record takes many seconds; meanwhile a new job still gets its reply.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from msgspec.structs import replace

from pincette.core.messages import Finish, Message, Recorded
from pincette.engine.threads import log_failure
from pincette.records import folder as files
from pincette.records import mcap_reading
from pincette.records.mcap_file import NAME
from pincette_recorder import record_repair, retention
from pincette_recorder.config import RecorderConfig
from pincette_recorder.counted_time import CountedTime

log = logging.getLogger(__name__)
CHECKED = 10
"""Number of the newest records that are compared with their manifests at the start."""
KNOWN = 100
"""Number of records whose intact state is remembered."""
MOST_TEXT = 380
"""Largest length of a reply's detail; see ``codec.MAX_TEXT``."""
Reply = Callable[[Message | str], None]


class RecordRepairer:
    """One thread that works on folders without an open record."""

    def __init__(self, config: RecorderConfig, counted: CountedTime | None = None) -> None:
        self._config = config
        self.counted = counted or CountedTime(config.records)
        self._pool = ThreadPoolExecutor(1, "repairer")
        self.repaired = self.deleted = 0
        """Number of records that this program has closed after an interruption since the start."""
        self.damaged: dict[str, list[str]] = {}
        """Files that differ from the manifest and could not be restored, by record."""
        self._sound: deque[str] = deque(maxlen=KNOWN)
        """Names of records that this process has written or checked."""

    def note_written(self, name: str) -> None:
        """Note that a record was closed and its manifest written."""
        self._sound.append(name)

    def tidy(self, left: Iterable[Path]) -> None:
        """Close unfinished records, then delete those that exceed the rig file's limits; log
        errors."""
        self._pool.submit(self.tidy_now, tuple(left)).add_done_callback(log_failure)

    def tell_end(self, request: Finish, reply: Reply) -> None:
        """Reply to a request for a record that is not open: state how it ended, after closing and
        repairing it.
        """
        folder = self._config.records / request.job

        def answer(*, check: bool) -> None:
            try:
                if check:
                    self._repair(folder)
                ended = _end_of(folder / NAME, request)
                lost = self.damaged.get(folder.name)
                if lost and isinstance(ended, Recorded):
                    ended = replace(ended, complete=False, detail=_lost_words(folder, lost))
                reply(ended)
            except Exception as error:
                # Reading a damaged file may raise any error, and the supervisor waits for this
                # reply.
                reply(f"the record of job {request.job} cannot be read: {error}"[:MOST_TEXT])
                if not isinstance(error, OSError):
                    raise

        if not (folder / NAME).exists():
            reply(f"there is no record of job {request.job[:90]!r}")
        elif folder.name in self._sound:
            answer(check=False)
        else:
            self._pool.submit(answer, check=True).add_done_callback(log_failure)

    def check_newest(self) -> Future[None]:
        """Compare the newest records with their manifests, and repair them; errors are logged.

        Call it while no record is open. Other requests are handled between two records, so that a
        supervisor that starts at the same time waits for one record at most.

        Returns
        -------
        Future[None]
            Done when all records were compared.
        """
        checked: Future[None] = Future()
        checked.add_done_callback(log_failure)
        self._check_next(deque(files.newest(self._config.records, CHECKED)), checked)
        return checked

    def _check_next(self, folders: deque[Path], checked: Future[None]) -> None:
        def check() -> None:
            folder = folders.popleft()
            try:
                self._repair(folder)
            except Exception as error:
                log.error(
                    "%s cannot be compared with its manifest: %s",
                    folder,
                    error,
                    exc_info=None if isinstance(error, OSError) else error,
                )
            self._check_next(folders, checked)

        if not folders:
            checked.set_result(None)
            return
        with suppress(RuntimeError):  # the program is ending; the next start compares the others
            self._pool.submit(check).add_done_callback(log_failure)

    def close(self) -> None:
        """Finish the running work, and begin no more work."""
        self._pool.shutdown(cancel_futures=True)
        self.counted.close()

    def _close_record(self, folder: Path) -> None:
        if not mcap_reading.is_closed(folder / NAME):
            record_repair.finish_record(folder, record_repair.KILLED)
            self.repaired += 1

    def _repair(self, folder: Path) -> None:
        """Close an interrupted record, and restore files that differ from its manifest."""
        if (folder / NAME).exists():
            self._close_record(folder)
        # The supervisor writes its own documents again.
        lost = [name for name in record_repair.restore(folder) if name in record_repair.OWN]
        if not lost:
            self.damaged.pop(folder.name, None)
            self._sound.append(folder.name)
        elif self.damaged.get(folder.name) != lost:
            self.damaged[folder.name] = lost
            log.error("%s", _lost_words(folder, lost))

    def tidy_now(self, left: tuple[Path, ...]) -> None:
        """Do the work of ``tidy`` in the thread of the caller; raises OSError."""
        config = self._config
        for folder in left:
            self._close_record(folder)
        retention.sweep(config.records)
        kept = retention.ended(config.records)
        ages_s = self.counted.ages_s([one.name for one in kept])
        if self.counted.step_s is not None:  # a person must confirm first
            return
        for name in retention.records_to_delete(kept, ages_s, config.keep_s, config.keep_bytes):
            retention.delete(config.records, name)
            self.deleted += 1


def _lost_words(folder: Path, lost: list[str]) -> str:
    """Return which files of a record are damaged, with their folder and the remedy."""
    return f"{folder}: {', '.join(lost)} lost or changed: copy it from a backup"


def _end_of(path: Path, request: Finish) -> Recorded | str:
    """Return how a record ended; raises OSError."""
    about, closing = mcap_reading.read_closing(path)
    if closing is None:
        return f"the record of job {request.job} does not state how it ended"
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
