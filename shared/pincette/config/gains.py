"""Gains for a rig file: whether a law may run on the rig, and which gains suit it best."""

from functools import lru_cache
from math import sqrt

import numpy as np

from pincette.config.derived import X_START_UM, force_observer, free_response
from pincette.config.laws import default_set, law_definition
from pincette.config.rig_file import RigFile
from pincette.control.force.estimation import COVERAGE
from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.parameters import ParameterSet
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.profiles import quintic
from pincette.control.response.error_growth import ErrorGrowth
from pincette.control.response.free_response import GROWTH_V
from pincette.control.stability.assessment import Assessment, assess
from pincette.control.stability.limits import LIMIT_PEAK, limit_radius_at, short, widened
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.tuning import (
    Tuning,
    TuningPath,
    TuningRig,
    tune,
)
from pincette.control.stability.worst_case import (
    Intervals,
    around,
    worst_case,
    worst_sensitivity,
)

TUNED_HZ = 0.5
"""Frequency of the sinusoid for which gains are tuned, in Hz; the same as in the paper."""
TUNED_CYCLES = 2
LOAD_S = 1.0
LOWEST_SHARE = 0.3
"""Minimum of that sinusoid, as a fraction of the grip's force."""
TOUCH_S = 2.0
"""Duration of the motion to the voltage of first contact, and of the rest there, in s."""
STIFFNESS_ERROR = 0.01
"""Relative error of an identified contact stiffness."""
DELAY_PERIODS = 0.25
"""Centre of the range of delays that the stability assessment covers, in periods."""
NOISE_SEED = 1
LEAST_WAY_V = 0.1
LEAST_SLOPE = 0.05
"""Lower bound of the slope of a response, as a fraction of the model's slope, whatever error is
stated.
"""


def judged(rig: RigFile, settings: LawSettings) -> Assessment:
    """Return the stability assessment of a law's loop on a rig, in the worst case that the rig file
    admits.
    """
    return assess(loop(rig, settings), intervals(rig, settings.set))


def tuned(rig: RigFile, scheme: str, parameter_set: ParameterSet | None = None) -> Tuning:
    """Search for the gains of a scheme on the rig's model, reproducibly; raises ValueError.

    If ``parameter_set`` is None, the set is the identified one if the model has an identified
    response.
    """
    of_set = parameter_set or default_set(identified=rig.model.free_response is not None)
    return _tuned(rig.model_dump_json(), law_definition(scheme), of_set)


@lru_cache(maxsize=8)
def _tuned(rig_json: str, definition: LawDefinition, parameter_set: ParameterSet) -> Tuning:
    rig = RigFile.model_validate_json(rig_json)
    path, limit = _path(rig), limit_radius_at(rig.rig.period_s)
    return tune(
        _tuning_rig(rig, len(path.force_r_mN), parameter_set),
        path,
        definition,
        # Only the radius: a complete assessment would also search for advice for each refused
        # setting.
        lambda settings: _judged_radius(rig, settings, limit),
        radius_limit=limit,
        parameter_set=parameter_set,
    )


def _judged_radius(rig: RigFile, settings: LawSettings, limit: float) -> float:
    """Return the spectral radius of an assessment.

    The result is at least the limit of the radius if M_s exceeds its own limit.
    """
    of_rig = loop(rig, settings)
    met = widened(of_rig, intervals(rig, settings.set))
    radius = worst_case(of_rig, met, limit, enough=limit)[1]
    if radius < limit and short(of_rig) and worst_sensitivity(of_rig, met)[1] > LIMIT_PEAK:
        return limit
    return radius


def _path(rig: RigFile) -> TuningPath:
    """Return the references: a load to the mean of a sinusoid, and its cycles below the grip's
    force.
    """
    highest, period_s = rig.grip.force_mN, rig.rig.period_s
    lowest = LOWEST_SHARE * highest
    path = sinusoid("force", 0.5 * (highest + lowest), highest - lowest, TUNED_HZ, TUNED_CYCLES)
    load = round(LOAD_S / period_s)
    references = [path.start * quintic((tick + 1) / load) for tick in range(load)]
    references += [path.at(tick * period_s) for tick in range(round(path.full_to_s / period_s))]
    return TuningPath(tuple(references), load + round(path.full_from_s / period_s))


def _tuning_rig(rig: RigFile, samples: int, parameter_set: ParameterSet) -> TuningRig:
    """Return the rig with which the search runs, at the voltage of first contact."""
    model, part, period_s = rig.model, rig.part, rig.rig.period_s
    response = free_response(model)
    touch_V = (part.contact_um - X_START_UM) / model.piezo_um_per_V
    ticks = round(TOUCH_S / period_s)
    for tick in range(2 * ticks):
        response = response.updated(touch_V * min(1.0, (tick + 1) / ticks), period_s)
    slope_error = 0.0
    if parameter_set == "identified":
        flattest, steepest = slope_factors(rig)
        slope_error = max(1.0 - flattest, steepest - 1.0)
    noise = np.random.default_rng(NOISE_SEED).standard_normal(samples)
    return TuningRig(
        arm=model.arm(),
        natural_frequency_rad_per_s=model.natural_frequency_rad_per_s,
        damping_ratio=model.damping_ratio,
        response=response,
        stiffness_mN_per_um=part.stiffness_mN_per_um,
        stiffness_error=STIFFNESS_ERROR,
        force_error_mN=_force_error_mN(rig),
        noise_um=tuple((rig.sensor.noise_um * noise).tolist()),
        period_s=period_s,
        delay_s=DELAY_PERIODS * period_s,
        force_filter_s=model.force_filter_s,
        slope_error=slope_error,
    )


def _force_error_mN(rig: RigFile) -> float:
    """Return the error of the free response as a force, in mN."""
    model = rig.model
    taught = model.recorded_response or model.free_response
    if taught is not None:
        return taught.residual_um / model.compliance_um_per_mN
    return model.hysteresis_fraction * rig.grip.force_mN


def loop(rig: RigFile, settings: LawSettings) -> Loop:
    """Return a law with the rig's arm, observer and period, for the stability assessment."""
    return Loop(
        law=settings,
        arm=rig.model.arm(),
        period_s=rig.rig.period_s,
        force_filter_s=rig.model.force_filter_s,
        output_lag_s=rig.model.output_lag_s,
        assumed_timing=rig.output_timing,
        observer=force_observer(rig),
    )


def intervals(rig: RigFile, parameter_set: ParameterSet = "consistent") -> Intervals:
    """Return the conditions that a job can meet: the free arm, the part within its tolerance, a
    wrong response.
    """
    part = rig.part
    factors = slope_factors(rig) if parameter_set == "identified" else (1.0, 1.0)
    return around(part.stiffness_mN_per_um, part.stiffness_tolerance, gain_factor=factors)


def slope_factors(rig: RigFile) -> tuple[float, float]:
    """Return the smallest and largest ratio of the response's true slope to the model's slope.

    They follow from two standard errors E(w) of the model, divided by d_p·w, where w is the travel
    of the voltage; and from the ratio of the measured stroke to the model's while a part is
    pressed. For travels below ``LEAST_WAY_V``, E is not used: it results from noise and creep
    between two measurements, not from a wrong slope.
    """
    taught = rig.model.free_response
    if taught is None:
        return 1.0, 1.0
    ways = taught.growth() or ErrorGrowth((GROWTH_V,), (sqrt(2.0) * taught.residual_um,))
    d_p = rig.model.piezo_um_per_V
    shares = [
        error_um / (d_p * max(way_V, LEAST_WAY_V))
        for way_V, error_um in zip(ways.ways_V, ways.errors_um, strict=True)
    ]
    error, press = COVERAGE * max(shares), taught.press_gain
    return max(LEAST_SLOPE, min(1.0, press) - error), max(1.0, press) + error
