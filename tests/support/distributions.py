"""Times of many fault injections: percentiles, limits, exceedances explained by stalls; text and
JSON."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

Json = dict[str, Any]
QUANTILES = {"min": 0.0, "median": 50.0, "p90": 90.0, "p99": 99.0, "max": 100.0}


@dataclass(frozen=True, slots=True)
class Injected:
    """Outcome of one injection; all times since the fault."""

    fault: str
    program: str
    part: str
    """``free`` or ``held``."""
    phase: float
    """Phase of the fault within a period, from 0 to 1, counted from the newest sample."""
    reaction_s: float | None
    """Time of the first step of the ramp, or of the start of the freeze; None if no program
    reacted."""
    reaction_limit_s: float | None
    reaction_stalls_s: float
    safe_s: float
    """Time at which the safe voltage was output."""
    safe_limit_s: float
    safe_stalls_s: float
    ringing: float | None
    """Amplitude of the mode after the ramp divided by the arm's travel during it; None without a
    ramp."""
    ringing_um: float | None
    cause: str

    @property
    def row(self) -> tuple[str, str, str]:
        """Return the row of the table to which it belongs."""
        return self.fault, self.program, self.part

    def outliers(self) -> list[str]:
        """Bounds that were exceeded, each with the stalls of the machine meanwhile."""
        found: list[str] = []
        for what, took_s, limit_s, stalls_s in (
            ("reaction", self.reaction_s, self.reaction_limit_s, self.reaction_stalls_s),
            ("safe", self.safe_s, self.safe_limit_s, self.safe_stalls_s),
        ):
            if took_s is not None and limit_s is not None and took_s > limit_s:
                excused = took_s <= limit_s + stalls_s
                found.append(
                    f"{' '.join(self.row)}: {what} {1e3 * took_s:.1f} ms, limit "
                    f"{1e3 * limit_s:.0f} ms, stalls of the machine {1e3 * stalls_s:.1f} ms: "
                    f"{'explained' if excused else 'NOT EXPLAINED'}"
                )
        return found

    @property
    def within(self) -> bool:
        """Return whether each limit holds, apart from stalls of the machine."""
        return not any("NOT" in line for line in self.outliers())


def percentiles(values: Sequence[float]) -> Json:
    """Return minimum, median, 90 %, 99 % and maximum of some values; None without values."""
    if not values:
        return {}
    found = np.percentile(list(values), list(QUANTILES.values()))
    return {name: float(value) for name, value in zip(QUANTILES, found, strict=True)}


def rows(injected: Sequence[Injected]) -> list[Json]:
    """Return one row for each fault, program and part, in the order of first occurrence."""
    kinds = dict.fromkeys(one.row for one in injected)
    return [_row([one for one in injected if one.row == kind]) for kind in sorted(kinds)]


def _row(alike: Sequence[Injected]) -> Json:
    first = alike[0]
    stalls_s = [max(one.reaction_stalls_s, one.safe_stalls_s) for one in alike]
    return {
        "fault": first.fault,
        "program": first.program,
        "part": first.part,
        "count": len(alike),
        "reaction_s": percentiles([x.reaction_s for x in alike if x.reaction_s is not None]),
        "reaction_limit_s": first.reaction_limit_s,
        "safe_s": percentiles([one.safe_s for one in alike]),
        "safe_limit_s": first.safe_limit_s,
        "ringing": percentiles([one.ringing for one in alike if one.ringing is not None]),
        "ringing_um": percentiles([x.ringing_um for x in alike if x.ringing_um is not None]),
        "outliers": sum(bool(one.outliers()) for one in alike),
        "longest_stalls_s": max(stalls_s),
    }


def tree(injected: Sequence[Injected], about: Json) -> Json:
    """Return everything as JSON values."""
    return {
        **about,
        "rows": rows(injected),
        "outliers": [line for one in injected for line in one.outliers()],
        "injections": [asdict(one) for one in injected],
    }


def injections_of(read: Json) -> list[Injected]:
    """Return the injections of parsed JSON."""
    return [Injected(**one) for one in read["injections"]]


def _ms(found: Json) -> str:
    if not found:
        return f"{'–':>34}"
    return " ".join(f"{1e3 * found[name]:6.1f}" for name in QUANTILES)


def table(read: Sequence[Json]) -> str:
    """Return the rows as text: times in ms, ringing in per cent of the travel of the ramp."""
    names = " ".join(f"{name:>6}" for name in QUANTILES)
    reaction, safe = f"{'reaction/ms':<12}{names}", f"{'safe/ms':<8}{names}"
    lines = [f"{'fault':<38} {'n':>4}  {reaction:<47}{safe:<43}  ringing/%"]
    for row in read:
        name = f"{row['program']} {row['fault']}, {row['part']}"
        ringing = f"{100.0 * row['ringing']['max']:9.1f}" if row["ringing"] else f"{'–':>9}"
        reaction = f"{'':>12}{_ms(row['reaction_s'])}"
        lines.append(
            f"{name:<38} {row['count']:>4}  {reaction:<47}{'':>8}{_ms(row['safe_s'])}  {ringing}"
        )
    return "\n".join(lines)
