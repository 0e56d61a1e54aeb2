"""Gains for a rig file: whether a law may run on it, and which gains suit it best."""

from functools import lru_cache

import numpy as np

from pincette.config.derived import X_START_UM, force_observer, free_response
from pincette.config.laws import law_definition
from pincette.config.rig_file import RigFile
from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.profiles import quintic
from pincette.control.stability.assessment import LIMIT_RADIUS, Assessment, assess
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.tuning import (
    Grid,
    Tracks,
    Tuning,
    TuningPath,
    TuningRig,
    track_each,
    tune,
)
from pincette.control.stability.worst_case import Intervals, around, worst_case

TUNED_HZ = 0.5
"""Frequency of the sinusoid that gains are tuned on, that of the paper."""
TUNED_CYCLES = 2
LOAD_S = 1.0
LOWEST_SHARE = 0.3
"""Trough of that sinusoid, as a share of the grip's force."""
TOUCH_S = 2.0
"""In which the arm is brought to the voltage of first touch, and as long to rest."""
STIFFNESS_ERROR = 0.01
"""What the identification of a contact leaves open, as a share."""
DELAY_PERIODS = 0.25
"""Middle of the interval that the judgement of stability takes."""
NOISE_SEED = 1


def judged(rig: RigFile, settings: LawSettings) -> Assessment:
    """The loop of a law on a rig at the worst that the rig file admits."""
    return assess(loop(rig, settings), intervals(rig))


def tuned(
    rig: RigFile,
    scheme: str,
    *,
    grid: Grid | None = None,
    tracks: Tracks = track_each,
) -> Tuning:
    """Search the gains of a scheme on the rig's model, reproducibly; raises ValueError."""
    given = None if grid is None else tuple((name, tuple(each)) for name, each in grid.items())
    return _tuned(rig.model_dump_json(), law_definition(scheme), given, tracks)


@lru_cache(maxsize=8)
def _tuned(
    rig_json: str,
    definition: LawDefinition,
    grid: tuple[tuple[str, tuple[float, ...]], ...] | None,
    tracks: Tracks,
) -> Tuning:
    rig = RigFile.model_validate_json(rig_json)
    path = _path(rig)
    return tune(
        _tuning_rig(rig, len(path.force_r_mN)),
        path,
        definition,
        # That of an assessment, which would also look for advice on each that is refused.
        lambda settings: worst_case(
            loop(rig, settings), intervals(rig), LIMIT_RADIUS, enough=LIMIT_RADIUS
        )[1],
        radius_limit=LIMIT_RADIUS,
        grid=None if grid is None else dict(grid),
        tracks=tracks,
    )


def _path(rig: RigFile) -> TuningPath:
    """Load to the middle of a sinusoid below the grip's force, and its cycles."""
    highest, period_s = rig.grip.force_mN, rig.rig.period_s
    lowest = LOWEST_SHARE * highest
    path = sinusoid("force", 0.5 * (highest + lowest), highest - lowest, TUNED_HZ, TUNED_CYCLES)
    load = round(LOAD_S / period_s)
    references = [path.start * quintic((tick + 1) / load) for tick in range(load)]
    references += [path.at(tick * period_s) for tick in range(round(path.full_to_s / period_s))]
    return TuningPath(tuple(references), load + round(path.full_from_s / period_s))


def _tuning_rig(rig: RigFile, samples: int) -> TuningRig:
    """The rig as the search plays it, at the voltage of first touch."""
    model, part, period_s = rig.model, rig.part, rig.rig.period_s
    response = free_response(model)
    touch_V = (part.contact_um - X_START_UM) / model.piezo_um_per_V
    ticks = round(TOUCH_S / period_s)
    for tick in range(2 * ticks):
        response = response.follow(touch_V * min(1.0, (tick + 1) / ticks), period_s)
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
    )


def _force_error_mN(rig: RigFile) -> float:
    """What the free response leaves open, as force."""
    model = rig.model
    taught = model.recorded_response or model.free_response
    if taught is not None:
        return taught.residual_um / model.compliance_um_per_mN
    return model.hysteresis_fraction * rig.grip.force_mN


def loop(rig: RigFile, settings: LawSettings) -> Loop:
    """A law with the rig's arm, observer and period, for the judgement of its stability."""
    return Loop(
        law=settings,
        arm=rig.model.arm(),
        period_s=rig.rig.period_s,
        force_filter_s=rig.model.force_filter_s,
        observer=force_observer(rig),
    )


def intervals(rig: RigFile) -> Intervals:
    """What a job may meet: the free arm, and the part within its tolerance."""
    return around(rig.part.stiffness_mN_per_um, rig.part.stiffness_tolerance)
