"""The AsyncAPI document of the bus: ``python -m pincette.asyncapi.document FILE``.

The document describes the bus from the rig's side: the rig sends samples and receives requests.
"""

import json
import sys
from functools import cache
from pathlib import Path

from pincette import __version__
from pincette.asyncapi.schemas import Json, reachable, record_schema, summary
from pincette.config.programs import Bus
from pincette.core.codec.wire import ENCODING, MEDIA_TYPE
from pincette.core.topics import (
    INPUTS,
    LOOP,
    REQUESTS,
    TOPICS,
    WIRE,
    Request,
    Topic,
    key,
    live_key,
    request_key,
)

ASYNCAPI = "3.0.0"
ABOUT = (
    "Messages that the programs of a rig publish, and requests that they answer, over "
    "Zenoh. A payload is one MessagePack map that has every required field of its schema, "
    "by name, and no unknown one; nil stands for null. Units are in the names: µm, mN, V, "
    "s. Forces are compressive and positive. Everything derived from sample k carries its "
    f"`seq` and the `epoch` of the arming. Zenoh's encoding of a payload is `{ENCODING}`."
)
PARAMETERS: Json = {
    "rig": {"description": "Name of the rig, as in its rig file.", "examples": ["demo"]},
    "program": {"description": "Name of the program.", "examples": ["sensor"]},
    "service": {"description": "Name of a service of the loop.", "examples": list(LOOP)},
}
QUERY: Json = {
    "name": "Query",
    "summary": "A Zenoh query without a payload, on the key of the topic.",
    "payload": {"type": "null"},
}
REFUSAL: Json = {
    "name": "Refusal",
    "summary": "An error reply of Zenoh: the reason of the refusal.",
    "contentType": "text/plain",
    "payload": {"type": "string"},
}


@cache
def document() -> str:
    """Return the document as text."""
    return json.dumps(tree(), indent=2, ensure_ascii=False) + "\n"


def tree() -> Json:
    """Return the document as data."""
    kinds = [topic.message for topic in (*TOPICS, *INPUTS)]
    kinds += [kind for item in REQUESTS for kind in (item.request, item.reply)]
    messages = {kind.__name__: _message(kind) for kind in kinds}
    channels = {topic.name: _topic(topic) for topic in (*TOPICS, *INPUTS)}
    channels |= {_name(item): _request(item) for item in REQUESTS}
    operations = {f"send_{topic.name}": _send(topic) for topic in TOPICS}
    operations |= {f"latest_{topic.name}": _latest(topic) for topic in TOPICS}
    operations |= {f"receive_{topic.name}": _receive(topic) for topic in INPUTS}
    operations |= {_name(item): _answer(item) for item in REQUESTS}
    return {
        "asyncapi": ASYNCAPI,
        "info": {
            "title": "pincette: keys and messages",
            "version": __version__,
            "description": ABOUT,
            "license": {"name": "Apache-2.0"},
            "x-pincette-wire": f"v{WIRE}",
        },
        "defaultContentType": MEDIA_TYPE,
        "servers": {"router": _router()},
        "channels": channels | {"live": _live()},
        "operations": operations,
        "components": {
            "messages": messages | {"Query": QUERY, "Refusal": REFUSAL},
            "schemas": {kind.__name__: record_schema(kind) for kind in reachable(kinds)},
            "parameters": PARAMETERS,
        },
    }


def _router() -> Json:
    bus = Bus()
    return {
        "host": "{host}:{port}",
        "protocol": "zenoh",
        "description": (
            "The rig's router, for tools, in addition to the loop's direct links; a tool "
            "connects to it as a client."
        ),
        "variables": {"host": {"default": bus.host}, "port": {"default": str(bus.port)}},
    }


def _message(kind: type) -> Json:
    name = kind.__name__
    payload = {"$ref": f"#/components/schemas/{name}"}
    return {"name": name, "summary": summary(kind), "payload": payload}


def _name(request: Request) -> str:
    return f"{request.service}_{request.name}"


def _reference(*path: str) -> Json:
    return {"$ref": "#/" + "/".join(path)}


def _parameters(*names: str) -> Json:
    return {name: _reference("components", "parameters", name) for name in names}


def _messages(**messages: str) -> Json:
    """Return the messages of a channel."""
    return {role: _reference("components", "messages", name) for role, name in messages.items()}


def _topic(topic: Topic) -> Json:
    often = "every tick" if topic.per_tick else "on change"
    text = f"From `{topic.producer}`, {often}; dropped where a link stalls, except in lockstep."
    messages = {"sample": topic.message.__name__, "query": "Query"}
    if topic in INPUTS:
        text = f"From {topic.producer}, to the supervisor; at most {topic.rate_hz:g} a second."
        del messages["query"]
    return {
        "address": key("{rig}", topic, "{service}"),
        "summary": topic.summary,
        "description": text,
        "parameters": _parameters("rig", *(("service",) if topic.per_service else ())),
        "messages": _messages(**messages),
    }


def _request(request: Request) -> Json:
    return {
        "address": request_key("{rig}", request),
        "summary": request.summary,
        "description": f"A Zenoh query that `{request.service}` answers.",
        "parameters": _parameters("rig"),
        "messages": _messages(
            request=request.request.__name__, reply=request.reply.__name__, refusal="Refusal"
        ),
    }


def _live() -> Json:
    return {
        "address": live_key("{rig}", "{program}"),
        "summary": "which programs run",
        "description": "No message: a Zenoh liveliness token that a program holds while it runs. "
        "A program that hangs keeps its token.",
        "parameters": _parameters("rig", "program"),
    }


def _operation(action: str, channel: str, text: str, *roles: str) -> Json:
    place = _reference("channels", channel)
    messages = [_reference("channels", channel, "messages", role) for role in roles]
    return {"action": action, "channel": place, "summary": text, "messages": messages}


def _reply(channel: str, *roles: str) -> Json:
    messages = [_reference("channels", channel, "messages", role) for role in roles]
    return {"channel": _reference("channels", channel), "messages": messages}


def _send(topic: Topic) -> Json:
    return _operation("send", topic.name, topic.summary, "sample")


def _latest(topic: Topic) -> Json:
    text = f"the newest message of {topic.name}; no reply before the first"
    operation = _operation("receive", topic.name, text, "query")
    return operation | {"reply": _reply(topic.name, "sample")}


def _receive(topic: Topic) -> Json:
    return _operation("receive", topic.name, topic.summary, "sample")


def _answer(request: Request) -> Json:
    name = _name(request)
    operation = _operation("receive", name, request.summary, "request")
    return operation | {"reply": _reply(name, "reply", "refusal")}


def main() -> None:
    """Write the document to the file on the command line."""
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")


if __name__ == "__main__":
    main()
