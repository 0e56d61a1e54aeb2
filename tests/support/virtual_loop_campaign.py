"""A large number of injections, drawn by a seed, distributed over processes, and summarised."""

import json
import random
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

from tests.support.virtual_loop_catalogue import FATAL, HARMLESS
from tests.support.virtual_loop_injection import Reaction, inject
from tests.support.virtual_loop_places import STATES, place

PHASES = 12
"""Number of parts of a period; within each part a fault falls anywhere."""
HARMLESS_SHARE = 0.3
SHARES = (50.0, 90.0, 99.0, 100.0)


@dataclass(frozen=True, slots=True)
class Row:
    """Summary of one fault, or of one state: times in ms, since the fault."""

    name: str
    count: int
    reaction_ms: tuple[float, ...]
    safe_ms: tuple[float, ...]
    ringing: float
    """Largest ringing, as a share of the stroke."""


def draw(number: int, seed: int) -> Reaction | None:
    """Return injection ``number`` of a campaign: all faults, states and phases come in turn."""
    chance = random.Random(f"{seed} {number}")
    faults = HARMLESS if chance.random() < HARMLESS_SHARE else FATAL
    fault, state = chance.choice(faults), chance.choice(STATES)
    phase = (number % PHASES + chance.random()) / PHASES
    return inject(place(state), fault, phase, chance.getrandbits(32))


def share(begin: int, end: int, seed: int) -> list[Reaction]:
    """Run injections of a campaign by their numbers, in one process."""
    reactions = [draw(number, seed) for number in range(begin, end)]
    return [reaction for reaction in reactions if reaction is not None]


def campaign(
    count: int, seed: int, processes: int, tell: Callable[[str], None] = print
) -> list[Reaction]:
    """Run all injections; raises AssertionError if one has a wrong outcome."""
    piece = max(1, count // (50 * processes))
    begins = range(0, count, piece)
    reactions: list[Reaction] = []
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        ends = [min(begin + piece, count) for begin in begins]
        shares = pool.map(share, begins, ends, [seed] * len(ends))
        for end, found in zip(ends, shares, strict=True):
            reactions += found
            if end * 10 // count != (end - piece) * 10 // count:
                tell(f"{end} of {count} injections")
    return reactions


def percentile(values: Sequence[float], share: float) -> float:
    """Return the smallest value that this many per cent of the values do not exceed."""
    ordered = sorted(values)
    index = max(0, -(-len(ordered) * share // 100) - 1)
    return ordered[int(index)]


def rows_of(reactions: Iterable[Reaction], key: Callable[[Reaction], str]) -> list[Row]:
    """Summarise by ``key``."""
    kinds: dict[str, list[Reaction]] = {}
    for reaction in reactions:
        kinds.setdefault(key(reaction), []).append(reaction)
    return [_row(name, found) for name, found in sorted(kinds.items())]


def _row(name: str, found: Sequence[Reaction]) -> Row:
    def spread(times_s: list[float]) -> tuple[float, ...]:
        return tuple(round(1e3 * percentile(times_s, share), 2) for share in SHARES)

    return Row(
        name,
        len(found),
        spread([reaction.reaction_s for reaction in found]),
        spread([reaction.safe_s for reaction in found]),
        round(max(reaction.ringing_share for reaction in found), 4),
    )


def table(title: str, rows: Sequence[Row]) -> str:
    """Return the table as text: medians, percentiles and maxima of both times, and the largest
    ringing."""
    lines = [
        f"{title:<44}{'count':>7}  {'reaction ms: 50 90 99 worst':>31}"
        f"  {'safe ms: 50 90 99 worst':>31}  ringing"
    ]
    for row in rows:
        both = "".join(
            "  " + "".join(f"{value:8.1f}" for value in values)
            for values in (row.reaction_ms, row.safe_ms)
        )
        lines.append(f"{row.name:<44}{row.count:>7}{both}  {100.0 * row.ringing:5.1f} %")
    return "\n".join(lines)


def arm_of(reaction: Reaction) -> str:
    """Return whether the arm is held or free, as text."""
    return "part held" if reaction.held else "arm free"


def write_figures(folder: Path, reactions: Sequence[Reaction], count: int, seed: int) -> Path:
    """Write the tables to a JSON file from which documents are made."""
    path = folder / "virtual_faults.json"
    tables = {
        "faults": rows_of(reactions, lambda reaction: reaction.fault),
        "states": rows_of(reactions, lambda reaction: reaction.state),
        "arms": rows_of(reactions, arm_of),
    }
    reported = {name: [asdict(row) for row in rows] for name, rows in tables.items()}
    path.write_text(json.dumps({"injections": count, "seed": seed, **reported}, indent=1) + "\n")
    return path
