"""A separate network for a whole rig, in which the links of one program can be cut.

The kernel drops packets between one program and the others on the bus, in both directions or one;
the rig does not notice this, and its instrument's line is not affected. Only to be used within a
network namespace that was made for it: ``alone``.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Literal

from pincette.engine.realtime.os_scheduling import FIFO

Way = Literal["both", "out", "in"]
"""Which packets are lost: all, those the program sends, or those that are sent to it."""
OF_WAY: dict[Way, tuple[str, ...]] = {"both": ("out", "in"), "out": ("out",), "in": ("in",)}
TOOLS = ("unshare", "ip", "iptables", "iptables-restore")
INSIDE = "PINCETTE_OWN_NETWORK"
"""Environment variable that is set for programs that run in a separate network."""
ESTABLISHED = "01"
TRY_S = 10.0


def alone(words: Sequence[str]) -> list[str]:
    """Return the command that runs another one in a new network, which has only a loopback."""
    script = f'ip link set lo up && {INSIDE}=1 exec "$@"'
    return ["unshare", "--net", "--", "sh", "-c", script, "sh", *words]


def objection() -> str:
    """Return why no links can be cut on this machine; empty if they can."""
    if sys.platform != "linux":
        return f"{sys.platform} has no network namespaces"
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        return f"not installed: {', '.join(missing)} (Debian: util-linux, iproute2, iptables)"
    rule = ["iptables", "-w", "-A", "OUTPUT", "-p", "tcp", "--sport", "1", "-j", "DROP"]
    tried = subprocess.run(alone(rule), capture_output=True, text=True, timeout=TRY_S, check=False)
    if tried.returncode:
        return f"no network namespace, or no packet filter in it: {tried.stderr.strip()}"
    return ""


def links(process: int, ports: Collection[int]) -> Iterator[tuple[int, int]]:
    """Return own and other port of each TCP link of a process with one of some ports at an end."""
    sockets = set[str]()
    for descriptor in Path(f"/proc/{process}/fd").iterdir():
        place = str(descriptor.readlink())
        if place.startswith("socket:["):
            sockets.add(place[len("socket:[") : -1])
    for line in Path(f"/proc/{process}/net/tcp").read_text(encoding="ascii").splitlines()[1:]:
        words = line.split()
        own, other = (int(words[place].rpartition(":")[2], 16) for place in (1, 2))
        if words[3] == ESTABLISHED and words[9] in sockets and {own, other} & set(ports):
            yield own, other


class Cut:
    """A prepared cut, so that making it takes no time.

    ``ports`` are those on which the programs of the bus listen. During the cut new links are
    refused to every program, since those of the program itself cannot be told apart from others.
    """

    def __init__(self, process: int, ports: Collection[int], way: Way) -> None:
        if INSIDE not in os.environ:
            raise RuntimeError("links may be cut only in a separate network namespace")
        rules = ["*filter"]
        for own, other in links(process, ports):
            ends = {"out": (own, other), "in": (other, own)}
            for sense in OF_WAY[way]:
                source, target = ends[sense]
                rules.append(f"-A OUTPUT -p tcp --sport {source} --dport {target} -j DROP")
        if len(rules) == 1:
            raise RuntimeError(f"process {process} has no link at the ports {sorted(ports)}")
        rules += [f"-A OUTPUT -p tcp --dport {port} --syn -j DROP" for port in sorted(ports)]
        self._tool = subprocess.Popen(
            ["iptables-restore", "--noflush", "-w"], stdin=subprocess.PIPE, text=True
        )
        # otherwise it would wait for others, and the loop would seem to be late
        with suppress(OSError):
            os.sched_setscheduler(self._tool.pid, os.SCHED_FIFO, os.sched_param(FIFO))
        self._say("\n".join(rules))

    def _say(self, text: str) -> None:
        if self._tool.stdin is None:
            raise RuntimeError("iptables-restore has no standard input")
        self._tool.stdin.write(f"{text}\n")
        self._tool.stdin.flush()

    def strike(self) -> float:
        """Cut all links at once; returns the time just before."""
        now = monotonic()
        self._say("COMMIT")
        self._tool.communicate(timeout=TRY_S)
        if self._tool.returncode:
            raise RuntimeError(f"the links were not cut: status {self._tool.returncode}")
        return now

    def heal(self) -> None:
        """Let all packets pass again."""
        subprocess.run(["iptables", "-w", "-F", "OUTPUT"], timeout=TRY_S, check=True)
