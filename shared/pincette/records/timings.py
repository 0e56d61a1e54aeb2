"""Timing of each program, from its histograms."""

from collections.abc import Iterable, Iterator
from typing import Any

from pincette.api.live import LoopTiming, ProgramTiming, Spread
from pincette.core.messages import Message, Timing
from pincette.core.topics import LOOP
from pincette.latency.histogram import Distribution

QUANTITIES = ("lateness", "age", "execution")


def spread(counted: Distribution) -> Spread:
    """Return quantiles of a histogram."""
    return Spread(
        count=counted.count,
        p50_s=counted.quantile_s(0.5),
        p99_s=counted.quantile_s(0.99),
        p999_s=counted.quantile_s(0.999),
        max_s=counted.max_s if counted.count else None,
    )


def program_timing(timing: Timing) -> ProgramTiming:
    """Return the timing of a program as quantiles."""
    return ProgramTiming(
        program=timing.service,
        epoch=timing.epoch,
        seq=timing.seq,
        missed=timing.missed,
        lateness=spread(timing.lateness),
        age=spread(timing.age),
        execution=spread(timing.execution),
    )


def loop_timing(messages: Iterable[Message]) -> LoopTiming | None:
    """Return the last timing of each program, in the order of a tick; None if there is none."""
    newest = {message.service: message for message in messages if isinstance(message, Timing)}
    programs = [program_timing(newest[name]) for name in LOOP if name in newest]
    return LoopTiming(programs=programs) if programs else None


def rows(timing: LoopTiming) -> Iterator[dict[str, Any]]:
    """Return a row for each program and counted quantity."""
    for one in timing.programs:
        for quantity in QUANTITIES:
            found: Spread = getattr(one, quantity)
            if found.count:
                missed = one.missed if quantity == QUANTITIES[0] else None
                yield {
                    "program": one.program,
                    "quantity": quantity,
                    **found.model_dump(),
                    "missed": missed,
                }
