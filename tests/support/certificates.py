"""Folders of certificates for rigs of the tests, and intruders of several kinds."""

import json
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import zenoh

from pincette.bus.settings import settings
from pincette.bus.topology import SessionConfig, TlsIdentity, secured
from pincette.config import RigFile
from pincette.core.codec import encode
from pincette.core.messages import Message
from pincette.core.topics import Request, request_key
from pincette.security.establishing import establish
from pincette.security.folder import Folder
from pincette.security.identity import Credentials, Identity

NOW = datetime.now(UTC)
DAYS = 60.0
OPEN_MS = 800
ASK_S = 0.5


def folder_for(place: Path, *rigs: str, days: float = DAYS) -> Folder:
    """Make a folder of certificates for some rigs on this machine."""
    folder = Folder(place)
    establish(folder, rigs, (), NOW, days)
    return folder


def seen_as(rig: RigFile, name: str) -> RigFile:
    """Return a rig file whose tools use the certificate of a person."""
    return rig.model_copy(update={"bus": rig.bus.model_copy(update={"identity": name})})


@dataclass(frozen=True)
class Intruder:
    """A client that tries to join the bus, with or without files that prove its identity."""

    name: str
    credentials: Credentials | None
    protocol: str = "tls"
    mode: str = "client"

    @contextmanager
    def joined(self, host: str, port: int) -> Generator["zenoh.Session"]:
        """Open a session at one node; raises ZError if it is not admitted."""
        ends = SessionConfig(self.mode, connect=(f"tcp/{host}:{port}",))
        if self.credentials is not None:
            ends = secured(ends, TlsIdentity(self.credentials, {}))
        tree: dict[str, Any] = settings(ends, self.name)
        tree.pop("access_control", None)
        tree["connect"] |= {
            "endpoints": [f"{self.protocol}/{host}:{port}"],
            "timeout_ms": OPEN_MS,
            "exit_on_failure": True,
        }
        with zenoh.open(zenoh.Config.from_json5(json.dumps(tree))) as session:
            yield session


def stranger(place: Path, rig: str, like: Identity) -> Intruder:
    """Return a client whose certificate has the right name, and is signed by its own authority."""
    return Intruder("stranger", folder_for(place, rig).credentials(like))


def ask(session: "zenoh.Session", rig: str, question: Request, request: Message) -> list[str]:
    """Return the replies to a query, refusals included; empty if no program replies."""
    replies = session.get(request_key(rig, question), payload=encode(request), timeout=ASK_S)
    return [_words(reply) for reply in cast(Iterable[Any], replies) if not _timed_out(reply)]


def _words(reply: Any) -> str:
    part = reply.ok if reply.ok is not None else reply.err
    return str(part.payload.to_bytes())


def _timed_out(reply: Any) -> bool:
    return reply.ok is None and reply.err.payload.to_bytes() == b"Timeout"
