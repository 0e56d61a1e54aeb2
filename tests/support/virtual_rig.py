"""A simulated rig, its services and a recorder in one process and in virtual time, tick by tick."""

import threading
from collections.abc import Callable
from pathlib import Path
from time import monotonic, sleep
from unittest.mock import patch

from pincette.bus.protocol import BusError, RefusalError
from pincette.config import RigFile
from pincette.core.messages import (
    Applied,
    Finish,
    GroundTruth,
    Message,
    Record,
    SimCommand,
    Status,
    Telemetry,
)
from pincette.core.topics import (
    APPLIED,
    SIM_COMMAND,
    STATUS,
    TELEMETRY,
    TOPICS,
    Request,
    Topic,
)
from pincette.engine import composed
from pincette.engine.composed import ComposedLoop
from pincette.engine.instrument import Device
from pincette.engine.simulated import devices_on, serve_sim_commands
from pincette.sim.bench import Bench, open_bench
from pincette.sim.script.script import script_of
from pincette_recorder.config import configure
from pincette_recorder.intake import Intake
from pincette_recorder.record_writer import RecordWriter
from pincette_recorder.repairer import RecordRepairer
from pincette_recorder.wall_clock import WallClock
from tests.support.bytes_bus import BytesBus, carried

LATE_S = 0.1
"""Step of the recorder's time while a caller waits for its reply, in s."""
WAITS = 100


class VirtualRig:
    """The loop on a bus that accepts requests from any thread; time passes by ``tick``.

    ``bench`` replaces the simulated rig and its instruments, for example by an arm that keeps its
    state after these programs have ended.
    """

    def __init__(self, rig: RigFile, data: Path, bench: Bench | None = None) -> None:
        self.rig = rig
        self.now_s = 0.0
        self.turn = threading.RLock()
        """Lock that is held while the loop acts."""
        self.telemetry: list[Telemetry] = []
        self.applied: list[Applied] = []
        script = script_of(rig)

        def devices(rig_file: RigFile, publish: Callable[[GroundTruth], None]) -> dict[str, Device]:
            at = bench or open_bench(rig_file, lambda: 0.0, publish, script)
            return devices_on(at, rig_file)

        with (
            patch.object(composed, "simulated_devices", devices),
            patch.object(composed, "MemoryBus", BytesBus),
        ):
            self.bus = ComposedLoop(rig).bus
        serve_sim_commands(self.bus, script)
        for topic in (TELEMETRY, APPLIED):
            self.bus.subscribe(topic, self._hear)
        self._late_s = 0.0
        self._intake = Intake(self._now_ns)
        self._config = configure(rig, data)
        self.writer, self._repairer = self._recorder()
        for topic in TOPICS:
            self.bus.subscribe(topic, self._intake.take)
        self.bus.serve(STATUS["recorder"], self._recorder_status)

    def _recorder(self) -> tuple[RecordWriter, RecordRepairer]:
        """Start a recorder, which checks the newest records."""
        repairer = RecordRepairer(self._config)
        repairer.check_newest().result()
        wall = WallClock(self._now_ns, self._now_ns)
        return RecordWriter(self._config, self._intake, wall, repairer, self._recorder_s), repairer

    def restart_recorder(self) -> None:
        """End the recorder, and start another one."""
        with self.turn:
            self.writer.close()
            self._repairer.close()
            self.writer, self._repairer = self._recorder()

    def sync_record(self) -> None:
        """Let the recorder close its chunk, and wait until it is on the disk."""
        record = self.writer.record
        assert record is not None
        with self.turn:
            record.file.flush()
            record.flush_aged(0)
        deadline_s = monotonic() + 30.0
        while record.unsynced_s > 0.0:
            assert monotonic() < deadline_s
            sleep(0.01)

    def _hear(self, _topic: Topic, said: Message) -> None:
        if isinstance(said, Telemetry):
            self.telemetry.append(said)
        elif isinstance(said, Applied):
            self.applied.append(said)

    def _recorder_s(self) -> float:
        return self.now_s + self._late_s

    def _now_ns(self) -> int:
        return round(self._recorder_s() * 1e9)

    def _recorder_status(
        self, _question: Request, _request: Message, reply: Callable[[Message | str], None]
    ) -> None:
        reply(Status("recorder", "", 1, self.rig.digest(), 0, 0, 0, 0))

    def tick(self) -> None:
        """Let one period pass: of the loop, if it plays, and of all clocks."""
        with self.turn:
            ticks = len(self.applied)
            while len(self.applied) == ticks and self.bus.pump():
                pass
            self.now_s += self.rig.rig.period_s
            self.writer.take()

    def call(self, question: Request, request: Message) -> Message:
        """Send a request, from any thread; the recorder takes the time that it needs."""
        with self.turn:
            if isinstance(request, Record | Finish):
                return self._recorded(carried(request))
            return self.bus.call(question, request)

    def _recorded(self, request: Record | Finish) -> Message:
        replies: list[Message | str] = []
        if isinstance(request, Record):
            self.writer.begin(request, replies.append)
        else:
            self.writer.finish(request, replies.append)
        for _ in range(WAITS):
            if replies:
                break
            self._late_s += LATE_S
            self.writer.take()
        if not replies:
            raise BusError("the recorder does not answer")
        if isinstance(replies[0], str):
            raise RefusalError(replies[0])
        return carried(replies[0])

    def order(self, target: str, what: str, value: float | None, for_s: float | None) -> None:
        """Disturb the rig."""
        self.call(SIM_COMMAND, SimCommand(target, what, value, 0.0, for_s))

    def close(self) -> None:
        """Close the record that is open."""
        self.writer.close()
        self._repairer.close()
