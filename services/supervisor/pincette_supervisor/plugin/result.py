"""What a job came to, from its columns; pure."""

from collections.abc import Sequence
from math import fsum, hypot, sqrt
from typing import Any, NamedTuple, cast, get_args

import numpy as np

from pincette.api.results import ActionTaken, LimitActed, LoadForces, Phase
from pincette.api.states import ActionType
from pincette.control.arm.plant import DifferenceEquation
from pincette.control.calibration.lines import correlated_samples
from pincette.control.force.estimation import COVERAGE
from pincette.control.planning.contact_line import ContactFit, ContactLine
from pincette.control.safety.voltage import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN
from pincette.core.faults import TRIPPED
from pincette.records.columns import Columns, missed
from pincette_supervisor.plugin import sample_figures
from pincette_supervisor.plugin.law_result import law_figures
from pincette_supervisor.plugin.position_step import position_step_of
from pincette_supervisor.plugin.sample_figures import Series, series, within

PRESSED = ("load", "hold", "settle", "track", "unload", "stopped")
LIMITS = {
    VOLTAGE_MAX: "voltage_max",
    VOLTAGE_MIN: "voltage_min",
    SLEW_UP: "slew_up",
    SLEW_DOWN: "slew_down",
}
"""The actuator's bits of ``limits_active``."""
ACTIONS = get_args(ActionType)
"""Words of ``acted`` that are actions: ``lease`` stands before a stop that nobody has asked for."""


def common(
    table: Columns,
    *,
    plant: DifferenceEquation,
    period_s: float,
    dropped: int,
    force_assumed: Sequence[str],
) -> dict[str, Any]:
    """Figures that every job has, by the fields of ``ClosedLoopResult``.

    ``force_assumed`` names what the force's uncertainty takes for granted.
    """
    pressed = within(table, PRESSED)
    force, zeroed = series(table, "force_mN"), ~np.isnan(series(table, "zero_age_s"))
    line = contact_fit(table)
    stroke = stroke_of(table)
    return {
        **course(table, period_s=period_s, dropped=dropped),
        "force_assumed": list(force_assumed),
        "contact_load": load_forces(table),
        "contact_x_um": sample_figures.last(table["contact_x_um"]),
        "contact_x_error_um": None if line is None else line.x_e_error_um,
        "contact_stiffness_mN_per_um": sample_figures.last(table["contact_stiffness_mN_per_um"]),
        "contact_stiffness_error_mN_per_um": None if line is None else line.K_e_error_mN_per_um,
        "stroke_change_percent": stroke.change_percent,
        "stroke_limit_percent": stroke.limit_percent,
        "model_mismatch": stroke.mismatch,
        "zero_unconfirmed": zero_unconfirmed(table),
        "peak_force_mN": sample_figures.largest(force, zeroed),
        # Without a zero the estimate has no reference, and the force is not known.
        "final_force_mN": sample_figures.last(np.where(zeroed, force, np.nan).tolist()),
        "contact_rmse_position_um": sample_figures.rms(position_error(table), pressed),
        "contact_rmse_force_mN": sample_figures.rms(force_error(table), pressed),
        **law_figures(table, plant),
    }


class Stroke(NamedTuple):
    """Change of an arm's stroke since its calibration, as compared last; None: not compared."""

    change_percent: float | None
    limit_percent: float | None
    """Change up to which noise and repetition explain it."""

    @property
    def mismatch(self) -> bool:
        """True where noise and repetition do not explain the change."""
        if self.change_percent is None or self.limit_percent is None:
            return False
        return abs(self.change_percent) > self.limit_percent


def stroke_of(table: Columns) -> Stroke:
    """Return the change of the stroke that was compared last."""
    return Stroke(_percent(table["stroke_change"]), _percent(table["stroke_limit"]))


def zero_unconfirmed(table: Columns) -> bool:
    """Return True where the newest zero may hide the force of a part that pressed already."""
    rows = zip(table["zero_age_s"], table["zero_unconfirmed"], strict=True)
    zeroed = [unconfirmed for age_s, unconfirmed in rows if age_s is not None]
    return bool(zeroed) and bool(zeroed[-1])


def _percent(shares: Sequence[float | None]) -> float | None:
    """Return the last share in percent; None where there is none."""
    share = sample_figures.last(shares)
    return None if share is None else 100.0 * share


def course(table: Columns, *, period_s: float, dropped: int) -> dict[str, Any]:
    """How a job went, whatever it was for."""
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
        "goal": None,  # held against the request's tolerances by ``goal_of``
        "samples": len(table["seq"]),
        "missed_ticks": missed(table),
        "unanswered_ticks": answered.count(False),
        "dropped_messages": dropped,
        "touch_x_um": sample_figures.last(table["touch_x_um"]),
        "touch_force_mN": sample_figures.last(table["touch_mN"]),
        "position_step": position_step_of(table),
    }


def position_error(table: Columns) -> Series:
    """Return x - x_r."""
    return series(table, "x_um") - series(table, "x_r_um")


def force_error(table: Columns) -> Series:
    """Return F̂ - F_r."""
    return series(table, "force_mN") - series(table, "force_r_mN")


def load_forces(table: Columns) -> LoadForces | None:
    """Return the lowest and the highest force of the load; None without one."""
    loaded = series(table, "force_mN")[within(table, ["load"])]
    known = loaded[~np.isnan(loaded)]
    if not known.size:
        return None
    return LoadForces(lowest_mN=float(known.min()), highest_mN=float(known.max()))


def contact_fit(table: Columns) -> ContactFit | None:
    """The contact line over the load, as the controller fits it; for its standard errors.

    Those are of as many independent samples as the residuals show: an error of x_1 is shared by
    neighbouring ones. One that all of them share is an error of the force at the begin of the
    load, which moves x_e by that over K_e and leaves no residual; one that grows with the load, as
    the stated uncertainty does, is an error of K_e by the same share of the force. So is what the
    force at rest in the hold differs by from the line: the line was drawn in motion.
    """
    line = ContactLine()
    names = ("x_um", "force_mN", "force_r_mN", "force_uncertainty_mN")
    rows = zip(table["phase"], *(table[name] for name in names), strict=True)
    loaded: list[list[float]] = []
    held: list[list[float]] = []
    for phase, *row in rows:
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


def phases(names: Sequence[str | None], t_s: Sequence[float], period_s: float) -> list[Phase]:
    """Runs of one phase, in order; a sample without a name belongs to the phase before it."""
    found: list[tuple[str, float, float]] = []
    for name, start_s in zip(names, t_s, strict=True):
        if name is not None and (not found or found[-1][0] != name):
            found.append((name, start_s, start_s))
        if found:
            found[-1] = (*found[-1][:2], start_s + period_s)
    return [
        Phase(phase=name, start_s=start_s, duration_s=end_s - start_s)
        for name, start_s, end_s in found
    ]


def outcome_of(table: Columns) -> str:
    """The controller's last word; the actuator's where it tripped."""
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
