"""Checks for parts of a program that are too short for the sampling period."""

from collections.abc import Sequence
from itertools import pairwise

from pincette.control.planning.paths import Path
from pincette.control.planning.segments import Segment, paths_of

ROUNDING = 1e-6
"""Fraction of the period by which a duration may be too short because of rounding."""


def unsampled(segments: Sequence[Segment], period_s: float) -> list[str]:
    """Return a text for each segment, or piece of its path, that lies between two samples.

    References are evaluated only at the samples: a part of a path that is shorter than a period is
    not played, and a segment shorter than a period lasts a whole period.
    """
    found: list[str] = []
    for segment in segments:
        for path in paths_of(segment):
            found.extend(_close_knots(segment.phase, path, period_s))
        if segment.duration_s is not None and _below(segment.duration_s, period_s):
            found.append(
                f"{segment.phase} takes {segment.duration_s:g} s, less than the period of "
                f"{period_s:g} s: plan a longer {segment.phase}"
            )
    return list(dict.fromkeys(found))


def _close_knots(phase: str, path: Path, period_s: float) -> list[str]:
    gaps_s = [after.t_s - before.t_s for before, after in pairwise(path.knots)]
    close_s = [gap_s for gap_s in gaps_s if _below(gap_s, period_s)]
    if not close_s:
        return []
    return [
        f"{phase}: {len(close_s)} of {len(gaps_s)} sections of the path take less than the "
        f"period of {period_s:g} s (the shortest {min(close_s):g} s): points between two "
        "samples are skipped; put the points, or the dwell_s, at least a period apart"
    ]


def _below(time_s: float, period_s: float) -> bool:
    return time_s < period_s * (1.0 - ROUNDING)
