"""What playing a plan on the model in use predicts: curves, peaks, margins, limits broken."""

from collections.abc import Callable
from dataclasses import replace
from math import ceil
from typing import Any

from pincette.api.job_kinds import job_kinds
from pincette.api.pairs import PairPrediction, PairResult, PredictedPairCurves
from pincette.api.predictions import PredictedCurves, PredictedPhase, Prediction, Violation
from pincette.api.states import GOOD_OUTCOMES
from pincette.config import RigFile
from pincette.config.laws import resolved_law
from pincette_supervisor.planning.dry_run import DryRun, run_dry
from pincette_supervisor.planning.identified_arm import Instruments
from pincette_supervisor.planning.margins import margins, peaks, violations
from pincette_supervisor.planning.predicted_samples import Samples, SecondSamples
from pincette_supervisor.plugin import ASSUMED, UNITS, ModelInUse, Planned, Present, value_of
from pincette_supervisor.plugin.functions import functions_of
from pincette_supervisor.plugin.laws import SENSITIVITY_PEAK, SPECTRAL_RADIUS

CURVE_POINTS = 400
SECOND = "second."
ARM = (
    "model.natural_frequency_rad_per_s",
    "model.damping_ratio",
    "model.piezo_um_per_V",
    "model.compliance_um_per_mN",
)
PART = ("part.contact_um", "part.stiffness_mN_per_um")


def played(planned: Planned) -> DryRun:
    """Play a plan on the model that it was made with, from rest where the arm stands."""
    return run_dry(planned, planned.present or Present(), part=planned.meets_part)


def with_prediction(planned: Planned, dry_run: DryRun) -> Planned:
    """A plan with what its dry run predicts; a limit that it breaks makes it infeasible.

    The plan names its own violations first; of a loop that is not stable, which is no matter of
    place and time, it says so last.
    """
    prediction = predict(planned, dry_run)
    broken = sorted(
        [*planned.plan.violations, *prediction.violations],
        key=lambda violation: violation.quantity in (SPECTRAL_RADIUS, SENSITIVITY_PEAK),
    )
    predicted = {"prediction": prediction, "violations": broken, "feasible": not broken}
    return replace(planned, plan=planned.plan.model_copy(update=predicted))


def predict(planned: Planned, dry_run: DryRun) -> Prediction:
    """What a dry run of a plan says; raises ValueError where nothing of it could be played."""
    samples, rig = dry_run.samples, planned.armed.rig
    if not samples.t_s:
        raise ValueError(f"nothing of the plan can be played: {dry_run.cut}")
    complete = not dry_run.cut
    arms = list(enumerate(zip(rig.arms, samples.of_arms(), strict=True), start=1))
    switches = len(arms) == 1 and any(resolved_law(spec).switches for spec in planned.program.laws)
    pointer = _pointer(planned)
    common: dict[str, Any] = {
        "outcome": dry_run.outcome,
        "succeeds": complete and dry_run.outcome in GOOD_OUTCOMES,
        "duration_s": samples.t_s[-1] + rig.rig.period_s,
        "complete": complete,
        "cut": dry_run.cut,
        "phases": phases(samples, rig.rig.period_s),
        "peaks": peaks(rig, samples),
        "margins": [
            near.model_copy(update={"arm": number})
            for number, (one, seen) in arms
            for near in margins(one, seen, switches=switches)
        ],
        "violations": [
            _of_arm(broken, number, len(arms))
            for number, (one, seen) in arms
            for broken in violations(one, seen, pointer)
        ],
        "assumptions": _assumptions(planned, dry_run.instruments),
    }
    if samples.second is None:
        return Prediction(curves=curves(samples), **common)
    figures = dry_run.figures
    return PairPrediction(
        curves=_pair_curves(samples, samples.second),
        second_peaks=peaks(*arms[1][1]),
        figures=figures if isinstance(figures, PairResult) else None,
        **common,
    )


def _pointer(planned: Planned) -> Callable[[str, str], str]:
    """Return what finds the member that leads beyond a limit, by quantity and phase."""
    by_phase = planned.pointers
    if not by_phase:
        return functions_of(job_kinds()[planned.plan.kind]).pointer

    def pointer(_quantity: str, phase: str) -> str:
        return by_phase.get(phase, "")

    return pointer


def _of_arm(broken: Violation, arm: int, arms: int) -> Violation:
    """A violation that says of which arm it is, where there are two."""
    if arms == 1:
        return broken
    return broken.model_copy(update={"message": f"arm {arm}: {broken.message}"})


def _pair_curves(samples: Samples, second: SecondSamples) -> PredictedPairCurves:
    stride = max(1, ceil(len(samples.t_s) / CURVE_POINTS))
    return PredictedPairCurves(
        **curves(samples).model_dump(),
        second_x_um=second.x_um[::stride],
        second_force_mN=second.force_mN[::stride],
        second_voltage_V=second.voltage_V[::stride],
        place_um=second.place_um[::stride],
        place_r_um=second.place_r_um[::stride],
    )


def curves(samples: Samples) -> PredictedCurves:
    """Samples thinned out to ``CURVE_POINTS``, the first one kept."""
    stride = max(1, ceil(len(samples.t_s) / CURVE_POINTS))
    return PredictedCurves(
        t_s=samples.t_s[::stride],
        phase=samples.phase[::stride],
        x_um=samples.x_um[::stride],
        force_mN=samples.force_mN[::stride],
        voltage_V=samples.voltage_V[::stride],
        x_r_um=samples.x_r_um[::stride],
        force_r_mN=samples.force_r_mN[::stride],
        sliding_um=samples.sliding_um[::stride],
    )


def phases(samples: Samples, period_s: float) -> list[PredictedPhase]:
    """Phases in the order in which they were played."""
    begins = [
        index
        for index, phase in enumerate(samples.phase)
        if index == 0 or samples.phase[index - 1] != phase
    ]
    ends_s = [*(samples.t_s[index] for index in begins[1:]), samples.t_s[-1] + period_s]
    return [
        PredictedPhase(
            phase=samples.phase[index],
            start_s=samples.t_s[index],
            duration_s=end_s - samples.t_s[index],
        )
        for index, end_s in zip(begins, ends_s, strict=True)
    ]


def _assumptions(planned: Planned, instruments: Instruments) -> list[str]:
    """What a prediction takes for granted, in words."""
    model = planned.armed
    words: list[str] = []
    for number, arm in enumerate(model.rig.arms, start=1):
        name = "arm" if model.rig.second is None else f"arm {number}"
        of = "" if model.rig.second is None else f" of arm {number}"
        prefix = SECOND if number == 2 else ""
        words.append(f"{name}: {_values(model, ARM, prefix)}")
        words.append(f"free response{of}: {_free_response(arm)}")
    if planned.meets_part:
        words.append(f"part: {_values(model, PART)}; rigid, and where it is expected")
    else:
        words.append("part: none in the way")
    words.append(
        f"instruments: a voltage {1e3 * instruments.delay_s:.1f} ms after its sample, an output "
        f"lag of {1e3 * instruments.lag_s:.1f} ms, as their drivers state; no noise"
    )
    return words


def _values(model: ModelInUse, quantities: tuple[str, ...], prefix: str = "") -> str:
    sources = model.calibration.sources
    return ", ".join(
        f"{quantity.rpartition('.')[2]} = {value_of(model.rig, prefix + quantity):g} "
        f"{UNITS[quantity]} ({sources.get(prefix + quantity, ASSUMED)})"
        for quantity in quantities
    )


def _free_response(rig: RigFile) -> str:
    begin = "unpoled, at rest at the begin"
    if rig.model.free_response is not None:
        return f"as identified, with hysteresis and creep; {begin}"
    if rig.model.recorded_response is not None:
        return f"as recorded, with hysteresis and without creep; {begin}"
    return "a straight line, without hysteresis and creep: none was identified"
