"""Tracking errors of both laws with consistent plan, units and gains, unlike in the paper."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import sqrt
from multiprocessing import get_context
from statistics import median
from typing import Any

from pincette.config import RigFile
from pincette.plotting import BLUE, GREEN, ORANGE, Axis, label, legend, picture
from pincette_study import printed
from pincette_study.calibrated import prepare
from pincette_study.closed_loop import Errors, track, tracking_plan
from pincette_study.report import Comparison, Picture, Section
from pincette_study.rigs import Draw, random_rig, simulation_of

SCHEMES = ("pbsmic", "dsmifc")
FREQUENCIES_HZ = (printed.FREQUENCY_HZ, 2.0, 5.0)
RIGS = 20


@dataclass(frozen=True, slots=True)
class Trial:
    """Result of one law on one random rig at one frequency."""

    draw: Draw
    scheme: str
    frequency_hz: float
    K_P: float
    K_f: float
    errors: Errors


def sensor_floor_percent(rig: RigFile) -> float:
    """Return the sensor's error floor √(σ² + q²/12), in per cent of the planned peak to peak."""
    simulation = simulation_of(rig)
    noise_um, step_um = simulation.sensor_noise_um, simulation.sensor_step_um
    return 100.0 * sqrt(noise_um**2 + step_um**2 / 12.0) / printed.X_PP_UM


def run_trials(
    base: RigFile,
    rigs: int = RIGS,
    progress: Callable[[int], None] | None = None,
    workers: int = 1,
) -> list[Trial]:
    """Draw, calibrate, tune and track: every scheme and frequency on every rig, in this order.

    ``progress`` receives the number of finished rigs; ``workers`` is the number of processes.
    """
    trials: list[Trial] = []
    for done, found in enumerate(_by_rig(base, rigs, workers), start=1):
        trials += found
        if progress is not None:
            progress(done)
    return trials


def _by_rig(base: RigFile, rigs: int, workers: int) -> Iterator[list[Trial]]:
    seeds, one = range(1, rigs + 1), partial(_on_rig, base)
    if workers == 1 or rigs == 1:
        yield from map(one, seeds)
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        yield from pool.map(one, seeds)


def _on_rig(base: RigFile, seed: int) -> list[Trial]:
    rig, draw = random_rig(base, seed)
    prepared = prepare(rig)
    trials: list[Trial] = []
    for scheme in SCHEMES:
        settings = prepared.gains(scheme)
        for frequency_hz in FREQUENCIES_HZ:
            plan = tracking_plan(prepared.rig, frequency_hz=frequency_hz)
            _, found = track(prepared.rig, settings, plan)
            K_P, K_f = settings.gains["K_P"], settings.gains["K_f"]
            trials.append(Trial(draw, scheme, frequency_hz, K_P, K_f, found))
    return trials


def summary(trials: Sequence[Trial]) -> dict[str, dict[str, float]]:
    """Return medians over the rigs at the paper's frequency, by scheme."""
    return {
        scheme: {
            "position_percent": median(_values(trials, scheme, "position_percent")),
            "force_percent": median(_values(trials, scheme, "force_percent")),
        }
        for scheme in SCHEMES
    }


def worst(trials: Sequence[Trial]) -> dict[str, dict[str, float]]:
    """Return the largest errors over the rigs at the paper's frequency, by scheme."""
    return {
        scheme: {
            "position_percent": max(_values(trials, scheme, "position_percent")),
            "force_percent": max(_values(trials, scheme, "force_percent")),
        }
        for scheme in SCHEMES
    }


def section(base: RigFile, trials: Sequence[Trial]) -> Section:
    """Return the report's section on the random rigs."""
    rigs = len({trial.draw.seed for trial in trials})
    floor = sensor_floor_percent(base)
    rows: list[Comparison] = []
    for scheme in SCHEMES:
        for frequency_hz in FREQUENCIES_HZ:
            for quantity in ("position", "force"):
                values = _values(trials, scheme, f"{quantity}_percent", frequency_hz)
                rows.append(
                    Comparison(
                        f"{scheme.upper()} {quantity}, {frequency_hz:g} Hz, median",
                        "%",
                        None,
                        median(values),
                        f"worst {max(values):.2f} %",
                    )
                )
    rows.append(Comparison("floor: sensor noise and step, of position", "%", None, floor))
    return Section(
        key="precision",
        title=f"Both laws on {rigs} rigs drawn at random",
        text=(
            "Consistent set, estimated force in the loop. Each rig has its own contact stiffness "
            "(± 20 %), hysteresis loop (10-23 %), creep (1-2 % per decade) and noise; each is "
            "taught, pressed once to identify its contact, and tuned on its identified model, as "
            f"a laboratory would. {printed.X_PP_UM} µm peak to peak and the force that belongs to "
            "it on the identified contact line. Position as measured, force as it truly was.",
        ),
        pictures=(Picture("precision", "errors of each rig", _scatter(trials, floor)),),
        comparisons=tuple(rows),
        data={"trials": [_plain(trial) for trial in trials], "floor_percent": floor},
    )


def _values(
    trials: Sequence[Trial], scheme: str, name: str, frequency_hz: float = printed.FREQUENCY_HZ
) -> list[float]:
    return [
        getattr(trial.errors, name)
        for trial in trials
        if trial.scheme == scheme and trial.frequency_hz == frequency_hz
    ]


def _plain(trial: Trial) -> dict[str, Any]:
    return {
        "seed": trial.draw.seed,
        "stiffness_mN_per_um": trial.draw.stiffness_mN_per_um,
        "loop_percent": trial.draw.loop_percent,
        "creep_percent_per_decade": trial.draw.creep_percent_per_decade,
        "scheme": trial.scheme,
        "frequency_hz": trial.frequency_hz,
        "K_P": trial.K_P,
        "K_f": trial.K_f,
        **{name: getattr(trial.errors, name) for name in Errors.__slots__},
    }


def _scatter(trials: Sequence[Trial], floor: float) -> bytes:
    def draw(axes: list[Axis]) -> None:
        for axis, scheme in zip(axes, SCHEMES, strict=True):
            for frequency_hz, color in zip(FREQUENCIES_HZ, (BLUE, GREEN, ORANGE), strict=True):
                axis.plot(
                    _values(trials, scheme, "position_percent", frequency_hz),
                    _values(trials, scheme, "force_percent", frequency_hz),
                    "o",
                    color=color,
                    markersize=4,
                    label=f"{frequency_hz:g} Hz",
                )
            axis.axvline(floor, color="#8a939c", linestyle=":", label="sensor floor")
            axis.set_xlim(left=0.0)
            axis.set_ylim(bottom=0.0)
            label(axis, "position RMSE / %", "force RMSE / %", scheme.upper())
            legend(axis)

    return picture(1, 2, 4.2, draw)
