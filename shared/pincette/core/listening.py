"""Opens ports to listen at, and says in one line why one cannot be opened, with the remedy."""

import errno
import socket

FIRST_OPEN_PORT = 1024
"""Ports below need rights that an ordinary account does not have."""
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
        return f"{place} is in use; stop the other program, or choose another port"
    if error.errno == errno.EAFNOSUPPORT:
        return f"{place} cannot be had: {NO_IPV6}"
    if error.errno == errno.EADDRNOTAVAIL:
        if ":" in host and not has_ipv6():
            return f"{place} cannot be had: {NO_IPV6}"
        return f"{place} cannot be had: no interface of this machine has the address {host}"
    if error.errno in (errno.EACCES, errno.EPERM) and port < FIRST_OPEN_PORT:
        return (
            f"{place} is not permitted to this account: choose a port from {FIRST_OPEN_PORT} on, "
            "or grant CAP_NET_BIND_SERVICE"
        )
    if isinstance(error, socket.gaierror):
        return f"{place} cannot be had: no address is known for the name {host}"
    return f"{place} cannot be had: {error.strerror or error}"


def has_ipv6() -> bool:
    """Return whether a program can listen at the loopback address of IPv6."""
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True
