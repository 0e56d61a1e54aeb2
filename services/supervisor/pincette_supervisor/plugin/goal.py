"""Goal of a job: whether its errors stayed within the requested tolerances; pure."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from pincette.api.plans import PlannedGoal
from pincette.api.requests import GoalRequest
from pincette.api.results import Goal
from pincette.config import RigFile, derived
from pincette.control.planning.program import Program
from pincette.records.columns import Columns
from pincette_supervisor.plugin.figures import Series, within
from pincette_supervisor.plugin.result import force_error, position_error

SETTLING_S = 0.5
"""Settling time of a request that specifies none, in s."""
NOISE_DEVIATIONS = 3.0
"""Number of standard deviations of the noise that about one sample in a hundred exceeds."""
TOLERANCES = ("position_tolerance_um", "force_tolerance_mN")
PAST_HIDES_MN = "past_hides_mN"
"""Name of the plan value with the force uncertainty due to the arm's unknown history, in mN; set
if the force tolerance does not exceed that uncertainty."""


def tolerances(request: GoalRequest) -> dict[str, Any]:
    """Return the requested tolerances as values of the plan; empty without a tolerance."""
    named = {name: value for name in TOLERANCES if (value := getattr(request, name)) is not None}
    if not named:
        return {}
    settling_s = SETTLING_S if request.settling_s is None else request.settling_s
    return {**named, "settling_s": settling_s}


def planned_goal(values: Mapping[str, Any], program: Program, phase: str) -> PlannedGoal | None:
    """Return the goal of a plan, and whether it will be evaluated; None without a tolerance.

    Parameters
    ----------
    values
        See ``tolerances``.
    phase
        Goal phase; the last segment of that name counts.
    """
    settling_s = values.get("settling_s")
    lasts_s = [segment.duration_s for segment in program.segments if segment.phase == phase]
    if settling_s is None or not lasts_s:
        return None
    last_s = lasts_s[-1]
    judged = (last_s is None or last_s > settling_s) and PAST_HIDES_MN not in values
    return PlannedGoal(judged=judged, phase=phase, lasts_s=last_s, settling_s=settling_s)


def goal_warnings(
    values: Mapping[str, Any], program: Program, phase: str, rig: RigFile
) -> list[str]:
    """Return reasons why the goal of a plan cannot be met; empty if it can be met.

    Parameters
    ----------
    values, phase
        As for ``planned_goal``.
    rig
        Rig whose noise the tolerances must exceed.
    """
    found: list[str] = []
    goal = planned_goal(values, program, phase)
    if (hidden_mN := values.get(PAST_HIDES_MN)) is not None:
        found.append(
            f"the error of the force may reach {hidden_mN:.2g} mN because of the arm's "
            "unknown past, which is not below force_tolerance_mN: whether the goal is met "
            "will not be judged; request conditioning strokes, or give a larger tolerance"
        )
    elif goal is not None and not goal.judged:
        found.append(
            f"the {phase} of {goal.lasts_s:g} s is not longer than settling_s = "
            f"{goal.settling_s:g} s: whether the goal is met will not be judged; plan a longer "
            f"{phase}, or give a shorter settling_s"
        )
    noise_um = rig.sensor.noise_um
    gain = derived.force_observer(rig).noise_gain
    noise_mN = noise_um / rig.model.compliance_um_per_mN * gain
    for name, noise, unit in zip(TOLERANCES, (noise_um, noise_mN), ("µm", "mN"), strict=True):
        tolerance = values.get(name)
        if tolerance is not None and tolerance < NOISE_DEVIATIONS * noise:
            found.append(
                f"{name} = {tolerance:g} {unit} is below {NOISE_DEVIATIONS * noise:.3g} "
                f"{unit}, {NOISE_DEVIATIONS:g} standard deviations of a sample's noise: "
                "noise alone exceeds the tolerance"
            )
    return found


def goal_of(
    table: Columns,
    values: Mapping[str, Any],
    phase: str,
    period_s: float,
    *,
    completed: bool = False,
) -> Goal | None:
    """Compare the errors of a phase with the tolerances of a plan.

    With t from the start of the phase, the errors e = x - x_r and e = F̂ - F_r have settled at the
    smallest t_s with |e(t)| <= tolerance for every t >= t_s; the goal is met if t_s <=
    ``settling_s``.

    Parameters
    ----------
    table
        Columns of the job.
    values
        Values of the plan; see ``tolerances``.
    phase
        Goal phase of the plan; if there are several of that name, the last one counts.
    period_s
        Control period.
    completed
        True if the job ended as planned. Its goal is not evaluated if the phase was not longer than
        the settling time, or if the force uncertainty due to the arm's unknown history is at least
        the tolerance; a job that ended early has missed its goal.

    Returns
    -------
    Goal or None
        None if the values contain no tolerance.
    """
    limits: list[float | None] = [values.get(name) for name in TOLERANCES]
    if limits == [None, None]:
        return None
    settling_s = float(values["settling_s"])
    stretch = _last_stretch(np.flatnonzero(within(table, [phase])))
    skipped = int(np.ceil(settling_s / period_s - 1e-9))
    # Ticks since the start of the phase; missing rows are left out.
    ticks = np.array(table["seq"], dtype=np.int64)[stretch]
    ticks -= ticks[0] if ticks.size else 0
    errors: list[float | None] = []
    settled: list[int | None] = []
    for limit, error in zip(limits, (position_error(table), force_error(table)), strict=True):
        if limit is None:
            errors.append(None)
            continue
        size = np.abs(error[stretch])
        after = size[ticks >= skipped]
        known = after[~np.isnan(after)]
        errors.append(float(known.max()) if known.size else None)
        row = _settled(size, limit)
        settled.append(None if row is None else int(ticks[row]))
    last = None if None in settled else max(index for index in settled if index is not None)
    settled_s = None if last is None else last * period_s
    lasts = int(ticks[-1]) + 1 if ticks.size else 0
    unjudged = completed and (lasts <= skipped or PAST_HIDES_MN in values)
    return Goal(
        met=None if unjudged else last is not None and last <= skipped < lasts,
        settling_s=settling_s,
        settled_s=settled_s,
        position_tolerance_um=limits[0],
        position_error_um=errors[0],
        force_tolerance_mN=limits[1],
        force_error_mN=errors[1],
    )


def _last_stretch(
    places: "np.ndarray[Any, np.dtype[np.intp]]",
) -> "np.ndarray[Any, np.dtype[np.intp]]":
    """Return the samples after the last gap."""
    gaps = np.flatnonzero(np.diff(places) > 1)
    return places[gaps[-1] + 1 :] if gaps.size else places


def _settled(size: Series, limit: float) -> int | None:
    """Return the index from which a magnitude stays within its limit; None if it does not.

    A missing sample is ignored; without any sample, nothing has settled.
    """
    if not np.any(~np.isnan(size)):
        return None
    beyond = np.flatnonzero(size > limit)
    first = int(beyond[-1]) + 1 if beyond.size else 0
    return first if first < len(size) and np.any(~np.isnan(size[first:])) else None
