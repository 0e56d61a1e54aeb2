"""Verdict on the release of a part, from the return motion of the arm; pure."""

from collections.abc import Iterator
from itertools import pairwise
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pincette.api.results import ReleaseVerdict
from pincette.config import RigFile, derived
from pincette.control.force.estimation import COVERAGE
from pincette.control.force.freedom import FreeArm, FreedomFit, Verdict
from pincette.control.planning.program import RETREATS, Program
from pincette.control.planning.segments import LetGo
from pincette.core.faults import TRIPPED, Phase
from pincette.records.columns import Columns
from pincette_supervisor.plugin import Run
from pincette_supervisor.plugin.figures import Mask, Series, series, table_of_arm
from pincette_supervisor.plugin.result import zero_invalid

BACK = (*RETREATS, Phase.STOPPING)
"""Phases of a return motion, and of the stop of an arm that was held during it."""
WAYS = 2.0
"""Length of the last stretch of a return motion that is judged, as a multiple of the distance of
a check."""
AVERAGED, SMOOTHED, RINGS = (4, 8, 16), 16, 2
"""Numbers of samples before and after a pull-off that are compared, number over which the growth
of the pull is smoothed, and number in which the arm oscillates."""
SIGMAS = 4.5
"""Detection limit of a pull-off, in standard deviations: one false detection in 10^5 samples of
normal noise."""
ORDER: tuple[Verdict, ...] = ("sticks", "unknown", "released")
"""Verdicts on one arm; the first of them that applies to either of two arms is the verdict on
both."""


class OfArm(NamedTuple):
    """Findings on one arm: verdict, stiffness and pull-off force, each with its uncertainty."""

    verdict: Verdict
    stiffness: tuple[float, float] | None
    pull_off: tuple[float, float] | None


def release_of(run: Run) -> ReleaseVerdict | None:
    """Return the verdict on the release at the end of a job; None if it released no part.

    With two arms it is that of the arm that is held more.
    """
    table, program = run.table, run.planned.program
    let_go, checks = _let_go(table, program), _checks(table, program)
    if let_go is None:
        return None
    found: list[OfArm] = []
    for place, arm in enumerate(run.planned.armed.rig.arms):
        own = table_of_arm(table, place + 1)
        checked = _checked(own, program, checks[-1], place) if checks else None
        found.append(_of_arm(own, arm, let_go, checked))
    worst = min(found, key=lambda each: ORDER.index(each.verdict))
    strategies: list[str] = run.planned.values.get("strategies") or []
    stiffness, pull_off = worst.stiffness or (None, None), worst.pull_off or (None, None)
    return ReleaseVerdict(
        verdict=worst.verdict,
        strategies=strategies[: len(checks)],
        stiffness_mN_per_um=stiffness[0],
        stiffness_uncertainty_mN_per_um=stiffness[1],
        pull_off_mN=pull_off[0],
        pull_off_uncertainty_mN=pull_off[1],
    )


def sticking(found: ReleaseVerdict | None) -> str:
    """Return why a release has failed, in words; empty if the part does not stick."""
    if found is None or found.verdict != "sticks":
        return ""
    return (
        "the part sticks to the arm, which moves against a stiffness of "
        f"{found.stiffness_mN_per_um:.2g} mN/µm: try other strategies, or take the part off by hand"
    )


def _let_go(table: Columns, program: Program) -> Mask | None:
    """Return the samples of the last return motion from a held part; None without one, or after
    a trip."""
    lets_go = [at for at, segment in enumerate(program.segments) if isinstance(segment, LetGo)]
    back = np.array(
        [
            phase in BACK or number in lets_go
            for phase, number in zip(table["phase"], table["segment"], strict=True)
        ],
        dtype=np.bool_,
    )
    tripped = any(state in TRIPPED for state in table["actuator_state"])
    if tripped or not back.any() or not back[-1] or not any(table["held"]):
        return None
    begin = len(back) - int(np.argmin(back[::-1])) if not back.all() else 0
    found = np.zeros(len(back), dtype=np.bool_)
    found[begin:] = [not paused for paused in table["paused"][begin:]]
    unloads = any(phase == Phase.UNLOAD for phase in table["phase"][begin:])
    return found if unloads else None


def _checks(table: Columns, program: Program) -> list[int]:
    """Return the numbers of the checks that were played, in order."""
    segments, played = enumerate(program.segments), set(table["segment"])
    checks = [number for number, one in segments if isinstance(one, LetGo) and one.checks]
    return [number for number in checks if number in played]


def _checked(table: Columns, program: Program, number: int, arm: int) -> tuple[FreeArm, FreedomFit]:
    """Return the motion of an arm in a check, as the controller has seen it.

    The telemetry of a sample names the segment of the next one.
    """
    segment = program.segments[number]
    assert isinstance(segment, LetGo)
    check, fit = segment.checks[arm], FreedomFit()
    rows = zip(
        *(table[name] for name in ("segment", "paused", "t_s", "x_um", "force_mN")), strict=True
    )
    for before, (_, paused, t_s, x_um, force_mN) in pairwise(rows):
        if before[0] == number and not paused and None not in (x_um, force_mN):
            fit = fit.add(check, t_s, x_um, force_mN)
    return check, fit


def _of_arm(
    table: Columns,
    rig: RigFile,
    let_go: Mask,
    checked: tuple[FreeArm, FreedomFit] | None,
) -> OfArm:
    """Judge one arm by its check, otherwise by the last stretch of its return motion."""
    t_s, x_um, force_mN = (series(table, name)[let_go] for name in ("t_s", "x_um", "force_mN"))
    measured = ~np.isnan(x_um + force_mN)
    t_s, x_um, force_mN = t_s[measured], x_um[measured], force_mN[measured]
    # The last stretch may contain a reversal, after which x_1 has an additional error.
    arm, drifts = derived.free_arm(rig, derived.check_way_um(rig)), checked is not None
    if checked is None:
        fit = FreedomFit()
        for row in _last_stretch(arm, rig, t_s, x_um, force_mN):
            fit = fit.add(arm, *row)
    else:
        arm, fit = checked
    freedom = fit.freedom(arm, drifts=drifts)
    if freedom is None:
        return OfArm("unknown", None, None)
    verdict = freedom.verdict(arm)
    if verdict == "released" and _is_pulled(table, let_go):
        verdict = "unknown"
    # With an invalid zero the part may have come off before the release.
    known = verdict == "released" and not zero_invalid(table)
    pull_off = _pull_off_mN(arm, x_um, force_mN) if known else None
    return OfArm(verdict, freedom.stiffness(arm), pull_off)


def _is_pulled(table: Columns, let_go: Mask) -> bool:
    """Return whether a pull beyond its uncertainty remains, as when a part is dragged along."""
    names = ("force_mN", "force_uncertainty_mN", "force_doubt_mN", "zero_age_s")
    rows = np.array([series(table, name)[let_go] for name in names]).T
    last = rows[~np.isnan(rows).any(axis=1)][-SMOOTHED:]
    own_mN = last[:, 1] - last[:, 2]
    return bool(len(last)) and bool((last[:, 0] + own_mN).mean() < 0.0)


def _last_stretch(
    arm: FreeArm, rig: RigFile, t_s: Series, x_um: Series, force_mN: Series
) -> Iterator[tuple[float, float, float]]:
    """Yield time, position and force over the last stretch of the free position in the return
    motion."""
    if not len(x_um):
        return
    free_um = x_um + arm.compliance_um_per_mN * force_mN
    far = np.flatnonzero(np.abs(free_um - free_um[-1]) > WAYS * derived.check_way_um(rig))
    first = int(far[-1]) + 1 if len(far) else 0
    yield from zip(*(each[first:].tolist() for each in (t_s, x_um, force_mN)), strict=True)


def _pull_off_mN(arm: FreeArm, x_um: Series, force_mN: Series) -> tuple[float, float] | None:
    """Return the pull at which the part came off, with its expanded uncertainty, in mN.

    The result is None for too few samples. The pull is the rise of the force while the free
    position moves back, between a line through some samples and the mean of as many samples after
    the oscillation; of several numbers of samples, the one that shows the rise best is used. The
    pull grows until the part comes off, somewhere between two samples: half of the growth per
    sample is added, and any fraction of it is equally likely. At the end of a contact without
    adhesion, the line ends too low by up to a quarter of the growth over its samples. A pull that
    is hidden by that error and by noise is reported as 0.
    """
    free_um = x_um + arm.compliance_um_per_mN * force_mN
    noise_mN, hidden_mN, best = arm.noise_um / arm.compliance_um_per_mN, inf, (1.0, 0.0, 0.0)
    if len(force_mN) < 2 * SMOOTHED + RINGS:
        return None
    steepest_mN = float(np.abs(_lines(force_mN, SMOOTHED)[0]).max())
    for count in AVERAGED:
        error_mN, kink_mN = noise_mN * sqrt(5.0 / count), 0.25 * count * steepest_mN
        if count > AVERAGED[0] and kink_mN > SIGMAS * error_mN:
            break
        places, least_mN = len(force_mN) - 2 * count - RINGS + 1, SIGMAS * error_mN + kink_mN
        slopes, ends_mN = (each[:places] for each in _lines(force_mN, count))
        rises_mN = sliding_window_view(force_mN, count)[count + RINGS :].mean(axis=1) - ends_mN
        ahead_um = sliding_window_view(free_um[count:], RINGS + count).max(axis=1)
        back = (ahead_um <= free_um[count - 1 : count - 1 + places] + arm.noise_um) & (slopes < 0.0)
        hidden_mN = min(hidden_mN, least_mN + steepest_mN)
        shown = np.where(back, rises_mN / least_mN, 0.0)
        at = int(shown.argmax())
        if shown[at] > best[0]:
            growth_mN = -float(slopes[at])
            spread_mN = COVERAGE * sqrt(error_mN**2 + growth_mN**2 / 12.0)
            best = float(shown[at]), float(rises_mN[at]) + 0.5 * growth_mN, spread_mN
    return best[1:] if best[1] else (0.0, hidden_mN)


def _lines(values: Series, count: int) -> tuple[Series, Series]:
    """Return the slope per sample, and the value at the end, of a line through each window."""
    steps, windows = np.arange(count) - 0.5 * (count - 1), sliding_window_view(values, count)
    slopes = windows @ steps / float(steps @ steps)
    return slopes, windows.mean(axis=1) + slopes * steps[-1]
