"""Foxglove WebSocket server of one rig: its topics, and an emergency stop over REST."""

import json
import logging
import os
import secrets
import ssl
from pathlib import Path
from time import time_ns
from typing import Any

from foxglove import Channel, Context, MessageSchema, Schema, Service, ServiceRequest, ServiceSchema
from foxglove import start_server as start
from foxglove.websocket import Capability, StatusLevel, WebSocketServer

from pincette.client import ClientError, Supervisor
from pincette.core.faults import Fault
from pincette.core.messages import Message
from pincette.core.topics import TOPICS, Topic, key
from pincette.core.wording import fault_text
from pincette.engine.program import Context as Started
from pincette.records.schemas import SCHEMAS
from pincette_foxglove.door import Door

log = logging.getLogger("pincette.foxglove")
KEY = "PINCETTE_KEY"
"""Environment variable with the key for the supervisor; the scope `observe` is sufficient."""
BACKLOG = 1024
"""Number of messages buffered for a slow viewer; the oldest are dropped."""
ESTOP = "estop"
REFUSED = "refused"
"""Identifier of the viewer status that reports rejected bus messages."""
SHOW_EVERY_S = 2.0
ANSWER = {
    "type": "object",
    "properties": {
        "stopped": {"type": "boolean", "description": "the actuator has confirmed it"},
        "detail": {"type": "string"},
    },
}


def run(context: Started) -> None:
    """Serve until the program is stopped."""
    settings, rig = context.rig.foxglove, context.rig.rig.name
    viewers = Context()
    channels = {topic.name: channel(rig, topic, viewers) for topic in TOPICS}

    def send(topic: Topic, message: Message) -> None:
        one = channels[topic.name]
        if one.has_sinks():  # without viewers nothing is encoded
            one.log(SCHEMAS[topic.name].pack(message), log_time=time_ns())

    bus = context.open_bus()
    server: WebSocketServer | None = None
    door: Door | None = None
    try:
        for topic in TOPICS:
            bus.subscribe(topic, send)
        # A web page cannot guess this loopback address, so it must connect through the door, which
        # checks its origin. Other clients may connect anyway.
        behind = f"127.{'.'.join(str(1 + secrets.randbelow(254)) for _ in range(3))}"
        server = start(
            name=f"pincette {rig}",
            host=behind,
            port=0,
            capabilities=[Capability.Services],
            supported_encodings=["json"],
            services=[estop_service(context)],
            context=viewers,
            message_backlog_size=BACKLOG,
        )
        place, proof = (settings.host, settings.port), certificate(settings.certificate)
        door = Door(place, (behind, server.port), settings.origins, proof)
        scheme = "ws" if proof is None else "wss"
        context.ready(f"Foxglove at {scheme}://{settings.host}:{settings.port}")
        while not context.stop.wait(SHOW_EVERY_S):
            show_refused(server, bus.refused.finding())
    finally:
        bus.close()
        if door is not None:
            door.close()
        if server is not None:
            server.stop()


def show_refused(server: WebSocketServer, finding: Fault | None) -> None:
    """Show viewers a status while messages of the bus are rejected, and clear it afterwards.

    Only connected viewers receive a status, so it is repeated for viewers that connect later.
    """
    if finding is None:
        server.remove_status([REFUSED])
        return
    server.publish_status(f"pincette: {fault_text(finding)}", StatusLevel.Warning, REFUSED)


def channel(rig: str, topic: Topic, viewers: Context) -> Channel:
    """Return the channel of a topic; name and schema are the same as in a record."""
    known = SCHEMAS[topic.name]
    return Channel(
        topic.name,
        schema=Schema(name=known.name, encoding="protobuf", data=known.descriptor),
        message_encoding="protobuf",
        metadata={"key": key(rig, topic), "summary": topic.summary},
        context=viewers,
    )


def certificate(name: str | None) -> ssl.SSLContext | None:
    """Return the server's certificate; the private key is in the same folder."""
    if name is None:
        return None
    proof = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    proof.load_cert_chain(name, Path(name).with_suffix(".key"))
    return proof


def estop_service(context: Started) -> Service:
    """Return the emergency stop, the only service for viewers. The supervisor executes it, as for
    all clients.
    """
    settings, pki = context.rig.foxglove, context.rig.bus.pki
    url = settings.supervisor or context.rig.supervisor.url
    authority = None if pki is None else Path(pki) / "authority.crt"
    rig = context.rig.rig.name

    def stop(_request: ServiceRequest) -> bytes:
        own_key = os.environ.get(KEY) or None
        try:
            with Supervisor(url, key=own_key, operator="foxglove", authority=authority) as found:
                done = found.patient(0.0).rig(rig).estop()
        except ClientError as error:
            log.error("emergency stop: %s", error)
            return answer(False, f"{error}; use `pincette estop`, or the switch of the amplifier")
        return answer(done.acknowledged, done.detail or done.cause)

    schema = ServiceSchema(
        "pincette.EmergencyStop",
        request=described("pincette.Nothing", {"type": "object"}),
        response=described("pincette.Stopped", ANSWER),
    )
    return Service(ESTOP, schema=schema, handler=stop)


def described(name: str, tree: dict[str, Any]) -> MessageSchema:
    """Return the JSON schema of a service's request or response, with its name."""
    data = json.dumps(tree).encode()
    return MessageSchema(
        encoding="json", schema=Schema(name=name, encoding="jsonschema", data=data)
    )


def answer(stopped: bool, detail: str) -> bytes:
    """Return the reply that the viewer shows."""
    return json.dumps({"stopped": stopped, "detail": detail}).encode()
