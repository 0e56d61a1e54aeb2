"""A program that measures: ``python -m pincette.runtime.measuring.worker WISHES TASK NUMBERS``.

It asks the system for what a program of the loop asks for, says in a line of JSON what it was
refused, and then in another what it has found.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from pincette.bus.protocol import BusError
from pincette.config.realtime import Wishes
from pincette.runtime.interpreter import settle
from pincette.runtime.measuring.hops import echo, hops
from pincette.runtime.measuring.wake_ups import wake_ups
from pincette.runtime.realtime.asking import ask, words
from pincette.runtime.realtime.system import Linux


def command(wishes: Wishes, task: str, *numbers: float) -> list[str]:
    """The words that start it."""
    told = json.dumps([wishes.priority, wishes.cores, wishes.timer_slack_s, wishes.lock_memory])
    return [sys.executable, "-m", __name__, told, task, *map(repr, numbers)]


def main(given: Sequence[str]) -> int:
    """Measure what is asked for."""
    wished, task, *numbers = given
    priority, cores, timer_slack_s, lock_memory = json.loads(wished)
    refused = _refused(Wishes(priority, tuple(cores), timer_slack_s, lock_memory))
    settle()
    _say({"refused": refused})
    try:
        found = _measured(task, [float(number) for number in numbers])
    except BusError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    _say(found)
    return 0


def _refused(wishes: Wishes) -> str:
    """What the system does not permit, in words."""
    if sys.platform != "linux":
        return "what [realtime] asks for: it takes Linux"
    refusals = ask(wishes, Linux())
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
