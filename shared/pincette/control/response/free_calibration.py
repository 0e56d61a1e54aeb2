"""Calibration of the free response: measured gain, loop and creep, and the identified model.

The model is identified from the first part of the record, the course. The settled cycles are not
used for the fit; they give the gain d_p of the arm and of the model. A motion with a kink, as a
part in the path of the arm causes it, is refused unless an operator has confirmed that there is no
part.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.free_motion import (
    Creep,
    SecantGain,
    creep_after_step,
    secant_gain,
)
from pincette.control.checks import require_as_many
from pincette.control.response.branch_fit import ConditionedWay, measured_branch
from pincette.control.response.conditioned_branch import ConditionedBranch
from pincette.control.response.contact_kink import ContactKink, contact_kink
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import simulate
from pincette.control.response.identification import (
    Identification,
    identify_free_response,
)
from pincette.control.response.model_errors import (
    Forgetting,
    Rehearsed,
    RehearsedGrip,
    Value,
    line_error,
    rehearsed_errors,
    return_error,
    turn_error,
    unknown_forgetting,
)

CREEP_FROM_S = 0.1
"""Time since the end of the step, in s, from which creep is fitted. Before this time the arm still
rings."""
BEFORE_S = 0.5
"""Time before the step, in s, over which the arm's position is averaged."""

LARGEST_RESIDUAL = 0.02
"""Largest permitted residual of a model in addition to noise, as a fraction of the range. Typical
residuals are 0.1 to 1 % for all classes of hysteresis."""
NOISES = 3.0

Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """One record of a free arm, N samples of matched ages: ``voltage_V[k]`` led to ``x_um[k]``.

    It begins with the course, the samples from which the model is identified. The slices select the
    cycles and the presses at full amplitude, the rest before the step, the rest after it, and the
    rehearsed grips.
    """

    voltage_V: Sequence[float] | Column
    x_um: Sequence[float] | Column
    period_s: float
    course: slice
    cycles: slice
    presses: slice
    before_step: slice
    after_step: slice
    grips: Sequence[RehearsedGrip]
    conditioned: Sequence[ConditionedWay] = ()


@dataclass(frozen=True, slots=True)
class FreeCalibration:
    """Results of the calibration from a free motion."""

    gain: SecantGain
    """Gain d_p of the arm."""
    creep: Creep
    model: HysteresisModel
    model_residual_um: float
    """R.m.s. error in µm over the samples of the course that were not used for the fit."""
    model_gain: SecantGain
    """Gain of the model in the same cycles, whose voltages may exceed those of the course."""
    press_gain: float
    """Ratio of the measured stroke of the presses to the stroke of the model."""
    cycles_residual_um: float
    """R.m.s. residual of the model over the cycles, minus its mean, in µm."""
    line_error: Value
    """Error of a straight line used instead of the model, as a fraction of the travel."""
    forgetting: Forgetting
    """Error of the model after a small alternating motion."""
    rehearsed: Rehearsed
    """Errors of the model after a zero, from rehearsed grips."""
    return_error_um: float | None
    """Error of the model, in µm, when the arm returns to the position at which the force was
    zeroed; see ``return_error``. The larger one of the errors with and without conditioning
    strokes."""
    turn_error_um_per_V: float | None
    """Error of the model's slope just after a turning point, in µm/V; see ``turn_error``."""
    branch: ConditionedBranch | None
    """Rising branch after conditioning strokes; None without strokes."""
    unpoled: bool
    """True if the model was fitted under the assumption that the actuator had no memory at the
    start."""
    t_s: Column
    voltage_V: Column
    x_um: Column
    model_um: Column
    """Positions of the model over the whole record, in µm, with an offset so that the mean over the
    course equals that of ``x_um``."""
    kink: ContactKink | None = None
    """Kink in the motion, if an operator has confirmed that there was no part."""


def calibrate_free_response(
    motion: FreeMotion,
    samples_per_cycle: float,
    *,
    unpoled: bool | None = None,
    no_part: bool = False,
) -> FreeCalibration:
    """Return gain, hysteresis loop, creep and model of a free motion.

    Parameters
    ----------
    unpoled
        True if the actuator began at 0 V without a memory, because it has not moved since it was
        switched on. None selects the assumption with the smaller residual over samples that were
        not used for the fit.
    no_part
        True if an operator has confirmed that no part is in the gripper. A kink in the motion,
        which free arms with some classes of hysteresis show too, is then returned as ``kink``.

    Raises
    ------
    ValueError
        For the reasons given in ``identify_free_response``, ``secant_gain`` and
        ``creep_after_step``; if the motion has a kink at one position, as a part causes it, and
        ``no_part`` is false; or if the residual of the model exceeds noise and
        ``LARGEST_RESIDUAL``.
    """
    u = np.asarray(motion.voltage_V, dtype=np.float64)
    x = np.asarray(motion.x_um, dtype=np.float64)
    require_as_many("voltages", u, "positions", x)
    kink = contact_kink(u, x, motion.period_s, motion.course)
    if kink is not None and not no_part:
        raise ValueError(
            f"{kink_text(kink)}. A part seems to be in the way: remove it from the gripper, "
            "or from the range of the arm, and calibrate again; if you have checked that no "
            "part is there, send no_part = true"
        )
    identified, begun_unpoled = _identified(u[motion.course], x[motion.course], motion, unpoled)
    free = simulate(identified.model, u, motion.period_s)
    level = float(np.mean((x - free)[motion.course]))
    left = x - free - level
    creep = _creep(u, x, motion)
    gain = secant_gain(u[motion.cycles], x[motion.cycles], samples_per_cycle)
    presses = secant_gain(u[motion.presses], x[motion.presses], samples_per_cycle)
    modelled = secant_gain(u[motion.presses], free[motion.presses], samples_per_cycle)
    cycles_residual_um = float(np.std(left[motion.cycles]))
    swings = [grip.swings for grip in motion.grips if grip.swings is not None]
    noise_um = _noise_um(creep)
    _require_explained(max(identified.residual_um, cycles_residual_um), x, noise_um)
    measured = measured_branch(identified.model, u, x, motion.period_s, motion.conditioned)
    returns_um = [
        error_um
        for error_um in (
            return_error(x, left, motion.period_s, motion.grips),
            None if measured is None else measured.return_error_um,
        )
        if error_um is not None
    ]
    rehearsed = rehearsed_errors(u, left, motion.period_s, motion.grips)
    branch = None if measured is None else measured.branch
    if identified.model.return_fadings_per_V:
        # Such a model fits rehearsed grips better than it fits other motions. Real grips differ
        # from rehearsed ones: noise and the law reverse the voltage, and this arm remembers each
        # reversal.
        least_um = sqrt(max(0.0, identified.residual_um**2 - noise_um**2))
        rehearsed = rehearsed._replace(growth=rehearsed.growth.at_least(least_um))
        if branch is not None:
            branch = branch.at_least(least_um)
    return FreeCalibration(
        gain=gain,
        creep=creep,
        model=identified.model,
        model_residual_um=identified.residual_um,
        model_gain=secant_gain(u[motion.cycles], free[motion.cycles], samples_per_cycle),
        press_gain=presses.stroke_um / modelled.stroke_um,
        cycles_residual_um=cycles_residual_um,
        line_error=line_error((gain, presses)),
        forgetting=unknown_forgetting(u, left, motion.period_s, swings),
        rehearsed=rehearsed,
        return_error_um=max(returns_um, default=None),
        turn_error_um_per_V=turn_error(u, left, motion.period_s, motion.grips),
        branch=branch,
        unpoled=begun_unpoled,
        t_s=np.arange(len(u), dtype=np.float64) * motion.period_s,
        voltage_V=u,
        x_um=x,
        model_um=free + level,
        kink=kink,
    )


def kink_text(kink: ContactKink) -> str:
    """Describe the kink of a free motion in words."""
    return (
        f"the motion changes its slope at {kink.x_um:.1f} µm ({kink.voltage_V:.2f} V on the "
        "way up), on each way up and down: beyond it the arm moves by "
        f"{100.0 * kink.slope_share:.0f} % of what it moves below"
    )


def _noise_um(creep: Creep) -> float:
    """Return the noise of a position in µm.

    It is computed from differences of successive samples, so that slow vibration has no effect.
    """
    return float(np.std(np.diff(creep.line.residuals))) / sqrt(2.0)


def _require_explained(residual_um: float, x: Column, noise_um: float) -> None:
    limit_um = LARGEST_RESIDUAL * float(np.ptp(x)) + NOISES * noise_um
    if residual_um > limit_um:
        raise ValueError(
            f"the residual of the model is {residual_um:.3f} µm r.m.s., limit {limit_um:.3f} "
            f"µm: {100.0 * LARGEST_RESIDUAL:g} % of the range and {NOISES:g} times the noise "
            f"of {noise_um:.3f} µm. Something other than hysteresis and creep moves the arm: "
            "remove what it may touch, wait until the bench is at rest, and calibrate again"
        )


def _identified(
    u: Column, x: Column, motion: FreeMotion, unpoled: bool | None
) -> tuple[Identification, bool]:
    tried = (False, True) if unpoled is None else (unpoled,)
    found: list[tuple[Identification, bool]] = []
    for begins_unpoled in tried:
        identification = identify_free_response(
            u.tolist(), x.tolist(), motion.period_s, unpoled=begins_unpoled
        )
        found.append((identification, begins_unpoled))
    return min(found, key=lambda each: each[0].residual_um)


def _creep(u: Column, x: Column, motion: FreeMotion) -> Creep:
    """Return the creep after the step.

    Times are counted from the middle of the step.
    """
    step_from, step_to = motion.before_step.stop, motion.after_step.start
    step = slice(step_from - 1, step_to + 1)
    made = np.abs(np.diff(u[step]))
    if not float(np.sum(made)) > 0.0:
        raise ValueError(f"the voltage rests in samples {step_from} to {step_to}, must be a step")
    middle = step_from + float(made @ np.arange(len(made))) / float(np.sum(made))
    index = np.arange(motion.after_step.start, motion.after_step.stop, dtype=np.float64)
    settled = index >= step_to + CREEP_FROM_S / motion.period_s
    resting = x[motion.before_step][-max(1, round(BEFORE_S / motion.period_s)) :]
    since_s = (index[settled] - middle) * motion.period_s
    return creep_after_step(since_s, x[motion.after_step][settled], float(np.mean(resting)))
