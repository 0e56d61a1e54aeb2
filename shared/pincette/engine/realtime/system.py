"""Linux system calls that make a thread run sooner; tests replace them.

Priority, niceness, processors and timer slack belong to a thread; threads that it starts later
inherit them. Locked memory and the limit of the processors' latency belong to the process.
"""

import ctypes
import os
import resource
import struct
from pathlib import Path

PR_SET_TIMERSLACK = 29
"""Constant of ``linux/prctl.h``."""
LOCK_NOW, LOCK_LATER, LOCK_ON_FAULT = 1, 2, 4
"""MCL_CURRENT, MCL_FUTURE and MCL_ONFAULT of ``asm-generic/mman.h``: x86, ARM, RISC-V."""
CAP_IPC_LOCK = 14
"""Bit of the capability in ``linux/capability.h``."""
CPU_LATENCY = Path("/dev/cpu_dma_latency")
"""PM QoS of Linux: a limit in µs holds as long as its file is open, see pm_qos_interface."""
AUTOGROUP = Path("/proc/self/autogroup")
"""File by which Linux weighs sessions against each other, see sched(7)."""
STATUS = Path("/proc/self/status")
NO_LIMIT = resource.RLIM_INFINITY


class Linux:
    """Requests of a thread; each raises OSError if it is not permitted."""

    def run_fixed(self, priority: int) -> None:
        """Run at a fixed priority (SCHED_FIFO)."""
        _raise_limit(resource.RLIMIT_RTPRIO, priority)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))

    def be_nice(self, niceness: int) -> None:
        """Set the niceness; if tasks are grouped by session, it applies only within the group."""
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
        if os.getsid(0) == os.getpid() and AUTOGROUP.exists():
            AUTOGROUP.write_text(str(niceness), encoding="ascii")

    def run_on(self, cores: tuple[int, ...]) -> None:
        """Run on these processors only."""
        os.sched_setaffinity(0, cores)

    def wake_within(self, slack_s: float) -> None:
        """Let the kernel delay a wake-up by at most this time."""
        _call("prctl", PR_SET_TIMERSLACK, ctypes.c_ulong(max(1, round(1e9 * slack_s))))

    def limit_cpu_latency(self, latency_s: float) -> None:
        """Prevent deep idling of processors, which delays wake-ups, until the process ends."""
        number = os.open(CPU_LATENCY, os.O_WRONLY | os.O_CLOEXEC)  # must stay open
        os.write(number, struct.pack("=i", round(1e6 * latency_s)))

    def lock_memory(self) -> None:
        """Lock the used memory of the process, so that it is not swapped out."""
        # A limit that is sufficient now could let a later allocation fail; therefore no limit may
        # be set.
        if self.memory_limit_bytes() is not None:
            raise PermissionError("a limited memory is not locked")
        _raise_limit(resource.RLIMIT_MEMLOCK, NO_LIMIT)
        _call("mlockall", LOCK_NOW | LOCK_LATER | LOCK_ON_FAULT)

    def priority_limit(self) -> int:
        """Return the highest fixed priority that may be requested without a capability."""
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
        return 99 if limit == NO_LIMIT else limit

    def memory_limit_bytes(self) -> int | None:
        """Return the memory that may be locked; None: any amount."""
        limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
        return None if limit == NO_LIMIT or _may_lock() else limit

    def cores(self) -> tuple[int, ...]:
        """Return the processors on which this thread may run."""
        return tuple(sorted(os.sched_getaffinity(0)))


def _raise_limit(kind: int, wanted: int) -> None:
    """Raise the soft limit as far as the hard one allows, if it is too low."""
    soft, hard = resource.getrlimit(kind)
    enough = soft == NO_LIMIT or (wanted != NO_LIMIT and soft >= wanted)
    permitted = hard == NO_LIMIT or (wanted != NO_LIMIT and hard >= wanted)
    if not enough and permitted:
        resource.setrlimit(kind, (wanted, hard))


def _may_lock() -> bool:
    """Return whether this process has the capability to lock any memory."""
    for line in STATUS.read_text(encoding="ascii").splitlines():
        name, _, bits = line.partition(":")
        if name == "CapEff":
            return bool(int(bits, 16) >> CAP_IPC_LOCK & 1)
    return False


def _call(name: str, *words: object) -> None:
    """Call a function of the C library; raises OSError with its error number."""
    library = ctypes.CDLL(None, use_errno=True)
    if getattr(library, name)(*words):
        number = ctypes.get_errno()
        raise OSError(number, f"{name}: {os.strerror(number)}")
