"""Why an actuator has tripped, in words that are the same wherever a person reads them.

The actuator knows only that no command came. Who of the programs before it has fallen silent is
seen from outside, by the numbers of their newest samples at the moment of the trip.
"""

from collections.abc import Mapping
from dataclasses import dataclass

MEANINGS = {
    "abort": "abort: the job was aborted",
    "estop": "estop: an emergency stop was asked for",
    "restart": "restart: the actuator was started anew",
}
AGE, UNHEARD = "command_age", "no command for"
LATE_PERIODS = 1.5
"""A sensor that has said nothing for so long is silent; its samples come one a period."""
IN_FLIGHT = 1
"""By so many samples a program may lag behind the one before it."""


@dataclass(frozen=True, slots=True)
class Said:
    """The newest sample of a program, and how long ago it came."""

    seq: int
    age_s: float


def code_of(cause: str) -> str:
    """The word by which a cause is known: what stands before the colon."""
    return cause.partition(":")[0].strip() or "unknown"


def words(cause: str, silent: str = "") -> str:
    """A cause for people; ``silent`` is the program that was silent when it came."""
    if not silent or code_of(cause) != AGE:
        return MEANINGS.get(cause, cause)
    named = cause.replace(UNHEARD, f"{silent} silent for", 1)
    return named if named != cause else f"{cause}; {silent} silent"


def silent_program(said: Mapping[str, Said], period_s: float) -> str:
    """The first program, in the order of a tick, that says no more; empty where all go on.

    Parameters
    ----------
    said
        What sensor, estimator and controller have said last, of one epoch.
    """
    sensor = said.get("sensor")
    if sensor is None:
        return ""
    if sensor.age_s > LATE_PERIODS * period_s:
        return "sensor"
    newest = sensor.seq
    for program in ("estimator", "controller"):
        one = said.get(program)
        if one is None or one.seq < newest - IN_FLIGHT:
            return program
        newest = min(newest, one.seq)
    return ""
