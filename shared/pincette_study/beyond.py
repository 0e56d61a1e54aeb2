"""Beyond the paper: both laws with the identified free response, on two classes of hysteresis.

Forgetting plays, of which the model is made, are kin to Bouc-Wen, and flatter it; relays are not.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from statistics import median
from typing import Any

from pincette.config import RigFile
from pincette.config.laws import law_definition
from pincette.plotting import BLUE, GREEN, ORANGE, Axis, label, legend, picture
from pincette_study import printed
from pincette_study.calibrated import line_of, with_line
from pincette_study.calibrated_free import after_strokes, with_calibrated_response
from pincette_study.closed_loop import Errors, track_on, tracking_plan
from pincette_study.precision import FREQUENCIES_HZ, SCHEMES
from pincette_study.report import Comparison, Picture, Section
from pincette_study.rigs import Draw, random_relay_rig, random_rig

CLASSES: Mapping[str, Callable[[RigFile, int], tuple[RigFile, Draw]]] = {
    "bouc_wen": random_rig,
    "relays": random_relay_rig,
}
TITLES = {"bouc_wen": "Bouc-Wen", "relays": "relays"}
REACH_UM = (-70.0, 120.0)
"""Limits of position: the calibration's cycles go 1 V below rest, and relays shift the rest."""
QUANTITIES = ("position", "force")


@dataclass(frozen=True, slots=True)
class BeyondTrial:
    """A law on a random rig at one frequency."""

    hysteresis: str
    """One of ``CLASSES``."""
    draw: Draw
    scheme: str
    frequency_hz: float
    errors: Errors
    prepared: str = ""
    """What was done beside the calibrations; the keys of the summary begin with it."""


def run_beyond(
    base: RigFile,
    rigs: int,
    progress: Callable[[int], None] | None = None,
    workers: int = 1,
) -> list[BeyondTrial]:
    """Draw, calibrate, press and track: every class, scheme and frequency, in their order.

    ``progress`` takes how many rigs are done, of all classes.
    """
    trials: list[BeyondTrial] = []
    for done, found in enumerate(_by_rig(base, rigs, workers), start=1):
        trials += found
        if progress is not None:
            progress(done)
    return trials


def _by_rig(base: RigFile, rigs: int, workers: int) -> Iterator[list[BeyondTrial]]:
    drawn = [(name, seed) for name in CLASSES for seed in range(1, rigs + 1)]
    one = partial(on_rig, base)
    if workers == 1:
        yield from map(one, drawn)
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        yield from pool.map(one, drawn)


def on_rig(base: RigFile, drawn: tuple[str, int]) -> list[BeyondTrial]:
    """Play one rig, of a class and a seed, with default gains, one track after the other.

    Before the first one it strokes over its range, as no model knows what was before, and relays
    have no unpoled state in common with plays. From then on memory and creep are carried on.
    """
    name, seed = drawn
    rig, draw = CLASSES[name](base, seed)
    # No set is named: the product's own choice, once a free response is identified.
    update = {
        "law": rig.law.model_copy(update={"set": None}),
        "limits": rig.limits.model_copy(
            update={"position_min_um": REACH_UM[0], "position_max_um": REACH_UM[1]}
        ),
    }
    rig = rig.model_copy(update=update)
    taught = with_calibrated_response(rig)
    line = line_of(after_strokes(taught).play(tracking_plan(taught).program, 2))
    prepared = with_line(taught, *line).rig
    loop, epoch = after_strokes(prepared), 2
    trials: list[BeyondTrial] = []
    for scheme in SCHEMES:
        settings = law_definition(scheme).settings(prepared.law_set)
        for frequency_hz in FREQUENCIES_HZ:
            plan = tracking_plan(prepared, frequency_hz=frequency_hz)
            found = track_on(loop, settings, plan, epoch)
            trials.append(BeyondTrial(name, draw, scheme, frequency_hz, found))
            epoch += 1
    return trials


def summary(trials: Sequence[BeyondTrial]) -> dict[str, Any]:
    """Medians over the rigs, the worst beside: by class, scheme and frequency."""
    tree: dict[str, Any] = {}
    for trial in trials:
        by_scheme = tree.setdefault(trial.hysteresis, {}).setdefault(trial.scheme, {})
        values = by_scheme.setdefault(_key(trial.frequency_hz), {})
        for quantity in QUANTITIES:
            kept = f"{trial.prepared}{quantity}_percent"
            values.setdefault(kept, []).append(getattr(trial.errors, f"{quantity}_percent"))
    for by_scheme in tree.values():
        for by_frequency in by_scheme.values():
            for key, values in by_frequency.items():
                worst = {f"{name}_worst": max(some) for name, some in values.items()}
                by_frequency[key] = {name: median(some) for name, some in values.items()} | worst
    return tree


def _key(frequency_hz: float) -> str:
    return f"hz_{frequency_hz:g}".replace(".", "_")


def section(trials: Sequence[BeyondTrial]) -> Section:
    """The report's part."""
    rigs = len({trial.draw.seed for trial in trials})
    rows: list[Comparison] = []
    for name, by_scheme in summary(trials).items():
        for scheme, by_frequency in by_scheme.items():
            for frequency_hz in FREQUENCIES_HZ:
                values = by_frequency[_key(frequency_hz)]
                rows += [
                    Comparison(
                        f"{TITLES[name]}, {scheme.upper()} {quantity}, {frequency_hz:g} Hz, median",
                        "%",
                        None,
                        values[f"{quantity}_percent"],
                        f"worst {values[f'{quantity}_percent_worst']:.2f} %",
                    )
                    for quantity in QUANTITIES
                ]
    return Section(
        key="beyond",
        title="Beyond the paper: the identified free response in the law",
        text=(
            f"{rigs} rigs of each class of hysteresis, drawn at random, calibrated as the product "
            "does it and pressed once. In (17) k·H(u) stands in the place of d·u, H being the "
            "identified hysteresis and creep; gains are the defaults, the same on every rig. "
            f"{printed.X_PP_UM} µm peak to peak. Position as measured, force as it truly was.",
            "H is made of plays, which are kin to the Bouc-Wen hysteresis of one class of rigs; "
            "the relays of the other class are not, and are the fairer test.",
        ),
        pictures=(Picture("beyond", "errors of each rig, PBSMIC", _scatter(trials)),),
        comparisons=tuple(rows),
        data={"trials": [_plain(trial) for trial in trials]},
    )


def _plain(trial: BeyondTrial) -> dict[str, Any]:
    return {
        "hysteresis": trial.hysteresis,
        "seed": trial.draw.seed,
        "stiffness_mN_per_um": trial.draw.stiffness_mN_per_um,
        "loop_percent": trial.draw.loop_percent,
        "creep_percent_per_decade": trial.draw.creep_percent_per_decade,
        "scheme": trial.scheme,
        "frequency_hz": trial.frequency_hz,
        "prepared": trial.prepared,
        **{name: getattr(trial.errors, name) for name in Errors.__slots__},
    }


def _scatter(trials: Sequence[BeyondTrial]) -> bytes:
    def draw(axes: list[Axis]) -> None:
        for axis, name in zip(axes, CLASSES, strict=True):
            for frequency_hz, color in zip(FREQUENCIES_HZ, (BLUE, GREEN, ORANGE), strict=True):
                some = [
                    trial.errors
                    for trial in trials
                    if (trial.hysteresis, trial.scheme, trial.frequency_hz, trial.prepared)
                    == (name, "pbsmic", frequency_hz, "")
                ]
                axis.plot(
                    [errors.position_percent for errors in some],
                    [errors.force_percent for errors in some],
                    "o",
                    color=color,
                    markersize=4,
                    label=f"{frequency_hz:g} Hz",
                )
            axis.set_xlim(left=0.0)
            axis.set_ylim(bottom=0.0)
            label(axis, "position RMSE / %", "force RMSE / %", TITLES[name])
            legend(axis)

    return picture(1, 2, 4.2, draw)
