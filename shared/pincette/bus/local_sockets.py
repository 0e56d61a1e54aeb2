"""Programs of one rig and one account may meet at local sockets, past their guards.

The sockets are in a folder that only this account may open. Links with certificates stay on TLS,
which their access lists go by; so do links to other machines and to programs started apart.
"""

import logging
import os
import stat
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from ipaddress import ip_address
from pathlib import Path

from pincette.bus.topology import SessionConfig, address_of
from pincette.core.files import temporary_folder

log = logging.getLogger("pincette")
VARIABLE = "PINCETTE_SOCKETS"
"""Environment variable: the folder, which is made by whoever starts the programs."""
LOCAL = "unixsock-stream/"
LONGEST = 90
"""Characters of a folder's path; the kernel takes 107 for that of a socket."""
OTHERS = stat.S_IRWXG | stat.S_IRWXO


@contextmanager
def named_to_programs() -> Generator[str]:
    """Make a folder, and name it to whoever is started within; it is removed at the end."""
    with temporary_folder() as folder:
        before = os.environ.get(VARIABLE)
        os.environ[VARIABLE] = str(folder)
        try:
            yield str(folder)
        finally:
            if before is None:
                del os.environ[VARIABLE]
            else:
                os.environ[VARIABLE] = before


def socket_folder() -> Path | None:
    """Where the sockets are; None where there is no folder, or one that others may open."""
    named = os.environ.get(VARIABLE)
    if not named:
        return None
    folder = Path(named)
    try:
        found = folder.stat()
    except OSError as error:
        log.warning("%s = %s: %s; its links go over TCP", VARIABLE, folder, error.strerror)
        return None
    if found.st_uid != os.geteuid() or found.st_mode & OTHERS or len(named) > LONGEST:
        log.warning(
            "%s = %s: wanted a folder of this account with mode 0700, and a path of at most %d "
            "characters; its links go over TCP",
            VARIABLE,
            folder,
            LONGEST,
        )
        return None
    return folder.absolute()


def by_socket(config: SessionConfig) -> tuple[SessionConfig, tuple[str, ...]]:
    """The session with its near links at their sockets, and the sockets at which it listens."""
    if config.tls is not None or (folder := socket_folder()) is None:
        return config, ()
    connect = tuple(
        _socket(folder, place) if place in config.near and _on_loopback(place) else place
        for place in config.connect
    )
    listens = tuple(_socket(folder, place) for place in config.listen)
    return replace(config, connect=connect), listens


def missing_socket(config: SessionConfig, place: str) -> str:
    """Why a program that is met at its socket only cannot be met; else empty."""
    folder = None if config.tls else socket_folder()
    if folder is None or place not in config.near or not _on_loopback(place):
        return ""
    path = Path(_socket(folder, place).removeprefix(LOCAL))
    return "" if path.exists() else f"no socket {path}: not started, or without {VARIABLE}"


def _socket(folder: Path, place: str) -> str:
    return f"{LOCAL}{folder}/{address_of(place)[1]}.sock"


def _on_loopback(place: str) -> bool:
    host, _ = address_of(place)
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
