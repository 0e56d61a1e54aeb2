"""How punctual each program was, out of the histograms that it told."""

from collections.abc import Iterable, Iterator
from typing import Any

from pincette.api.timing_models import LoopTiming, ProgramTiming, Spread
from pincette.latency.histogram import Distribution
from pincette.messages import Message, Timing
from pincette.topics import LOOP

QUANTITIES = ("lateness", "age", "execution")


def spread(told: Distribution) -> Spread:
    """Quantiles of a histogram."""
    return Spread(
        count=told.count,
        p50_s=told.quantile_s(0.5),
        p99_s=told.quantile_s(0.99),
        p999_s=told.quantile_s(0.999),
        max_s=told.max_s if told.count else None,
    )


def program_timing(told: Timing) -> ProgramTiming:
    """What a program has told of itself, as quantiles."""
    return ProgramTiming(
        program=told.service,
        epoch=told.epoch,
        seq=told.seq,
        missed=told.missed,
        lateness=spread(told.lateness),
        age=spread(told.age),
        execution=spread(told.execution),
    )


def loop_timing(messages: Iterable[Message]) -> LoopTiming | None:
    """What each program has told last, in the order of a tick; None where none has told."""
    newest = {message.service: message for message in messages if isinstance(message, Timing)}
    programs = [program_timing(newest[name]) for name in LOOP if name in newest]
    return LoopTiming(programs=programs) if programs else None


def rows(timing: LoopTiming) -> Iterator[dict[str, Any]]:
    """A row for each program and quantity that was counted."""
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
