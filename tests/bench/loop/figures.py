"""Rates and tails of blocks, and the ratios that are stored."""

from collections.abc import Sequence
from statistics import fmean, median

from pincette.core.topics import LOOP
from tests.bench.loop.contestant import Block, Contestant

SHARES = {"p50": 0.5, "p99": 0.99, "p999": 0.999}


def quantile(values: Sequence[float], share: float) -> float:
    """Return the value below which a share of the values lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def rate(blocks: Sequence[Block]) -> float:
    """Return the ticks per second of the median block."""
    return median(block.per_s for block in blocks)


def tail_ms(blocks: Sequence[Block], share: float) -> float:
    """Return the tail quantile of the tick lengths in ms, of the median block."""
    return 1e3 * median(quantile(block.ticks_s, share) for block in blocks)


def cpu_us(blocks: Sequence[Block]) -> dict[str, float]:
    """Return the CPU time per tick by process, over all blocks."""
    return {name: fmean(block.cpu_us[name] for block in blocks) for name in blocks[0].cpu_us}


def own(contestant: Contestant) -> dict[str, float]:
    """Return the figures of one contestant, prefixed with its name."""
    name, blocks = contestant.name, contestant.blocks
    tails = {f"{name}_{word}_ms": tail_ms(blocks, share) for word, share in SHARES.items()}
    spent = cpu_us(blocks)
    whole_us = sum(spent[role] for role in LOOP)
    return {f"{name}_per_s": rate(blocks), **tails, f"{name}_cpu_us": whole_us}


def ratios(loop: Contestant, bare: Contestant) -> dict[str, float]:
    """Return the ratios of the loop to the bare ring."""
    mine, other = loop.blocks, bare.blocks
    return {
        "loop_over_bare": rate(mine) / rate(other),
        "p99_over_bare": tail_ms(mine, 0.99) / tail_ms(other, 0.99),
        "p999_over_bare": tail_ms(mine, 0.999) / tail_ms(other, 0.999),
        "own_us_per_hop": own_us_per_hop(loop, bare),
    }


def own_us_per_hop(loop: Contestant, bare: Contestant) -> float:
    """Return the difference between a tick of the loop and one of the bare ring, divided by the
    number of hops."""
    return 1e6 * (1.0 / rate(loop.blocks) - 1.0 / rate(bare.blocks)) / len(LOOP)
