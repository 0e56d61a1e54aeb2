"""How a driver's answers are recognised, so that a late one is not taken for the next one."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

ANY_LINE = re.compile(rb".*", re.DOTALL)
"""Pattern of answers that contain nothing of their request."""


def any_line(_request: bytes) -> re.Pattern[bytes]:
    """Return the pattern for a protocol whose answers cannot be told apart."""
    return ANY_LINE


def every_line(_line: bytes) -> bool:
    """Accept every line as solicited."""
    return True


@dataclass(frozen=True, slots=True, eq=False)
class Matching:
    """How one driver's answers are recognised on its line.

    Answers of one driver come in the order of its requests. Drivers that share a line need not
    answer in a common order.
    """

    answers: Callable[[bytes], re.Pattern[bytes]] = any_line
    """Returns the pattern that every answer to a request matches, refusals included.

    Requests with equal patterns have answers that cannot be told apart. Answers to requests with
    different patterns must not match each other's pattern."""
    probes: Sequence[bytes] = ()
    """Requests that change nothing at the instrument and whose answers no other answer matches."""
    accept: Callable[[bytes], bool] = every_line
    """Whether a line can answer any request. Other lines are unsolicited and are skipped."""


def confusable(first: re.Pattern[bytes], second: re.Pattern[bytes]) -> bool:
    """Return whether an answer of one pattern could be taken for one of the other."""
    return first == second or ANY_LINE in (first, second)
