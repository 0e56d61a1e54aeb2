"""Requests the scheduling of a program from the system, and states what is not permitted.

On one machine the loop has the highest priority, then the system, then programs that plan, draw and
record. Without permission a program still runs, and reports this once, unless the rig file requires
the setting. Settings must be requested before the bus is joined, since only threads started later
inherit them.
"""

import logging
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace

from pincette.config.programs import PRIORITY, Scheduling, SchedulingSetting
from pincette.config.toml_file import ConfigError
from pincette.engine.realtime.system import Linux

FIRST = -10
"""Niceness if no fixed priority is permitted."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """A requested setting that is not permitted."""

    setting: SchedulingSetting
    words: str
    """Name of the setting, and the limit that forbids it."""
    remedy: str
    """Action that permits the setting."""


def ask(scheduling: Scheduling, system: Linux) -> tuple[Refusal, ...]:
    """Request the settings in the first thread, from which other threads inherit them; return the
    refusals.
    """
    found = (
        _priority(scheduling.priority, system),
        _cores(scheduling.cores, system),
        _timer_slack(scheduling.timer_slack_s, system),
        _cpu_latency(scheduling.cpu_latency_s, system),
        _memory(system) if scheduling.lock_memory else None,
    )
    return tuple(refusal for refusal in found if refusal is not None)


def trial(scheduling: Scheduling, system: Linux) -> tuple[Refusal, ...]:
    """Request the settings in a separate thread, without the priority; return the refusals."""
    # Memory locking applies to the process, not to a thread, so only its limit is checked.
    with ThreadPoolExecutor(1) as pool:
        tried = replace(scheduling, priority=0, lock_memory=False)
        found = pool.submit(ask, tried, system).result()
    memory = _memory_limit(system) if scheduling.lock_memory else None
    return found if memory is None else (*found, memory)


def words(refusals: tuple[Refusal, ...]) -> str:
    """Return what was refused and how to permit it, on one line."""
    return (
        f"{' and without '.join(one.words for one in refusals)}. Permit it: "
        f"{'; '.join(one.remedy for one in refusals)}. docs/how-to/real-time.md explains "
        "this"
    )


def _refused(call: Callable[[], None]) -> OSError | None:
    try:
        call()
    except OSError as error:
        return error
    return None


def _priority(priority: int, system: Linux) -> Refusal | None:
    if priority == 0 or _refused(lambda: system.run_fixed(priority)) is None:
        return None
    nice = _refused(lambda: system.be_nice(FIRST)) is None
    instead = f"niceness {FIRST} instead" if nice else "so a busy machine delays its ticks"
    limit = system.priority_limit()
    # With a sufficient limit, the reason is that the session's group has no real-time share.
    held_by = f"rtprio limit {limit}" if limit < priority else "no share for this control group"
    remedy = (
        f"`rtprio {priority}` in limits.d, LimitRTPRIO={priority} in systemd, "
        f"--ulimit rtprio={priority} or --cap-add SYS_NICE in docker run"
        if limit < priority
        else "a share in cpu.rt_runtime_us"
    )
    return Refusal(
        "priority", f"the fixed priority SCHED_FIFO {priority} ({held_by}; {instead})", remedy
    )


def _cores(cores: tuple[int, ...], system: Linux) -> Refusal | None:
    if not cores:
        return None
    mine = system.cores()
    error = None if set(cores) <= set(mine) else OSError()
    error = error or _refused(lambda: system.run_on(cores))
    if error is None:
        return None
    return Refusal(
        "cores",
        f"processors {_listed(cores)} of its own (it may run on {_listed(mine)})",
        "name others in [realtime] cores, or --cpuset-cpus in docker run",
    )


def _timer_slack(slack_s: float, system: Linux) -> Refusal | None:
    error = _refused(lambda: system.wake_within(slack_s)) if slack_s else None
    if error is None:
        return None
    return Refusal(
        "timer_slack",
        f"a timer slack of {1e6 * slack_s:g} µs ({error.strerror or error})",
        "a seccomp profile that lets prctl pass",
    )


def _cpu_latency(latency_s: float | None, system: Linux) -> Refusal | None:
    error = None if latency_s is None else _refused(lambda: system.limit_cpu_latency(latency_s))
    if latency_s is None or error is None:
        return None
    return Refusal(
        "cpu_latency",
        f"a limit of {1e6 * latency_s:g} µs for processors to wake ({error.strerror or error})",
        'the udev rule `KERNEL=="cpu_dma_latency", GROUP="dialout", MODE="0660"`, '
        "--device /dev/cpu_dma_latency in docker run",
    )


def _memory(system: Linux) -> Refusal | None:
    error = _refused(system.lock_memory)
    return _memory_limit(system, "" if error is None else error.strerror or str(error))


def _memory_limit(system: Linux, why: str = "") -> Refusal | None:
    limit = system.memory_limit_bytes()
    if limit is None and not why:
        return None
    held_by = why if limit is None else f"memlock limit {limit // 1024} KiB, it must be unlimited"
    return Refusal(
        "memory",
        f"locked memory ({held_by})",
        "`memlock unlimited` in limits.d, LimitMEMLOCK=infinity in systemd, "
        "--ulimit memlock=-1 or --cap-add IPC_LOCK in docker run",
    )


def _listed(cores: tuple[int, ...]) -> str:
    return ", ".join(map(str, cores)) or "none"


log = logging.getLogger(__name__)
FIFO = PRIORITY
LAST = 10
"""Niceness of programs that run after the loop."""
_ANY = Scheduling()


def raise_priority(scheduling: Scheduling = _ANY, system: Linux | None = None) -> None:
    """Request to run before plots, tests and browsers.

    Raises ConfigError if a required setting is refused.
    """
    # With a fair scheduler, a thread that wakes up waits for the time slices of other threads, a
    # few ms each; a tick contains a dozen such waits. Therefore a fixed priority is requested
    # first.
    if system is None and sys.platform != "linux":
        if scheduling.required:
            raise ConfigError(
                f"[realtime] required = {_named(scheduling)}: these settings require Linux"
            )
        return
    refusals = ask(scheduling, Linux() if system is None else system)
    if not refusals:
        return
    needed = [one for one in refusals if one.setting in scheduling.required]
    if needed:
        raise ConfigError(
            f"[realtime] required = {_named(scheduling)}: does not run without "
            f"{words(tuple(needed))}"
        )
    log.info("runs without %s", words(refusals))


def lower_priority() -> None:
    """Give the calling thread a lower priority than all threads that must keep a tick."""
    with suppress(OSError):
        Linux().be_nice(max(LAST, os.getpriority(os.PRIO_PROCESS, 0)))


def _named(scheduling: Scheduling) -> str:
    return ", ".join(sorted(scheduling.required))
