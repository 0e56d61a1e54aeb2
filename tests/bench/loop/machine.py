"""What the machine's kernel counts: time of processes, and time that its host took away."""

import os
from collections.abc import Mapping
from pathlib import Path

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def stolen_s() -> float:
    """Time that the machine's host took away since it started, in CPU seconds."""
    with Path("/proc/stat").open(encoding="ascii") as stream:
        return int(stream.readline().split()[8]) / TICKS_PER_S


def cpu_s(process: int) -> float:
    """CPU time of all threads of a process so far, its own and the kernel's for it."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def cpu_of(processes: Mapping[str, int]) -> dict[str, float]:
    """The same of several, by name."""
    return {name: cpu_s(process) for name, process in processes.items()}
