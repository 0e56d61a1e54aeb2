"""A program that measures: ``python -m pincette.engine.measuring.worker SCHEDULING TASK NUMBERS``.

It requests the same settings from the system as a program of the loop, prints the refused ones as
one line of JSON, and then the results as another.
"""

import json
import sys
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any

from msgspec.structs import asdict

from pincette.bus.protocol import BusError
from pincette.config.programs import Scheduling
from pincette.engine.measuring.hops import echo, hops
from pincette.engine.realtime.gc_tuning import disable_gc
from pincette.engine.realtime.os_scheduling import ask, words
from pincette.engine.realtime.system import Linux
from pincette.latency.histogram import Histogram
from pincette.latency.rule import Measured

SETTLED = 10
"""Number of wake-ups at the beginning that are not counted, since code and clock are first used in
them."""


def wait(timeout_s: float) -> None:
    """Wait, as a service does, for a message that never arrives."""
    nothing: SimpleQueue[None] = SimpleQueue()
    try:
        nothing.get(timeout=timeout_s)
    except Empty:
        return


def wake_ups(
    period_s: float,
    for_s: float,
    clock_s: Callable[[], float] = monotonic,
    wait_s: Callable[[float], None] = wait,
) -> Measured:
    """Wake up each ``period_s`` and count the lateness; missed grid points are skipped."""
    lateness, missed = Histogram(), 0
    begin_s = clock_s()
    due_s, settled_s = begin_s + period_s, begin_s + (SETTLED + 0.5) * period_s
    end_s = begin_s + for_s
    while due_s < end_s:
        now = clock_s()
        while now < due_s:
            wait_s(due_s - now)
            now = clock_s()
        late_s = now - due_s
        skipped = int(late_s / period_s)
        if due_s > settled_s:
            lateness.add(late_s)
            missed += skipped
        due_s += (skipped + 1) * period_s
    return Measured(period_s, lateness.distribution(), missed)


def command(scheduling: Scheduling, task: str, *numbers: float) -> list[str]:
    """Return the command line of a worker."""
    asked = json.dumps(
        [scheduling.priority, scheduling.cores, scheduling.timer_slack_s, scheduling.lock_memory]
    )
    return [sys.executable, "-m", __name__, asked, task, *map(repr, numbers)]


def main(given: Sequence[str]) -> int:
    """Run the measurement of the command line."""
    asked, task, *numbers = given
    priority, cores, timer_slack_s, lock_memory = json.loads(asked)
    refused = _refused(Scheduling(priority, tuple(cores), timer_slack_s, lock_memory))
    disable_gc()
    _say({"refused": refused})
    try:
        found = _measured(task, [float(number) for number in numbers])
    except BusError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    _say(found)
    return 0


def _refused(scheduling: Scheduling) -> str:
    """Return what the system does not permit, in words."""
    if sys.platform != "linux":
        return "the settings in [realtime], which require Linux"
    refusals = ask(scheduling, Linux())
    return words(refusals) if refusals else ""


def _measured(task: str, numbers: list[float]) -> dict[str, Any]:
    match task, numbers:
        case "wake_ups", [period_s, for_s]:
            measured = wake_ups(period_s, for_s)
            return {"lateness": asdict(measured.lateness), "missed": measured.missed}
        case "echo", [port, asker, for_s]:
            echo(int(port), int(asker), for_s)
            return {}
        case "hops", [port, for_s]:
            return {"hop": asdict(hops(int(port), for_s))}
        case _:
            raise SystemExit(__doc__)


def _say(tree: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(tree) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
