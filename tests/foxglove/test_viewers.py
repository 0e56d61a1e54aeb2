"""A client of the Foxglove protocol sees a grip as its record has it, and stops the rig."""

import base64
import json
import struct
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from pincette.config.reading import laid_over
from tests.support.grips import SHORT
from tests.support.rigs import free_ports, paced_rig
from tests.support.running import RunningRig, running_rig

SPOKEN = Subprotocol("foxglove.sdk.v1")
MESSAGE, CALL, ANSWER = 1, 2, 3
"""Opcodes of binary frames."""
WAIT_S = 30.0
FORCE_MN = 9.0


class Viewer:
    """What is advertised to a viewer, and what it sees of what it has subscribed to."""

    def __init__(self, line: ClientConnection) -> None:
        self._line = line
        self.server: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, int] = {}
        self.seen: dict[str, list[Any]] = {}
        self.answers: list[dict[str, Any]] = []
        self._kinds: dict[int, tuple[str, Any]] = {}

    def until(self, there: Any, what: str) -> None:
        """Read frames until something is the case."""
        deadline = monotonic() + WAIT_S
        while not there():
            assert monotonic() < deadline, what
            try:
                self._take(self._line.recv(timeout=0.2))
            except TimeoutError:
                continue

    def subscribe(self, *topics: str) -> None:
        """Ask for topics, whose messages are read by the schemas that the server has sent."""
        asked: list[dict[str, int]] = []
        for number, topic in enumerate(topics):
            channel = self.channels[topic]
            pool = descriptor_pool.DescriptorPool()
            files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
            for file in files.file:
                pool.Add(file)
            kind = pool.FindMessageTypeByName(channel["schemaName"])
            self._kinds[number] = topic, message_factory.GetMessageClass(kind)
            asked.append({"id": number, "channelId": channel["id"]})
        self._line.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def call(self, service: str) -> None:
        """Call a service with an empty object."""
        encoding = b"json"
        head = struct.pack("<BIII", CALL, self.services[service], 7, len(encoding))
        self._line.send(head + encoding + b"{}")

    def _take(self, frame: str | bytes) -> None:
        if isinstance(frame, bytes):
            if frame[0] == MESSAGE:
                number, _ = struct.unpack_from("<IQ", frame, 1)
                topic, kind = self._kinds[number]
                self.seen.setdefault(topic, []).append(kind.FromString(frame[13:]))
            elif frame[0] == ANSWER:
                _, _, length = struct.unpack_from("<III", frame, 1)
                self.answers.append(json.loads(frame[13 + length :]))
            return
        told = json.loads(frame)
        if told["op"] == "serverInfo":
            self.server = told
        elif told["op"] == "advertise":
            self.channels |= {one["topic"]: one for one in told["channels"]}
        elif told["op"] == "advertiseServices":
            self.services |= {one["name"]: one["id"] for one in told["services"]}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    own = {"foxglove": {"port": free_ports(1)}}
    with running_rig(
        paced_rig(laid_over(SHORT, own)), tmp_path_factory.mktemp("foxglove")
    ) as running:
        running.fleet.start(["foxglove"])
        yield running


@contextmanager
def viewing(rig: RunningRig) -> Generator[Viewer]:
    address = f"ws://127.0.0.1:{rig.rig.foxglove.port}"
    with connect(address, subprotocols=[SPOKEN], max_size=None) as line:
        one = Viewer(line)
        one.until(lambda: one.server and one.channels and one.services, "nothing is advertised")
        yield one


def test_a_grip_is_seen_as_its_record_has_it(rig: RunningRig) -> None:
    with viewing(rig) as viewer:
        assert viewer.server["name"] == "pincette demo"
        viewer.subscribe("estimate", "telemetry", "applied", "job")
        job = rig.start_grip(force_mN=FORCE_MN)
        viewer.until(
            lambda: any(one.state == "succeeded" for one in viewer.seen.get("job", [])), "no end"
        )
        seen = viewer.seen
    record = Path(rig.ended(job)["record"]) / "job.mcap"
    with record.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = summary.schemas
    kept = {one.topic: schemas[one.schema_id] for one in summary.channels.values()}
    for topic, channel in viewer.channels.items():
        there = kept[topic]
        assert channel["schemaName"] == there.name
        assert base64.b64decode(channel["schema"]) == there.data
        assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
    phases = {one.phase for one in seen["telemetry"]}
    assert {"approach", "load", "hold"} <= phases
    assert max(one.force_mN for one in seen["estimate"] if one.valid) == pytest.approx(
        FORCE_MN, abs=1.5
    )
    numbers = [one.seq for one in seen["estimate"]]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_who_speaks_an_older_protocol_is_refused(rig: RunningRig) -> None:
    address = f"ws://127.0.0.1:{rig.rig.foxglove.port}"
    with (
        pytest.raises(Exception, match="400"),
        connect(address, subprotocols=[Subprotocol("foxglove.websocket.v1")]),
    ):
        pass


def test_the_emergency_stop_stops_and_says_so(rig: RunningRig) -> None:
    with viewing(rig) as viewer:
        job = rig.start_grip(until_released=True)
        rig.until_phase(job, "approach")
        viewer.call("estop")
        viewer.until(lambda: viewer.answers, "no answer")
    (answer,) = viewer.answers
    assert answer["stopped"] is True
    ended = rig.ended(job)
    assert ended["ending"]["code"] == "tripped", ended["cause"]
    assert rig.view()["latch"]["cause"] == "estop"
    rig.post("/rigs/demo/reset", {"acknowledge": True}).raise_for_status()
