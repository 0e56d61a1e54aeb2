"""Measure what an idle demo rig of separate programs takes: processor time, wake-ups and memory.

``python -m tests.bench.realtime.idle`` measures this checkout. With ``--checkouts ../before .`` the
versions are measured in turn, each with the environment that its ``make dev`` has made; the ratios
are those of the last one to the first one. Adds to ``bench.json``.
"""

import argparse
import os
import signal
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Generator, Iterable, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import monotonic, sleep

from tests.bench.loop.machine import cpu_s
from tests.bench.loop.report import keep
from tests.support.rigs import free_ports

SECONDS, TURNS = 60.0, 2
SETTLED_S = 30.0
"""Time after the start; an idle rig samples seldom after 10 to 12 s."""
END_S = 30.0
DEPTH = 3
"""Generations of processes below ``pincette up``."""
DEMO = Path("deploy") / "rigs" / "demo.toml"
PORTS = ("7447", "7461", "7462", "8000")
"""Number of ports in the rig file of the demo rig; the programs of the loop use the four after the
first."""
COLUMNS = {"cpu": "% of a core", "wakes": "wake-ups/s", "pss_MB": "PSS MB", "rss_MB": "RSS MB"}


@dataclass
class Taken:
    """Resources used by the programs of a version: one value a turn, by column and program."""

    columns: dict[str, list[dict[str, float]]] = field(
        default_factory=lambda: {column: [] for column in COLUMNS}
    )

    def add(self, column: str, figures: Iterable[tuple[str, float]]) -> None:
        """Add the figures of a turn, one for each process with the name of its program."""
        sums = defaultdict[str, float](float)
        for name, figure in figures:
            sums[name] += figure
        self.columns[column].append(sums)

    def of(self, column: str, program: str) -> float:
        """Return the median over the turns."""
        return median(one.get(program, 0.0) for one in self.columns[column])

    def all(self, column: str) -> float:
        """Return the median over the turns of the sum over all programs."""
        return median(sum(one.values()) for one in self.columns[column])


@contextmanager
def rig_up(checkout: Path, folder: Path) -> Generator[int]:
    """Start the demo rig of a checkout on its own ports; yields the process number."""
    bus, *others = PORTS
    first, text = free_ports(len(PORTS) + 4), (checkout / DEMO).read_text(encoding="utf-8")
    text = text.replace(bus, str(first))
    for place, port in enumerate(others, first + 5):
        text = text.replace(port, str(place))
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    words = ["up", "--rig", str(path), "--data", str(folder / "data")]
    program = subprocess.Popen(
        [checkout / ".venv" / "bin" / "python", "-m", "pincette", *words],
        stdout=subprocess.PIPE,
        text=True,
        cwd=checkout,
    )
    try:
        assert program.stdout is not None
        if not any(" is up" in line for line in program.stdout):
            raise RuntimeError(f"{checkout}: the rig did not start")
        yield program.pid
    finally:
        program.send_signal(signal.SIGINT)
        program.communicate(timeout=END_S)


def programs(up: int) -> dict[int, str]:
    """Return the processes below that of ``pincette up``, each with the program it belongs to."""
    parents: dict[int, int] = {}
    for place in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(place.parent.name)] = int(place.read_text().rpartition(")")[2].split()[1])
    found = {up: "up"}
    for _ in range(DEPTH):
        for one, parent in parents.items():
            if parent in found and one not in found:
                found[one] = _named(one) or f"{found[parent]}'s"
    return found


def _named(process: int) -> str:
    words = Path(f"/proc/{process}/cmdline").read_text(encoding="utf-8").split("\0")
    return words[words.index("run") + 1] if "run" in words else ""


def wakes(process: int) -> int:
    """Return how often the threads of a process have waited until now."""
    count = 0
    for status in Path(f"/proc/{process}/task").glob("*/status"):
        with suppress(OSError):
            for line in status.read_text(encoding="ascii").splitlines():
                if line.startswith("voluntary_ctxt_switches"):
                    count += int(line.split()[1])
    return count


def memory_MB(process: int) -> tuple[float, float]:
    """Return the memory of a process in MB: with shared pages divided among their processes, and in
    full."""
    found: dict[str, float] = {}
    for line in Path(f"/proc/{process}/smaps_rollup").read_text(encoding="ascii").splitlines()[1:]:
        name, size, _ = line.split()
        found[name] = int(size) / 1024.0
    return found["Pss:"], found["Rss:"]


def measure(up: Mapping[int, Taken], seconds: float) -> None:
    """Measure rigs at the same time, each by the process of its ``pincette up``."""
    found = {process: programs(process) for process in up}
    before = {one: (cpu_s(one), wakes(one)) for some in found.values() for one in some}
    begun_s = monotonic()
    sleep(seconds)
    passed_s = monotonic() - begun_s
    after = {one: (cpu_s(one), wakes(one)) for one in before}
    for process, taken in up.items():
        some = found[process].items()
        share = 100.0 / passed_s
        taken.add("cpu", [(name, share * (after[one][0] - before[one][0])) for one, name in some])
        woken = [(name, (after[one][1] - before[one][1]) / passed_s) for one, name in some]
        taken.add("wakes", woken)
        memory = [(name, memory_MB(one)) for one, name in some]
        taken.add("pss_MB", [(name, pss_MB) for name, (pss_MB, _) in memory])
        taken.add("rss_MB", [(name, rss_MB) for name, (_, rss_MB) in memory])


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.realtime.idle", description=__doc__
    )
    parser.add_argument("--checkouts", type=Path, nargs="+", default=[Path()])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="each; %(default)g")
    parser.add_argument("--turns", type=int, default=TURNS, help="%(default)s")
    parser.add_argument("--together", action="store_true", help="run all versions at the same time")
    given = parser.parse_args()
    checkouts = [one.resolve() for one in given.checkouts]
    taken = {checkout: Taken() for checkout in checkouts}
    groups = [checkouts] if given.together else [[one] for one in checkouts]
    for group in groups * given.turns:
        with ExitStack() as stack:
            up: dict[int, Taken] = {}
            for checkout in group:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
                up[stack.enter_context(rig_up(checkout, folder))] = taken[checkout]
            sleep(SETTLED_S)
            measure(up, given.seconds)
    for checkout, one in taken.items():
        _tell(checkout, one)
    first, last = taken[checkouts[0]], taken[checkouts[-1]]
    ratios = {f"idle_{name}_over_before": last.all(name) / first.all(name) for name in COLUMNS}
    if len(checkouts) > 1:
        print(", ".join(f"{name} {value:.2f}" for name, value in ratios.items()))
    figures = {f"idle_{name}": last.all(name) for name in COLUMNS}
    keep(figures | (ratios if len(checkouts) > 1 else {}), {})


def _tell(checkout: Path, taken: Taken) -> None:
    print(f"{checkout}, load {os.getloadavg()[0]:.1f}")
    print(f"{'':<14}" + "".join(f"{words:>13}" for words in COLUMNS.values()))
    for name in taken.columns["cpu"][0]:
        print(f"{name:<14}" + "".join(f"{taken.of(column, name):13.1f}" for column in COLUMNS))
    print(f"{'all':<14}" + "".join(f"{taken.all(column):13.1f}" for column in COLUMNS), flush=True)


if __name__ == "__main__":
    main()
