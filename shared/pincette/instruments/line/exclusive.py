"""Locks that allow one program at a time to open an instrument, with the name of the holder.

A serial port is locked by ``flock`` on the device, as pyserial's ``exclusive`` does, and by the
older UUCP convention, a file ``/var/lock/LCK..NAME``, which is all that ser2net respects. A TCP
instrument has no file, so its lock is an abstract Unix socket named after its address: the system
frees it when the program ends, however it ends. All of these work between the programs of one host.
"""

import errno
import os
import socket
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from ipaddress import ip_address
from pathlib import Path

from pincette.instruments.protocols import InstrumentError

UUCP_LOCKS = Path("/var/lock")
PROCESSES = Path("/proc")
BINARY = 4
"""Length of a UUCP lock file that contains a process id as a number, in bytes."""
LISTENING = "0A"
"""State of a listening TCP socket in the system's tables."""
LONGEST = 256
"""Largest number of bytes that are read of a UUCP lock file."""


@contextmanager
def uucp_lock(url: str) -> Generator[None]:
    """Hold the UUCP lock files of a serial port within the block.

    A file whose program has ended is replaced. If this user may not write in that folder, no file
    is made; ``flock`` still excludes other programs of pincette.

    Raises
    ------
    InstrumentError
        If another live program holds a file.
    """
    files = {_lock_file(url), _lock_file(str(Path(url).resolve()))}
    with ExitStack() as made:
        for file in sorted(files):
            holder = _holder_of_file(file)
            if holder is not None and holder != os.getpid():
                named = f"{_command_of(holder)}, as the lock file {file} states"
                raise in_use(url, named)
            if holder is None and _was_made(file):
                made.callback(file.unlink, missing_ok=True)
        yield


def _lock_file(device: str) -> Path:
    """Return the lock file of a device as ser2net names it, without following links."""
    return UUCP_LOCKS / f"LCK..{device.removeprefix('/dev/').replace('/', '_')}"


def _was_made(file: Path) -> bool:
    """Make a lock file, replacing one without a holder; return whether that was possible."""
    try:
        file.unlink(missing_ok=True)
        with file.open("x", encoding="ascii") as written:
            written.write(f"{os.getpid():>10}\n")
    except OSError:
        return False
    return True


def _holder_of_file(lock: Path) -> int | None:
    """Return the process id of the live program that holds a UUCP lock file; None without one."""
    try:
        pid = _number_in(_begin_of(lock))
    except (OSError, ValueError):
        return None
    return pid if pid > 0 and (PROCESSES / str(pid)).exists() else None


def _begin_of(lock: Path) -> bytes:
    """Return the first bytes of a lock file; does not block if the file is a pipe."""
    descriptor = os.open(lock, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        return os.read(descriptor, LONGEST)
    finally:
        os.close(descriptor)


def _number_in(content: bytes) -> int:
    """Return the process id in a lock file; raises ValueError if it contains none.

    Most programs write digits, some followed by program name and user, as minicom does. Some write
    a binary number.
    """
    words = content.split(maxsplit=1)
    if words and words[0].isdigit():
        return int(words[0])
    if len(content) == BINARY:
        return int.from_bytes(content, sys.byteorder)
    raise ValueError


def lock_address(url: str, host: str, port: int) -> ExitStack:
    """Lock a TCP instrument under every address that its host name resolves to.

    A server on this host that listens at all addresses is one instrument, whichever address is
    used.

    Returns
    -------
    ExitStack
        Frees the lock when it is closed.

    Raises
    ------
    InstrumentError
        If another program of this host has the instrument.
    OSError
        If the host name cannot be resolved.
    """
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    with ExitStack() as locks:
        addresses = {_plain(str(entry[4][0])) for entry in found}
        for address in sorted({name for one in addresses for name in (one, _served(one, port))}):
            name = f"pincette-instrument {address} {port}"
            lock = locks.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            try:
                lock.bind(f"\0{name}")
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                raise in_use(url, _holder_of_abstract_socket(name)) from error
        return locks.pop_all()


def _plain(address: str) -> str:
    """Return an IPv4-mapped IPv6 address as IPv4, and other addresses unchanged."""
    mapped = getattr(ip_address(address), "ipv4_mapped", None)
    return address if mapped is None else str(mapped)


def _served(address: str, port: int) -> str:
    """Return ``any`` if a server of this host listens at all addresses, otherwise the address."""
    plain, _, _ = address.partition("%")
    version = ip_address(plain).version
    with socket.socket(socket.AF_INET if version == 4 else socket.AF_INET6) as probe:
        try:
            probe.bind((address, 0))
        except OSError:
            return address  # address of another host
    listening = set[str]()
    for table in ("tcp", "tcp6"):
        with suppress(OSError):
            rows = (PROCESSES / "net" / table).read_text(encoding="ascii").splitlines()[1:]
            fields = (row.split() for row in rows)
            listening |= {place for _, place, _, state, *_ in fields if state == LISTENING}
    packed = ip_address(plain).packed
    words = (packed[first : first + 4] for first in range(0, len(packed), 4))
    own = "".join(f"{int.from_bytes(word, sys.byteorder):08X}" for word in words)
    alone = f"{own}:{port:04X}" in listening
    everywhere = {f"{'0' * digits}:{port:04X}" for digits in (8, 32)} & listening
    return "any" if everywhere and not alone else address


def device_in_use(url: str) -> InstrumentError:
    """Return the error for a serial port that another program has locked."""
    return in_use(url, _holder_of_flock(Path(url)))


def in_use(url: str, holder: str) -> InstrumentError:
    """Return the error for an instrument that the named program has opened."""
    text = (
        f"{url}: in use by {holder or 'another program'}; one program at a time may open an "
        "instrument: stop that program first, or use its rig instead"
    )
    return InstrumentError(text, "cannot_open")


def _holder_of_flock(path: Path) -> str:
    """Return the program that has locked a file; empty if the system does not show it."""
    with suppress(OSError):
        found = path.stat()
        device = f"{os.major(found.st_dev):02x}:{os.minor(found.st_dev):02x}:{found.st_ino}"
        for line in (PROCESSES / "locks").read_text(encoding="ascii").splitlines():
            kind, pid, place = (line.split()[field] for field in (1, 4, 5))
            if kind == "FLOCK" and place == device:
                return _command_of(int(pid))
    return ""


def _holder_of_abstract_socket(name: str) -> str:
    """Return the program that has bound a socket; empty if this user may not see it."""
    with suppress(OSError):
        for line in (PROCESSES / "net" / "unix").read_text(encoding="utf-8").splitlines():
            fields = line.split(maxsplit=7)
            if fields[-1] != f"@{name}":
                continue
            for descriptor in PROCESSES.glob("[0-9]*/fd/*"):
                with suppress(OSError):
                    if str(descriptor.readlink()) == f"socket:[{fields[6]}]":
                        return _command_of(int(descriptor.parts[-3]))
    return ""


def _command_of(pid: int) -> str:
    """Return process id and command line of a program."""
    try:
        line = (PROCESSES / str(pid) / "cmdline").read_bytes()
    except OSError:
        return f"process {pid}"
    command = " ".join(part.decode("utf-8", "replace") for part in line.split(b"\0") if part)
    return f"process {pid} ({command[:120]})" if command else f"process {pid}"
