"""Viewer of the Foxglove protocol, as implemented by viewers in laboratories."""

import base64
import json
import struct
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from pincette.config import RigFile

SPOKEN = Subprotocol("foxglove.sdk.v1")
MESSAGE, CALL, ANSWER = 1, 2, 3
"""Opcodes of binary frames."""
WAIT_S = 30.0


class Viewer:
    """Channels and services advertised to a viewer, and the messages of its subscriptions."""

    def __init__(self, line: ClientConnection) -> None:
        self._line = line
        self.server: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, int] = {}
        self.statuses: dict[str, dict[str, Any]] = {}
        self.seen: dict[str, list[Any]] = {}
        self.answers: list[dict[str, Any]] = []
        self._kinds: dict[int, tuple[str, Any]] = {}

    def until(self, there: Any, what: str) -> None:
        """Read frames until a condition holds."""
        deadline = monotonic() + WAIT_S
        while not there():
            assert monotonic() < deadline, what
            try:
                self._take(self._line.recv(timeout=0.2))
            except TimeoutError:
                continue

    def subscribe(self, *topics: str) -> None:
        """Subscribe to topics.

        Their messages are decoded by the schemas that the server has sent.
        """
        self.until(lambda: self.channels.keys() >= set(topics), "a topic is not advertised")
        requests: list[dict[str, int]] = []
        for number, topic in enumerate(topics):
            channel = self.channels[topic]
            pool = descriptor_pool.DescriptorPool()
            files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
            for file in files.file:
                pool.Add(file)
            kind = pool.FindMessageTypeByName(channel["schemaName"])
            self.seen.setdefault(topic, [])
            self._kinds[number] = topic, message_factory.GetMessageClass(kind)
            requests.append({"id": number, "channelId": channel["id"]})
        self._line.send(json.dumps({"op": "subscribe", "subscriptions": requests}))

    def call(self, service: str) -> None:
        """Call a service with an empty object."""
        self.until(lambda: service in self.services, "the service is not advertised")
        encoding = b"json"
        head = struct.pack("<BIII", CALL, self.services[service], 7, len(encoding))
        self._line.send(head + encoding + b"{}")

    def _take(self, frame: str | bytes) -> None:
        if isinstance(frame, bytes):
            if frame[0] == MESSAGE:
                number, _ = struct.unpack_from("<IQ", frame, 1)
                topic, kind = self._kinds[number]
                self.seen[topic].append(kind.FromString(frame[13:]))
            elif frame[0] == ANSWER:
                _, _, length = struct.unpack_from("<III", frame, 1)
                self.answers.append(json.loads(frame[13 + length :]))
            return
        content = json.loads(frame)
        if content["op"] == "serverInfo":
            self.server = content
        elif content["op"] == "advertise":
            self.channels |= {one["topic"]: one for one in content["channels"]}
        elif content["op"] == "advertiseServices":
            self.services |= {one["name"]: one["id"] for one in content["services"]}
        elif content["op"] == "status":
            self.statuses[content["id"]] = content
        elif content["op"] == "removeStatus":
            for name in content["statusIds"]:
                self.statuses.pop(name, None)


@contextmanager
def viewing(rig: RigFile) -> Generator[Viewer]:
    """Provide a viewer of a rig that has received the advertisements."""
    address = f"ws://127.0.0.1:{rig.foxglove.port}"
    with connect(address, subprotocols=[SPOKEN], max_size=None) as line:
        one = Viewer(line)
        one.until(lambda: one.server and one.channels and one.services, "nothing is advertised")
        yield one
