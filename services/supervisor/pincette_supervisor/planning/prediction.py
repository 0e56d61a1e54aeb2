"""Prediction of a plan on the model in use: curves, peaks, margins, exceeded limits.

Predictions are computed one at a time, since each occupies a processor, and the last ones are
cached.
"""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import ceil
from typing import Any, NamedTuple, TypeVar

from pincette.api.job_kinds import job_kinds
from pincette.api.pairs import PairPrediction, PairResult, PredictedPairCurves
from pincette.api.predictions import (
    Margin,
    Peaks,
    PredictedCurves,
    PredictedPhase,
    Prediction,
    Quantity,
    Side,
    Violation,
)
from pincette.api.states import GOOD_OUTCOMES
from pincette.config import RigFile
from pincette.config.laws import resolved_law
from pincette_supervisor.planning.dry_run import DryRun, run_dry
from pincette_supervisor.planning.identified_arms import Instruments
from pincette_supervisor.planning.predicted_samples import Samples
from pincette_supervisor.plugin import (
    ASSUMED,
    UNITS,
    ModelInUse,
    Planned,
    Present,
    functions_of,
    value_of,
)
from pincette_supervisor.plugin.laws import SENSITIVITY_PEAK, SPECTRAL_RADIUS
from pincette_supervisor.problems import ProblemError

CURVE_POINTS = 400
C = TypeVar("C", bound=PredictedCurves)
SECOND = "second."
ARM = (
    "model.natural_frequency_rad_per_s",
    "model.damping_ratio",
    "model.piezo_um_per_V",
    "model.compliance_um_per_mN",
)
PART = ("part.contact_um", "part.stiffness_mN_per_um")
ROUNDING = 1e-9
"""Tolerance for rounding: a value at a limit is within it."""


def played(planned: Planned) -> DryRun:
    """Play a plan on its model, from rest at the present position of the arm."""
    return run_dry(planned, planned.present or Present(), part=planned.meets_part)


def with_prediction(planned: Planned, dry_run: DryRun) -> Planned:
    """Return a plan with the prediction of its dry run; an exceeded limit makes it infeasible.

    The plan lists its own violations first; the violation of an unstable loop, which has no place
    and time, comes last.
    """
    prediction = predict(planned, dry_run)
    broken = sorted(
        [*planned.plan.violations, *prediction.violations],
        key=lambda violation: violation.quantity in (SPECTRAL_RADIUS, SENSITIVITY_PEAK),
    )
    predicted = {"prediction": prediction, "violations": broken, "feasible": not broken}
    return replace(planned, plan=planned.plan.model_copy(update=predicted))


def predict(planned: Planned, dry_run: DryRun) -> Prediction:
    """Return the prediction of a plan's dry run; raises ValueError if nothing could be played."""
    samples, rig = dry_run.samples, planned.armed.rig
    if not samples.t_s:
        raise ValueError(f"no part of the plan can be played: {dry_run.cut}")
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
    if samples.arms == 1:
        return Prediction(curves=_curves(PredictedCurves, samples), **common)
    figures = dry_run.figures
    return PairPrediction(
        curves=_curves(PredictedPairCurves, samples),
        second_peaks=peaks(*arms[1][1]),
        figures=figures if isinstance(figures, PairResult) else None,
        **common,
    )


def _pointer(planned: Planned) -> Callable[[str, str], str]:
    """Return a function that finds the member exceeding a limit, by quantity and phase."""
    by_phase = planned.pointers
    if not by_phase:
        return functions_of(job_kinds()[planned.plan.kind]).pointer

    def pointer(_quantity: str, phase: str) -> str:
        return by_phase.get(phase, "")

    return pointer


def _of_arm(broken: Violation, arm: int, arms: int) -> Violation:
    """Return a violation that names its arm if there are two."""
    if arms == 1:
        return broken
    return broken.model_copy(update={"message": f"arm {arm}: {broken.message}"})


def _curves(of: type[C], samples: Samples) -> C:
    """Return samples thinned out to ``CURVE_POINTS``, including the first one."""
    stride = max(1, ceil(len(samples.t_s) / CURVE_POINTS))
    return of(**{name: getattr(samples, name)[::stride] for name in of.model_fields})


def phases(samples: Samples, period_s: float) -> list[PredictedPhase]:
    """Return phases in the order in which they were played."""
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
    """Return the assumptions of a prediction as texts."""
    model = planned.armed
    words: list[str] = []
    for number, arm in enumerate(model.rig.arms, start=1):
        name = "arm" if model.rig.second is None else f"arm {number}"
        of = "" if model.rig.second is None else f" of arm {number}"
        prefix = SECOND if number == 2 else ""
        words.append(f"{name}: {_values(model, ARM, prefix)}")
        words.append(f"free response{of}: {_free_response(arm)}")
    if planned.meets_part:
        words.append(f"part: {_values(model, PART)}; rigid and at its expected place")
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
    begin = "unpoled, at rest at the start"
    if rig.model.free_response is not None:
        return f"as identified, with hysteresis and creep; {begin}"
    if rig.model.recorded_response is not None:
        return f"as recorded, with hysteresis and without creep; {begin}"
    return "a straight line, without hysteresis and creep, since none was identified"


class Limit(NamedTuple):
    """A limit of a quantity, and the values to which it applies."""

    quantity: Quantity
    unit: str
    limit: float
    side: float
    """Side of the limit: +1 for an upper limit, -1 for a lower limit."""
    values: Sequence[float]


def rates_V_per_s(samples: Samples, period_s: float) -> list[float]:
    """Return the rate of change from each requested voltage to the next, in V/s."""
    return [
        0.0 if index == 0 else (asked_V - samples.voltage_V[index - 1]) / period_s
        for index, asked_V in enumerate(samples.asked_V)
    ]


def limits_of(rig: RigFile, samples: Samples) -> list[Limit]:
    """Return the limits of a rig file, each with the samples to which it applies.

    For the voltage, the samples are the controller's requests, since the actuator enforces its
    limits.
    """
    limits, slew = rig.limits, rates_V_per_s(samples, rig.rig.period_s)
    return [
        Limit("force", "mN", limits.force_max_mN, 1.0, samples.force_mN),
        Limit("position", "µm", limits.position_max_um, 1.0, samples.x_um),
        Limit("position", "µm", limits.position_min_um, -1.0, samples.x_um),
        Limit("voltage", "V", limits.voltage_max_V, 1.0, samples.asked_V),
        Limit("voltage", "V", limits.voltage_min_V, -1.0, samples.asked_V),
        Limit("slew", "V/s", limits.slew_V_per_s, 1.0, slew),
        Limit("slew", "V/s", -limits.slew_V_per_s, -1.0, slew),
    ]


def margins(rig: RigFile, samples: Samples, *, switches: bool) -> list[Margin]:
    """Return the smallest distance to each limit, and to the band of the sliding function.

    Parameters
    ----------
    samples
        At least one.
    switches
        True if the law has a switching gain K_S; without one nothing keeps s within its band.
    """
    found = [_margin(limit, samples) for limit in limits_of(rig, samples)]
    if switches:
        found.extend(_band_margin(samples))
    return found


def _margin(limit: Limit, samples: Samples) -> Margin:
    worst = max(range(len(limit.values)), key=lambda index: limit.side * limit.values[index])
    return Margin(
        quantity=limit.quantity,
        limit=limit.limit,
        nearest=limit.values[worst],
        distance=limit.side * (limit.limit - limit.values[worst]),
        unit=limit.unit,
        at_s=samples.t_s[worst],
        phase=_phase_before(samples, worst),
    )


def _phase_before(samples: Samples, index: int) -> str:
    """Return the phase before a sample, since the sample's own phase may be a consequence of it."""
    return samples.phase[max(0, index - 1)]


def _band_margin(samples: Samples) -> Iterator[Margin]:
    """Yield the margin of |s| to its band while a law is active; outside the band, the law
    returns s to it."""
    room = [band - abs(s) for s, band in zip(samples.sliding_um, samples.band_um, strict=True)]
    led = [index for index, band_um in enumerate(samples.band_um) if band_um > 0.0]
    if not led:
        return
    worst = min(led, key=room.__getitem__)
    yield Margin(
        quantity="sliding",
        limit=samples.band_um[worst],
        nearest=abs(samples.sliding_um[worst]),
        distance=room[worst],
        unit="µm",
        at_s=samples.t_s[worst],
        phase=_phase_before(samples, worst),
    )


def violations(
    rig: RigFile, samples: Samples, pointer: Callable[[str, str], str]
) -> list[Violation]:
    """Return every exceeded limit, for each phase in which the violation begins, in the order of
    limits.

    Parameters
    ----------
    pointer
        Function that returns the member of the request that causes the violation, by quantity and
        phase.
    """
    return [
        found for limit in limits_of(rig, samples) for found in _broken(limit, samples, pointer)
    ]


def _broken(
    limit: Limit, samples: Samples, pointer: Callable[[str, str], str]
) -> Iterator[Violation]:
    begun: dict[str, int] = {}
    worst: dict[str, int] = {}
    phase: str | None = None
    for index, value in enumerate(limit.values):
        if limit.side * (value - limit.limit) <= ROUNDING:
            phase = None
            continue
        phase = _phase_before(samples, index) if phase is None else phase
        begun.setdefault(phase, index)
        held = worst.setdefault(phase, index)
        if limit.side * (value - limit.values[held]) > 0.0:
            worst[phase] = index
    side: Side = "above" if limit.side > 0.0 else "below"
    for phase, first in begun.items():
        value, at_s = limit.values[worst[phase]], samples.t_s[first]
        yield Violation(
            pointer=pointer(limit.quantity, phase),
            quantity=limit.quantity,
            side=side,
            value=value,
            limit=limit.limit,
            unit=limit.unit,
            at_s=at_s,
            message=(
                f"predicted: {limit.quantity} {value:.3f} {limit.unit} {side} the limit "
                f"{limit.limit:g} {limit.unit}, from {at_s:.2f} s ({phase})"
            ),
        )


def peaks(rig: RigFile, samples: Samples) -> Peaks:
    """Return extremes of the samples; there must be at least one sample."""
    return Peaks(
        force_max_mN=max(samples.force_mN),
        x_min_um=min(samples.x_um),
        x_max_um=max(samples.x_um),
        voltage_min_V=min(samples.voltage_V),
        voltage_max_V=max(samples.voltage_V),
        slew_max_V_per_s=max(map(abs, rates_V_per_s(samples, rig.rig.period_s))),
    )


Play = Callable[[Planned], DryRun]
KEPT = 8
WAITING = 4
"""Largest number of callers that wait for a prediction. Each occupies one of the server's six
threads (``WORKERS``), which also serve other requests.
"""


class PredictionCache:
    """Plays plans on their models and caches the results; safe to use from several threads."""

    def __init__(self, play: Play = played) -> None:
        self._play = play
        self._turn = threading.Lock()
        self._room = threading.BoundedSemaphore(WAITING)
        self._kept: OrderedDict[str, DryRun] = OrderedDict()

    def dry_run(self, planned: Planned) -> DryRun:
        """Play a plan, or return the cached result of the same plan.

        Raises
        ------
        ProblemError
            If too many callers wait already.
        """
        if not self._room.acquire(blocking=False):
            raise ProblemError(
                503,
                "busy",
                "Too many predictions at once",
                (
                    f"{WAITING} predictions are waiting, the maximum: send the request again "
                    "in a moment"
                ),
            )
        try:
            return self._in_turn(planned)
        finally:
            self._room.release()

    def predicted(self, planned: Planned) -> Planned:
        """Return a plan with its prediction.

        A new force on a held part is planned without prediction, since a model does not know the
        memory of the arm from the grip.

        Raises
        ------
        ProblemError
            If too many callers wait already, or no part of the plan can be played.
        """
        if planned.program.takes_force_over:
            return planned
        try:
            return with_prediction(planned, self.dry_run(planned))
        except ValueError as error:
            raise ProblemError(
                422, "no-prediction", "The plan cannot be played on the model in use", str(error)
            ) from error

    def checked(self, planned: Planned) -> Planned:
        """Return the plan of a job that is to begin, with its prediction if that exceeds a limit.

        Two kinds of plan are not played: that of a release, since a held part must be released
        regardless of any prediction, and that of a calibration, which finds the model that a
        prediction would need. However many predictions are waiting, a job that is to begin waits
        only for the running one.
        """
        if not job_kinds()[planned.plan.kind].predicted:
            return planned
        try:
            predicted = with_prediction(planned, self._in_turn(planned))
        except ValueError:  # no part of the plan can be played, so nothing is predicted
            return planned
        return planned if predicted.plan.feasible else predicted

    def _in_turn(self, planned: Planned) -> DryRun:
        with self._turn:
            return self._played(planned)

    def _played(self, planned: Planned) -> DryRun:
        model = planned.armed
        stands = None if planned.present is None else planned.present.voltage_V
        whose = planned.program, planned.values, stands, model.rig_file_digest, model.digest
        key = hashlib.sha256(repr(whose).encode()).hexdigest()
        found = self._kept.pop(key, None)
        if found is None:
            found = self._play(planned)
        self._kept[key] = found
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return found
