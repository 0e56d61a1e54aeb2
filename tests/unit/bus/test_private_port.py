"""Zenoh's sockets are found among all descriptors of a process, without any side effect."""

import fcntl
import socket
import subprocess
import sys
from pathlib import Path

from pincette.bus.own_sockets import let_go_at_once, own_sockets
from pincette.bus.private_port import PrivatePort

OTHER = """
import fcntl, sys
with open(sys.argv[1], "r+b") as file:
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        sys.exit(3)
"""
"""Script of another program that requests a lock which this one has, as SQLite does at its end."""


def test_listing_the_sockets_releases_no_file_lock(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(b"rows")
    with path.open("r+b") as file, socket.create_server(("127.0.0.1", 0)):
        fcntl.lockf(file, fcntl.LOCK_SH)
        let_go_at_once()
        assert not PrivatePort("127.0.0.9", 9, b"key").sign_listener()
        done = subprocess.run([sys.executable, "-c", OTHER, str(path)], check=False)
        assert done.returncode == 3


def test_listing_the_own_sockets_leaves_each_socket_open() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        with socket.create_connection(server.getsockname()) as line:
            numbers = {found.fileno() for found in own_sockets()}
            assert {server.fileno(), line.fileno()} <= numbers
            line.sendall(b"open")
        accepted, _ = server.accept()
        with accepted:
            assert accepted.recv(4) == b"open"
