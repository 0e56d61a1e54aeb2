"""Result of a job, computed from its columns; pure.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Sequence
from math import fsum, hypot, nan, sqrt
from typing import Any, NamedTuple, cast, get_args

import numpy as np

from pincette.api.results import (
    ActionTaken,
    LimitActed,
    LoadForces,
    PositionStep,
    StepCause,
    Tracking,
)
from pincette.api.results import Phase as PlayedPhase
from pincette.api.states import ActionType
from pincette.config import RigFile
from pincette.control.arm.plant import DifferenceEquation, perturbation
from pincette.control.calibration.lines import correlated_samples
from pincette.control.force.estimation import COVERAGE
from pincette.control.force.ring_after_step import RESTED, ring_samples, rings
from pincette.control.planning.contact_line import ContactFit, ContactLine
from pincette.control.planning.paths import Path
from pincette.control.safety.voltage import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN
from pincette.core.faults import TRIPPED, FaultCode, Outcome, Phase
from pincette.records.columns import Columns, missed
from pincette_supervisor.plugin import Run, figures
from pincette_supervisor.plugin.figures import Mask, Series, series, within

PRESSED = ("load", "hold", "settle", "track", "unload", "stopped")
LIMITS = {
    VOLTAGE_MAX: "voltage_max",
    VOLTAGE_MIN: "voltage_min",
    SLEW_UP: "slew_up",
    SLEW_DOWN: "slew_down",
}
"""Bits of ``limits_active`` that the actuator sets."""
ACTIONS = get_args(ActionType)
"""Values of ``acted`` that are actions; ``lease`` precedes a stop that was not requested."""


def common(run: Run) -> dict[str, Any]:
    """Return results that every job of one arm has, by the fields of ``ClosedLoopResult``."""
    table = run.table
    pressed = within(table, PRESSED)
    force, zeroed = series(table, "force_mN"), ~np.isnan(series(table, "zero_age_s"))
    line = contact_fit(table)
    stroke = stroke_of(table)
    return {
        **course(table, period_s=run.period_s, dropped=run.dropped),
        "force_assumed": run.force_assumed,
        "contact_load": load_forces(table),
        "contact_x_um": figures.last(table["contact_x_um"]),
        "contact_x_error_um": None if line is None else line.x_e_error_um,
        "contact_stiffness_mN_per_um": figures.last(table["contact_stiffness_mN_per_um"]),
        "contact_stiffness_error_mN_per_um": None if line is None else line.K_e_error_mN_per_um,
        "stroke_change_percent": stroke.change_percent,
        "stroke_limit_percent": stroke.limit_percent,
        "model_mismatch": stroke.mismatch,
        "zero_unconfirmed": zero_unconfirmed(table),
        "zero_invalid": zero_invalid(table),
        "peak_force_mN": figures.largest(force, zeroed),
        "final_force_mN": None if zero_lost(table) else figures.last(force[zeroed].tolist()),
        "contact_rmse_position_um": figures.rms(position_error(table), pressed),
        "contact_rmse_force_mN": figures.rms(force_error(table), pressed),
        **law_figures(table, run.plant),
    }


class Stroke(NamedTuple):
    """Last measured change of an arm's stroke since its calibration; None: not measured."""

    change_percent: float | None
    limit_percent: float | None
    """Largest change that noise and repeatability explain, in %."""

    @property
    def mismatch(self) -> bool:
        """Return True if noise and repeatability do not explain the change."""
        if self.change_percent is None or self.limit_percent is None:
            return False
        return abs(self.change_percent) > self.limit_percent


def stroke_of(table: Columns) -> Stroke:
    """Return the last measured change of the stroke."""
    return Stroke(_percent(table["stroke_change"]), _percent(table["stroke_limit"]))


def zero_unconfirmed(table: Columns) -> bool:
    """Return True if the newest zero may hide the force of a part that was already pressing."""
    rows = zip(table["zero_age_s"], table["zero_unconfirmed"], strict=True)
    zeroed = [unconfirmed for age_s, unconfirmed in rows if age_s is not None]
    return bool(zeroed) and bool(zeroed[-1])


def zero_invalid(table: Columns) -> bool:
    """Return True if the zero of the force has become invalid, since a held part read a pull."""
    rows = zip(table["zero_refusal"], table["estimate_valid"], strict=True)
    return any(code == FaultCode.ZERO_INVALID and valid for code, valid in rows)


def zero_lost(table: Columns) -> bool:
    """Return True if the newest valid estimate has no zero, so that its force is not known."""
    rows = zip(table["zero_age_s"], table["estimate_valid"], strict=True)
    ages_s = [age_s for age_s, valid in rows if valid]
    return not ages_s or ages_s[-1] is None


def _percent(shares: Sequence[float | None]) -> float | None:
    """Return the last value of a share in percent; None without a value."""
    share = figures.last(shares)
    return None if share is None else 100.0 * share


def course(table: Columns, *, period_s: float, dropped: int) -> dict[str, Any]:
    """Return results on the course of a job, independent of its kind."""
    answered = [value for value in table["answered"] if value is not None]
    return {
        "outcome": outcome_of(table),
        "phases": phases(table["phase"], table["t_s"], period_s),
        "limits_acted": _limits(table),
        "actions": [
            ActionTaken(type=cast(ActionType, word), seq=seq)
            for seq, words in zip(table["seq"], table["acted"], strict=True)
            for word in (words or "").split()
            if word in ACTIONS
        ],
        "use": None,  # counted from the samples by ``arm_use``
        "goal": None,  # compared with the request's tolerances by ``goal_of``
        "samples": len(table["seq"]),
        "missed_ticks": missed(table),
        "unanswered_ticks": answered.count(False),
        "dropped_messages": dropped,
        "touch_x_um": figures.last(table["touch_x_um"]),
        "touch_force_mN": figures.last(table["touch_mN"]),
        "position_step": position_step_of(table),
        "place": None,  # compared with the place that the request gives by ``place_found``
    }


def tracking(error: Series, mask: Mask, pp: float | None) -> Tracking | None:
    """Return errors over the chosen samples; None without a sample.

    Parameters
    ----------
    pp
        Peak-to-peak value of the reference; None if it rests.
    """
    rmse, most = figures.rms(error, mask), figures.largest(np.abs(error), mask)
    if rmse is None or most is None:
        return None
    return Tracking(rmse=rmse, rmse_percent=100.0 * rmse / pp if pp else None, maximum=most)


def full_amplitude(run: Run, paths: Sequence[Path], cycles: int = 0) -> Mask:
    """Return samples with all paths at full amplitude, in whole cycles if the paths are periodic.

    The references of a sample are those of the previous tick, hence of ``segment_tick`` - 1.

    Parameters
    ----------
    cycles
        Number of last cycles that count, for a path with cycles; 0 for all.
    """
    table, slack_s = run.table, 1e-6 * run.period_s
    t_s = (series(table, "segment_tick") - 1.0) * run.period_s
    from_s = max(path.full_from_s for path in paths)
    to_s = min(path.full_to_s for path in paths)
    if cycles:
        from_s = max(from_s, to_s - cycles * paths[0].cycle_s)
    since, until = t_s > from_s - slack_s, t_s < to_s - slack_s
    return within(table, ["track"]) & (t_s >= 0.0) & since & until


def position_error(table: Columns) -> Series:
    """Return the position error x - x_r, in µm."""
    return series(table, "x_um") - series(table, "x_r_um")


def force_error(table: Columns) -> Series:
    """Return the force error F̂ - F_r, in mN."""
    return series(table, "force_mN") - series(table, "force_r_mN")


def load_forces(table: Columns) -> LoadForces | None:
    """Return the lowest and the highest force of the load phase, in mN; None without one."""
    loaded = series(table, "force_mN")[within(table, ["load"])]
    known = loaded[~np.isnan(loaded)]
    if not known.size:
        return None
    return LoadForces(lowest_mN=float(known.min()), highest_mN=float(known.max()))


def contact_fit(table: Columns) -> ContactFit | None:
    """Fit the contact line over the load as the controller does, to get its standard errors.

    The standard errors are those of as many independent samples as the residuals show, since
    neighbouring samples share an error of x_1. An error that all samples share is an error of the
    force at the start of the load: it shifts x_e by that force over K_e and leaves no residual. An
    error that grows with the load, as the stated uncertainty does, is an error of K_e by the same
    fraction of the force. The deviation of the force at rest in the hold from the line is treated
    in the same way, since the line was fitted during motion.
    """
    line = ContactLine()
    names = ("x_um", "force_mN", "force_r_mN", "force_uncertainty_mN")
    rows = zip(table["phase"], *(table[name] for name in names), strict=True)
    loaded: list[list[float]] = []
    held: list[list[float]] = []
    for phase, *row in rows:
        if phase == "contact":  # a further grip has a line of its own
            line, loaded = ContactLine(), []
        if phase == "hold" and None not in row:
            held.append(cast("list[float]", row))
        if phase == "load" and None not in row:
            loaded.append(cast("list[float]", row))
            line = line.add(*loaded[-1][:3])
    fit = line.fit()
    if fit is None:
        return None
    K_e, x_e_um = fit.K_e_mN_per_um, fit.x_e_um
    more = sqrt(correlated_samples([F - K_e * (x - x_e_um) for x, F, *_ in loaded]))
    (_, F_0, _, U_0), (_, F_1, _, U_1) = loaded[0], loaded[-1]
    grown_mN = sqrt(max(0.0, U_1 * U_1 - U_0 * U_0)) / COVERAGE
    off_mN = fsum(F - K_e * (x - x_e_um) for x, F, *_ in held) / len(held) if held else 0.0
    share = hypot(grown_mN, off_mN) / abs(F_1 - F_0) if F_1 != F_0 else 0.0
    return fit._replace(
        x_e_error_um=hypot(more * fit.x_e_error_um, U_0 / COVERAGE / abs(K_e)),
        K_e_error_mN_per_um=hypot(more * fit.K_e_error_mN_per_um, share * K_e),
    )


def phases(names: Sequence[str | None], t_s: Sequence[float], period_s: float) -> list[PlayedPhase]:
    """Return the phases in order, as runs of samples.

    A sample without a phase belongs to the previous phase.
    """
    found: list[tuple[str, float, float]] = []
    for name, start_s in zip(names, t_s, strict=True):
        if name is not None and (not found or found[-1][0] != name):
            found.append((name, start_s, start_s))
        if found:
            found[-1] = (*found[-1][:2], start_s + period_s)
    return [
        PlayedPhase(phase=name, start_s=start_s, duration_s=end_s - start_s)
        for name, start_s, end_s in found
    ]


def outcome_of(table: Columns) -> str:
    """Return the controller's final outcome, or the actuator's if it tripped."""
    if any(state in TRIPPED for state in table["actuator_state"]):
        return "tripped"
    reported = [outcome for outcome in table["outcome"] if outcome]
    if reported:
        return str(reported[-1])
    released = any("release" in (words or "") for words in table["acted"])
    return "released" if released else "unfinished"


def _limits(table: Columns) -> list[LimitActed]:
    acted: dict[str, list[int]] = {}
    for seq, bits in zip(table["seq"], table["limits_active"], strict=True):
        for bit, name in LIMITS.items():
            if cast("int | None", bits) and bits & bit:
                acted.setdefault(name, []).append(seq)
    return [
        LimitActed(limit=name, first_seq=seqs[0], samples=len(seqs)) for name, seqs in acted.items()
    ]


def law_figures(table: Columns, plant: DifferenceEquation) -> dict[str, Any]:
    """Return the results of the law, by the fields of ``ClosedLoopResult``.

    Parameters
    ----------
    table
        Columns of the epoch, with one row for each sample; see ``columns``.
    plant
        Plant model of the arm in the law's parameter set.
    """
    return {
        "sliding_um": figures.percentiles(series(table, "sliding_um")),
        "sliding_in_band": _share_in_band(table),
        "residual_um": figures.percentiles(series(table, "residual_um")),
        "law_perturbation_mN": figures.percentiles(series(table, "law_perturbation_mN")),
        "perturbation_error_mN": figures.percentiles(series(table, "perturbation_error_mN")),
        "true_perturbation_error_mN": figures.percentiles(true_perturbation_error(table, plant)),
    }


def true_perturbation_error(table: Columns, plant: DifferenceEquation) -> Series:
    """Return p̃, in mN, from the measured position, the applied voltage and the true force.

    p̃_k = p̂_k - p_k = p_{k-1} - p_k, p by (6) (8)

    If F is estimated from the same x and u, p̃ compares a model with a model; this p̃ compares the
    law's plant with the arm. It is NaN if one of its samples is missing or invalid, and always NaN
    on a real rig, where the true force is unknown.
    """
    measured = series(table, "position_valid") == 1.0
    x_um = np.where(measured, series(table, "x_um"), np.nan)
    # The voltage of a row is output after its position was measured: it causes the next one.
    rows = zip(
        x_um.tolist(),
        _before(table, x_um, 1).tolist(),
        _before(table, x_um, 2).tolist(),
        _before(table, series(table, "voltage_V"), 1).tolist(),
        series(table, "true_force_mN").tolist(),
        strict=True,
    )
    p_mN = np.array(
        [
            perturbation(
                plant, x_um=x, x_1_um=x_1, x_2_um=x_2, voltage_V=voltage_V, force_mN=force_mN
            )
            for x, x_1, x_2, voltage_V, force_mN in rows
        ],
        dtype=np.float64,
    )
    return _before(table, p_mN, 1) - p_mN


def _before(table: Columns, values: Series, ticks: int) -> Series:
    """Return each row's value a number of ticks earlier; NaN for a missing sample."""
    of_seq = dict(zip(table["seq"], values.tolist(), strict=True))
    found = [of_seq.get(seq - ticks, nan) for seq in table["seq"]]
    return np.array(found, dtype=np.float64)


def _share_in_band(table: Columns) -> float | None:
    """Return the share of samples with |s| within its band; None without a sample."""
    within = np.abs(series(table, "sliding_um")) - series(table, "band_um")
    found = within[~np.isnan(within)]
    return float(np.mean(found <= 0.0)) if found.size else None


RETURN_SAMPLES = 10
"""Number of samples at the end of the return motion whose mean force tells a slip from a sensor
jump.
"""


def position_step_of(table: Columns) -> PositionStep | None:
    """Return the position step that the voltage does not explain; None without a step.

    The controller reports the step r, the force F just before it, and the force F' just after it.
    If the part yielded by δ, F' is the force and δ = r + (F - F')/K_e; if the sensor jumped by r,
    the force is still F and the free arm reads F' - F afterwards. Therefore the force that is read
    in the return motion shows the cause, within its uncertainty.
    """
    steps_um = table["step_um"]
    row = next((place for place, step_um in enumerate(steps_um) if step_um is not None), None)
    if row is None:
        return None
    step_um, x_um, before_mN, after_mN = (
        float(figures.last(table[name]) or 0.0)
        for name in ("step_um", "step_x_um", "step_mN", "step_after_mN")
    )
    stiffness, slips = table["contact_stiffness_mN_per_um"][row], _newest(table["slips"]) or 0
    source = _source(table, step_um, before_mN - after_mN)
    slip_um = None
    if source != "sensor" and stiffness:
        slip_um = step_um + (before_mN - after_mN) / stiffness
    return PositionStep(
        cause=source,
        at_s=table["t_s"][row],
        x_um=x_um,
        step_um=step_um,
        slip_um=slip_um,
        slips=slips,
        force_mN=before_mN,
        force_if_slip_mN=None if source == "sensor" else after_mN,
        force_if_sensor_mN=None if source == "slip" else before_mN,
    )


def with_ring(found: PositionStep, table: Columns, rig: RigFile) -> PositionStep:
    """Add whether the arm oscillated after the step; this is known only if the voltage was kept
    after it.
    """
    model = rig.model
    row = next(place for place, step_um in enumerate(table["step_um"]) if step_um is not None)
    first = max(0, row - 1)  # the row is the sample that confirmed the step
    stiffness = table["contact_stiffness_mN_per_um"][row] or rig.part.stiffness_mN_per_um
    kappa = model.compliance_um_per_mN * stiffness
    decay_per_s = model.damping_ratio * model.natural_frequency_rad_per_s
    rows = slice(first, first + ring_samples(decay_per_s, rig.rig.period_s) + RESTED)
    x_um, voltage_V, seq = (series(table, name)[rows] for name in ("x_um", "voltage_V", "seq"))
    if np.ptp(voltage_V[1:]) > 0.0 or (np.diff(seq) != 1.0).any():
        return found
    rang = rings(
        x_um,
        mode_rad_per_s=model.natural_frequency_rad_per_s * sqrt(1.0 + kappa),
        decay_per_s=decay_per_s,
        period_s=rig.rig.period_s,
        noise_um=rig.sensor.noise_um,
    )
    return found.model_copy(update={"rang": rang})


def _source(table: Columns, step_um: float, lost_mN: float) -> StepCause:
    if Outcome.SENSOR_JUMP in table["outcome"] or step_um < 0.0:
        return "sensor"
    names = ("phase", "held", "force_mN", "force_uncertainty_mN", "force_doubt_mN")
    returned = [
        (force_mN, uncertainty_mN - doubt_mN)
        for phase, held, force_mN, uncertainty_mN, doubt_mN in zip(
            *(table[name] for name in names), strict=True
        )
        if phase == Phase.RETREAT and not held and None not in (force_mN, uncertainty_mN)
    ][-RETURN_SAMPLES:]
    if not returned:
        return "unknown"
    read_mN = sum(force_mN for force_mN, _ in returned) / len(returned)
    # Midway between the two possible readings of a free arm: 0 after a slip, -lost_mN after a jump.
    off_mN, doubt_mN = read_mN + 0.5 * lost_mN, returned[-1][1]
    if abs(off_mN) <= doubt_mN:
        return "unknown"
    return "slip" if off_mN > 0.0 else "sensor"


def _newest(values: Sequence[Any]) -> Any:
    return next((value for value in reversed(values) if value is not None), None)
