"""A record writer with its own clocks."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

import pytest

from pincette.control.quantities import Document
from pincette.core.messages import Ack, Finish, Message, Record, Recorded
from pincette.core.topics import TOPIC_OF
from pincette_recorder.config import RecorderConfig
from pincette_recorder.intake import Intake
from pincette_recorder.record_writer import RecordWriter
from pincette_recorder.repairer import RecordRepairer
from pincette_recorder.wall_clock import WallClock
from tests.support.bytes_bus import carried
from tests.support.recorded import ABOUT, EPOCH, PERIOD_S, START_NS

CONFIG = RecorderConfig(
    rig="demo",
    digest="d1",
    period_s=PERIOD_S,
    records=Path(),
    models=Path(),
    rig_file='{"rig": {"name": "demo"}}',
    min_free_bytes=0,
    silence_s=10.0,
    keep_s=None,
    keep_bytes=None,
)


class Bench:
    """A record writer, its input, and its time."""

    def __init__(self, folder: Path, room: int = 10_000) -> None:
        self.now_s = 100.0
        self.jobs = folder / "jobs"
        self.config = replace(CONFIG, records=self.jobs, models=folder / "models")
        self.wall_step_s = 0.0
        """Time by which the machine's clock was set."""
        self.wall = WallClock(self.wall_ns, self.clock_ns)
        self.intake = Intake(self.wall.now_ns, room)
        self.repairer = RecordRepairer(self.config)
        self.writer = self.new_writer()
        self.begun: list[Message | str] = []
        self.replies: list[Message | str] = []

    def new_writer(self) -> RecordWriter:
        """Return the writer of a recorder that has just started."""
        return RecordWriter(self.config, self.intake, self.wall, self.repairer, lambda: self.now_s)

    def clock_ns(self) -> int:
        return START_NS + round((self.now_s - 100.0) * 1e9)

    def wall_ns(self) -> int:
        return self.clock_ns() + round(self.wall_step_s * 1e9)

    def begin(self, job: str = "j-1", epoch: int = EPOCH, **about: str) -> Ack | str | None:
        """Request a record; returns None if the reply is still pending."""
        whose = {**ABOUT, "job": job, "epoch": str(epoch), **about}
        self.begun.clear()
        self.writer.begin(Record(job, epoch, Document(json.dumps(whose))), self.begun.append)
        return self.answer

    @property
    def answer(self) -> Ack | str | None:
        """Return the reply to ``begin``."""
        if not self.begun:
            return None
        (answer,) = self.begun
        assert isinstance(answer, Ack | str)
        return answer

    def feed(self, messages: Sequence[Message]) -> None:
        """Deliver a message of the bus."""
        for message in messages:
            self.intake.take(TOPIC_OF[type(message)], message)

    def wait(self, seconds: float) -> None:
        """Let time pass, and let the record writer check."""
        self.now_s += seconds
        self.writer.take()

    def finish(
        self, last_seq: int | None, job: str = "j-1", epoch: int = EPOCH
    ) -> Recorded | str | None:
        """Request the end; returns None if the reply is still pending."""
        self.replies.clear()
        self.writer.finish(carried(Finish(job, epoch, last_seq)), self.replies.append)
        return self.reply

    def ended(self, last_seq: int | None, job: str = "j-1", epoch: int = EPOCH) -> Recorded | str:
        """Request the end of a record that is not open, and wait for the reply."""
        answers = SimpleQueue[Message | str]()
        self.writer.finish(carried(Finish(job, epoch, last_seq)), answers.put)
        answer = answers.get(timeout=60.0)
        assert isinstance(answer, Recorded | str)
        return answer

    @property
    def reply(self) -> Recorded | str | None:
        """Return the last reply to ``finish``."""
        if not self.replies:
            return None
        (reply,) = self.replies
        assert isinstance(reply, Recorded | str)
        return reply


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """Provide a record writer for an empty folder."""
    bench = Bench(tmp_path)
    yield bench
    bench.writer.close()
    bench.repairer.close()
