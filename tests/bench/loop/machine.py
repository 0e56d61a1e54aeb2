"""Kernel counters: CPU time of processes, and CPU time stolen by the host of a virtual machine."""

import os
from collections.abc import Mapping
from pathlib import Path

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def stolen_s() -> float:
    """Return the CPU time that the host has taken from this machine since its start, in s."""
    with Path("/proc/stat").open(encoding="ascii") as stream:
        return int(stream.readline().split()[8]) / TICKS_PER_S


def cpu_s(process: int) -> float:
    """Return the CPU time of all threads of a process so far, user and system."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def cpu_of(processes: Mapping[str, int]) -> dict[str, float]:
    """Return the CPU time of several processes, by name."""
    return {name: cpu_s(process) for name, process in processes.items()}
