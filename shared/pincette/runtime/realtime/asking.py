"""Asks the system for what a program wishes, and says in words what is not permitted."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

from pincette.config.realtime import Wish, Wishes
from pincette.runtime.realtime.system import System

FIRST = -10
"""Niceness, where no fixed priority is permitted."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Something that was asked for and is not permitted."""

    wish: Wish
    words: str
    """What it is, and which limit keeps it."""
    remedy: str
    """How it is permitted."""


def ask(wishes: Wishes, system: System) -> tuple[Refusal, ...]:
    """Ask for everything that is wished for; what was refused.

    To be asked by the first thread before there are others, since they inherit the answer.
    """
    found = (
        _priority(wishes.priority, system),
        _cores(wishes.cores, system),
        _timer_slack(wishes.timer_slack_s, system),
        _memory(system) if wishes.lock_memory else None,
    )
    return tuple(refusal for refusal in found if refusal is not None)


def trial(wishes: Wishes, system: System) -> tuple[Refusal, ...]:
    """What would be refused, the priority apart; the program that asks stays as it is.

    A thread asks that ends with it; memory, which is the process's, is judged by its limit.
    """
    with ThreadPoolExecutor(1) as pool:
        tried = replace(wishes, priority=0, lock_memory=False)
        found = pool.submit(ask, tried, system).result()
    memory = _memory_limit(system) if wishes.lock_memory else None
    return found if memory is None else (*found, memory)


def words(refusals: tuple[Refusal, ...]) -> str:
    """What was refused, and how to permit it, in one line."""
    return (
        f"{' and without '.join(one.words for one in refusals)}. Permit it: "
        f"{'; '.join(one.remedy for one in refusals)}. docs/how-to/real-time.md says more"
    )


def _refused(call: Callable[[], None]) -> OSError | None:
    try:
        call()
    except OSError as error:
        return error
    return None


def _priority(priority: int, system: System) -> Refusal | None:
    if priority == 0 or _refused(lambda: system.run_fixed(priority)) is None:
        return None
    nice = _refused(lambda: system.be_nice(FIRST)) is None
    instead = f"niceness {FIRST} instead" if nice else "so a busy machine delays its ticks"
    limit = system.priority_limit()
    # With a limit that is high enough it is the session's group that has no share.
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


def _cores(cores: tuple[int, ...], system: System) -> Refusal | None:
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


def _timer_slack(slack_s: float, system: System) -> Refusal | None:
    error = _refused(lambda: system.wake_within(slack_s)) if slack_s else None
    if error is None:
        return None
    return Refusal(
        "timer_slack",
        f"a timer slack of {1e6 * slack_s:g} µs ({error.strerror or error})",
        "a seccomp profile that lets prctl pass",
    )


def _memory(system: System) -> Refusal | None:
    error = _refused(system.lock_memory)
    return _memory_limit(system, "" if error is None else error.strerror or str(error))


def _memory_limit(system: System, why: str = "") -> Refusal | None:
    limit = system.memory_limit_bytes()
    if limit is None and not why:
        return None
    held_by = why if limit is None else f"memlock limit {limit // 1024} KiB, it takes unlimited"
    return Refusal(
        "memory",
        f"locked memory ({held_by})",
        "`memlock unlimited` in limits.d, LimitMEMLOCK=infinity in systemd, "
        "--ulimit memlock=-1 or --cap-add IPC_LOCK in docker run",
    )


def _listed(cores: tuple[int, ...]) -> str:
    return ", ".join(map(str, cores)) or "none"
