"""Rules by which a driver recognises its answers, so that late ones are not confused."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

ANY_LINE = re.compile(rb".*", re.DOTALL)
"""Pattern of answers that contain nothing of their request."""


def any_line(_request: bytes) -> re.Pattern[bytes]:
    """Return the pattern for a protocol whose answers cannot be distinguished."""
    return ANY_LINE


def every_line(_line: bytes) -> bool:
    """Accept every line as solicited."""
    return True


@dataclass(frozen=True, slots=True, eq=False)
class Matching:
    """Rules by which the answers of one driver are recognised on its line.

    The answers of one driver come in the order of its requests. Drivers that share a line need not
    answer in a common order.
    """

    answers: Callable[[bytes], re.Pattern[bytes]] = any_line
    """Function that returns the pattern that every answer to a request matches, including refusals.

    Requests with equal patterns have answers that cannot be distinguished. Answers to requests with
    different patterns must not match each other's pattern.
    """
    probes: Sequence[bytes] = ()
    """Requests that change nothing at the instrument and whose answers no other answer matches."""
    accept: Callable[[bytes], bool] = every_line
    """Function that returns True if a line can be the answer to any request. Other lines are
    unsolicited and are skipped."""


def confusable(first: re.Pattern[bytes], second: re.Pattern[bytes]) -> bool:
    """Return whether an answer of one pattern could be mistaken for one of the other pattern."""
    return first == second or ANY_LINE in (first, second)
