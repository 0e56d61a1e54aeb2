"""Opens listening ports; if one cannot be opened, gives the reason and the remedy in one line."""

import errno
import pwd
import socket
import sys
from pathlib import Path

FIRST_OPEN_PORT = 1024
"""First port that an account without privileges may open."""
LISTENS = "0A"
"""State of a listening socket in the kernel's tables."""
NO_IPV6 = "this machine has no IPv6: use an IPv4 address such as 127.0.0.1, or turn IPv6 on"


def bound(host: str, port: int) -> socket.socket:
    """Return a socket that is bound to a port and does not listen yet.

    Raises OSError with the reason and the remedy as its text.
    """
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        opened = socket.socket(family, socket.SOCK_STREAM)
        try:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            opened.bind((host, port))
        except BaseException:
            opened.close()
            raise
    except OSError as error:
        raise OSError(error.errno, why_not(host, port, error)) from error
    return opened


def why_not(host: str, port: int, error: OSError) -> str:
    """Return why a program cannot listen at a port, and what to do."""
    place = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    if error.errno == errno.EADDRINUSE:
        owner = listener_uid(host, port)
        whose = "" if owner is None else f" of account {account_name(owner)}"
        return f"{place} is in use; stop the other program{whose}, or choose another port"
    if error.errno == errno.EAFNOSUPPORT:
        return f"{place} cannot be used: {NO_IPV6}"
    if error.errno == errno.EADDRNOTAVAIL:
        if ":" in host and not has_ipv6():
            return f"{place} cannot be used: {NO_IPV6}"
        return f"{place} cannot be used: no interface of this machine has the address {host}"
    if error.errno in (errno.EACCES, errno.EPERM) and port < FIRST_OPEN_PORT:
        return (
            f"{place} is not permitted to this account: choose a port from {FIRST_OPEN_PORT} on, "
            "or grant CAP_NET_BIND_SERVICE"
        )
    if isinstance(error, socket.gaierror):
        return f"{place} cannot be used: no address is known for the name {host}"
    return f"{place} cannot be used: {error.strerror or error}"


def listener_uid(host: str, port: int) -> int | None:
    """Return the account (user id) of the program that listens at a port of this machine.

    Return None if nothing listens there, if the host is a name, or if the system does not provide
    this information.
    """
    tables = {socket.AF_INET: "/proc/net/tcp", socket.AF_INET6: "/proc/net/tcp6"}
    wanted: set[str] = set()
    for family in tables:
        try:
            address = socket.inet_pton(family, host)
        except OSError:
            continue
        wanted |= {_as_listed(address), _as_listed(bytes(len(address)))}
        if family == socket.AF_INET:  # sockets listening at :: also accept IPv4 connections
            wanted |= {_as_listed(bytes(10) + b"\xff\xff" + address), _as_listed(bytes(16))}
    for table in tables.values():
        try:
            lines = Path(table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            at, _, number = fields[1].partition(":")
            if fields[3] == LISTENS and int(number, 16) == port and at in wanted:
                return int(fields[7])
    return None


def _as_listed(address: bytes) -> str:
    """Return an address in the form of the kernel's tables: words in the machine's byte order."""
    words = [address[first : first + 4] for first in range(0, len(address), 4)]
    return "".join(f"{int.from_bytes(word, sys.byteorder):08X}" for word in words)


def account_name(uid: int) -> str:
    """Return the name of an account, or its number if the system knows no name."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def has_ipv6() -> bool:
    """Return whether a program can listen at the IPv6 loopback address."""
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True
