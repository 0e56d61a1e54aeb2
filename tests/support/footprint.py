"""Resources that a process uses, and their growth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import linear_regression, mean

from tests.support.bare_connects import descriptors
from tests.support.running import RunningRig

STATUS_FIELDS = {"Threads:": "threads", "RssAnon:": "memory_kB"}


def footprint(process: int) -> dict[str, int]:
    """Return open files, threads and private memory of a process, in kB."""
    found = {"files": descriptors(process)}
    for line in Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines():
        words = line.split()
        if words and words[0] in STATUS_FIELDS:
            found[STATUS_FIELDS[words[0]]] = int(words[1])
    return found


@dataclass
class Footprints:
    """Resources of every program of a rig over time."""

    rig: RunningRig
    taken: dict[str, list[Mapping[str, int]]] = field(
        default_factory=dict[str, list[Mapping[str, int]]]
    )

    def take(self) -> None:
        """Record the resources of each program."""
        for name, member in self.rig.fleet.members.items():
            self.taken.setdefault(name, []).append(footprint(member.process.pid))

    def settled(self, name: str, quantity: str) -> Sequence[int]:
        """Return a program's values without the first third, in which caches fill."""
        values = [one[quantity] for one in self.taken[name]]
        return values[len(values) // 3 :]

    def slope(self, name: str, quantity: str) -> float:
        """Return the growth from one time to the next, by least squares."""
        values = self.settled(name, quantity)
        return linear_regression(range(len(values)), values).slope

    def grown(self, name: str, quantity: str) -> float:
        """Return the mean of the last third minus that of the third before it."""
        values = self.settled(name, quantity)
        half = len(values) // 2
        return mean(values[half:]) - mean(values[:half])

    def table(self, each: str) -> list[str]:
        """Return a line for each program: its resources at the end, and the slopes."""
        return [
            f"{name}: "
            + ", ".join(
                f"{rows[-1][quantity]} {quantity} ({self.slope(name, quantity):+.3f} a {each})"
                for quantity in rows[-1]
            )
            for name, rows in self.taken.items()
        ]
