"""Results at T = 1 ms: the law with a filtered perturbation, on the rigs of ``beyond``.

Each rig is calibrated, and its part pressed, at 20 ms. With the instruments, period and law of
another rig file it then grips and tracks paths of up to 20 Hz. Some rigs are changed after their
calibration.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from math import inf
from multiprocessing import get_context
from typing import Any

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.config.script import ScriptedOrder
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.segments import paths_of
from pincette.core.messages import Message
from pincette_study import printed
from pincette_study.beyond.tracks import (
    CLASSES,
    FIRST_SEED,
    BeyondTrial,
    BeyondTrials,
    grip_trial,
    prepared_rig,
)
from pincette_study.closed_loop import errors, tracked, tracking_plan
from pincette_study.desk import Desk
from pincette_study.rigs import Draw, simulation_of

CYCLES = {0.5: 2, 2.0: 6, 10.0: 20, 20.0: 40}
"""Number of cycles at full amplitude, by frequency in Hz."""
FAST_HZ = 10.0
"""Frequency in Hz of the path that is tracked again after a residual run, and with changed rigs."""
QUICK = "quick"
FAST = ("substep_s", "sensor_step_um", "output_step_V", "output_lag_s", "actuation_delay_s")
"""Fields of a simulated rig that describe its instruments."""
MISSED = 0.01
"""Fraction of the samples that are lost."""
OFF_NOMINAL: Mapping[str, Callable[[RigFile], dict[str, Any]]] = {
    "mode_80": lambda rig: {"natural_frequency_rad_per_s": 0.8 * _omega_n(rig)},
    "mode_120": lambda rig: {"natural_frequency_rad_per_s": 1.2 * _omega_n(rig)},
    "contact_50": lambda rig: {"environment_stiffness_mN_per_um": 0.5 * _K_e(rig)},
    "contact_200": lambda rig: {"environment_stiffness_mN_per_um": 2.0 * _K_e(rig)},
    "delay_100": lambda rig: {"actuation_delay_s": rig.rig.period_s},
    "noise_300": lambda rig: {"sensor_noise_um": 3.0 * simulation_of(rig).sensor_noise_um},
    "missed_1": lambda _rig: {
        "script": (ScriptedOrder(at_s=0.0, target="sensor", what="intermittent", value=MISSED),)
    },
}
"""Changes of the simulated rig by name. Only the noise is also entered in the rig file, since
otherwise the force could not be zeroed."""
SMALLER = {"contact_200": 0.5}
"""Fraction to which the path's range is reduced, by change; the full range would reach the force
limit.
"""
OFF_RIGS = 1
"""Number of rigs of each class on which the changes are tried."""


def at_kilohertz(rig: RigFile, fast: RigFile) -> RigFile:
    """Return the rig with instruments, period and law of the rig file ``fast``.

    Arm, part and their models are kept.
    """
    simulated, instruments = simulation_of(rig), simulation_of(fast)
    model = {"output_delay_s": fast.model.output_delay_s}
    model |= {"force_observer": fast.model.force_observer}
    return rig.model_copy(
        update={
            "rig": fast.rig,
            "sensor": fast.sensor,
            "output": fast.output,
            "realtime": fast.realtime,
            "law": fast.law,
            "grip": fast.grip,
            "model": rig.model.model_copy(update=model),
            "limits": rig.limits.model_copy(update={"slew_V_per_s": fast.limits.slew_V_per_s}),
            "simulation": simulated.model_copy(
                update={name: getattr(instruments, name) for name in FAST}
            ),
        }
    )


def run_kilohertz(
    base: RigFile,
    fast: RigFile,
    rigs: int,
    progress: Callable[[int], None] | None = None,
    workers: int = 1,
) -> BeyondTrials:
    """Run the trials on this number of rigs of every class.

    ``progress`` receives the number of finished rigs.
    """
    trials = BeyondTrials([], [])
    for done, found in enumerate(_by_rig(base, fast, rigs, workers), start=1):
        trials.tracks.extend(found.tracks)
        trials.grips.extend(found.grips)
        if progress is not None:
            progress(done)
    return trials


def _by_rig(base: RigFile, fast: RigFile, rigs: int, workers: int) -> Iterator[BeyondTrials]:
    drawn = [(name, FIRST_SEED + number) for number in range(rigs) for name in CLASSES]
    one = partial(on_rig, base, fast)
    if workers == 1:
        yield from map(one, drawn)
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        yield from pool.map(one, drawn)


def on_rig(base: RigFile, fast: RigFile, drawn: tuple[str, int]) -> BeyondTrials:
    """Run all trials on one rig, given by class and seed; the first rig of a class is also tried
    with changes.
    """
    calibrated, draw = prepared_rig(base, drawn)
    rig = at_kilohertz(calibrated, fast)
    found = nominal(rig, drawn[0], draw)
    if drawn[1] < FIRST_SEED + OFF_RIGS:
        found.tracks.extend(off_nominal(rig, drawn[0], draw))
    return found


def nominal(rig: RigFile, name: str, draw: Draw) -> BeyondTrials:
    """Grip, and track with and without corrections found by runs without the part."""
    desk = Desk(rig)
    desk.stroke()
    found = BeyondTrials([], [])
    planned, played = desk.grip(QUICK)
    found.grips.append(grip_trial(rig, name, draw, QUICK, planned, played))
    known = desk.residual(planned.program, played)
    if known is not None:
        played = desk.play(planned.program, known)
        found.grips.append(grip_trial(rig, name, draw, "dry_run", planned, played))
    for frequency_hz in CYCLES:
        program, path = _program(rig, frequency_hz)
        played = desk.play(program)
        found.tracks.append(_trial(rig, name, draw, frequency_hz, path, played, ""))
        known = desk.residual(program, played) if frequency_hz == FAST_HZ else None
        if known is not None:
            played = desk.play(program, known)
            found.tracks.append(_trial(rig, name, draw, frequency_hz, path, played, "dry_run"))
    return found


def off_nominal(rig: RigFile, name: str, draw: Draw) -> Iterator[BeyondTrial]:
    """Track with a rig that is changed after its calibration; raises StudyError.

    The guard against parts whose stiffness differs from the plan is off, since such parts are
    tested here.
    """
    for what, changed in OFF_NOMINAL.items():
        simulation = simulation_of(rig).model_copy(update=changed(rig))
        sensor = rig.sensor.model_copy(update={"noise_um": simulation.sensor_noise_um})
        desk = Desk(rig.model_copy(update={"simulation": simulation, "sensor": sensor}))
        desk.stroke()
        program, path = _program(rig, FAST_HZ, SMALLER.get(what, 1.0))
        guards = replace(program.guards, stiffness_min_mN_per_um=0.0, stiffness_max_mN_per_um=inf)
        played = desk.play(replace(program, guards=guards))
        yield _trial(rig, name, draw, FAST_HZ, path, played, what)


def _program(rig: RigFile, frequency_hz: float, share: float = 1.0) -> tuple[Program, Path]:
    x_pp_um, cycles = share * printed.X_PP_UM, CYCLES[frequency_hz]
    plan = tracking_plan(rig, frequency_hz=frequency_hz, x_pp_um=x_pp_um, cycles=cycles)
    program = plan.program
    return program, next(path for one in program.segments for path in paths_of(one))


def _trial(
    rig: RigFile,
    name: str,
    draw: Draw,
    frequency_hz: float,
    path: Path,
    played: list[Message],
    prepared: str,
) -> BeyondTrial:
    seen = tracked(played, path, rig.rig.period_s)
    return BeyondTrial(name, draw, rig.law.scheme, frequency_hz, errors(seen), prepared)


def _omega_n(rig: RigFile) -> float:
    return simulation_of(rig).natural_frequency_rad_per_s


def _K_e(rig: RigFile) -> float:
    return simulation_of(rig).environment_stiffness_mN_per_um
