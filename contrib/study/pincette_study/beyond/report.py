"""Medians, worst cases and pictures of the results beyond the paper."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from statistics import median
from typing import Any

from pincette.plotting import BLUE, GREEN, ORANGE, RED, Axis, label, legend, picture
from pincette_study import printed
from pincette_study.beyond.tracks import (
    CLASSES,
    LEARNED_CYCLES,
    PROFILES,
    BeyondTrial,
    BeyondTrials,
    GripTrial,
)
from pincette_study.closed_loop import Errors
from pincette_study.precision import FREQUENCIES_HZ
from pincette_study.report import Comparison, Picture, Section
from pincette_study.rigs import Draw

TITLES = {"bouc_wen": "Bouc-Wen", "relays": "relays"}
PREPARED = {"": "", "dry_run": ", after a residual run", "learned": ", after ten learned cycles"}
QUANTITIES = ("position", "force")
FIGURES = {
    "seconds_without_hold": ("time without the hold", "s"),
    "peak_over_planned": ("largest true force divided by the planned force", ""),
    "hold_error_percent": ("r.m.s. error of the true force during the hold", "%"),
}
COLORS = dict(zip(FREQUENCIES_HZ, (BLUE, GREEN, ORANGE), strict=True))


def summary(trials: Sequence[BeyondTrial]) -> dict[str, Any]:
    """Return medians over the rigs, by class, scheme and frequency.

    Each median has a name, and the worst value the same name with ``_worst`` appended.
    """
    tree: dict[str, Any] = {}
    for trial in trials:
        by_scheme = tree.setdefault(trial.hysteresis, {}).setdefault(trial.scheme, {})
        values = by_scheme.setdefault(key_of(trial.frequency_hz), {})
        for quantity in QUANTITIES:
            error = getattr(trial.errors, f"{quantity}_percent")
            values.setdefault(name_of(trial.prepared, quantity), []).append(error)
    for by_scheme in tree.values():
        for by_frequency in by_scheme.values():
            for key, values in by_frequency.items():
                by_frequency[key] = medians(values)
    return tree


def grip_summary(trials: Sequence[GripTrial]) -> dict[str, Any]:
    """Return medians over the rigs of all classes, by profile, and the worst values."""
    return {
        profile: medians(
            {
                name: [getattr(one, name) for one in trials if one.profile == profile]
                for name in FIGURES
            }
        )
        for profile in PROFILES
    }


def medians(values: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Return the median of each value, and the worst one."""
    found: dict[str, float] = {}
    for name, some in values.items():
        found |= {name: median(some), f"{name}_worst": max(some)}
    return found


def name_of(prepared: str, quantity: str) -> str:
    """Return the name of a value in the summary."""
    return f"{prepared}_{quantity}_percent" if prepared else f"{quantity}_percent"


def key_of(frequency_hz: float) -> str:
    """Return the name of a frequency in the summary."""
    return f"hz_{frequency_hz:g}".replace(".", "_")


def section(found: BeyondTrials) -> Section:
    """Return the report's section on tracking."""
    trials = found.tracks
    rigs = len({trial.draw.seed for trial in trials})
    return Section(
        key="beyond",
        title="Beyond the paper: the identified free response in the law",
        text=(
            f"{rigs} rigs of each class of hysteresis, drawn at random by seeds that no gain "
            "was found on, calibrated as the product does it and pressed once. In (17), "
            "k·H(u) replaces d·u, where H is the identified hysteresis and creep; gains are "
            f"the defaults, the same on every rig. {printed.X_PP_UM} µm peak to peak. "
            "Position is as measured, force is the true contact force.",
            "H is a sum of play operators, which resemble the Bouc-Wen hysteresis of one "
            "class of rigs; the relays of the other class do not, and are the fairer test.",
            "Then the motion is played twice without the part, and the error of the model "
            "along it is stored: this corrects the force. Finally the law learns from cycle "
            "to cycle: this corrects the position. The stated error is that of the cycles "
            f"after {LEARNED_CYCLES}. {_without_a_run(trials)}",
        ),
        pictures=(
            Picture("beyond", "errors of each rig, PBSMIC", _scatter(trials)),
            Picture("dry_run", "force before and after a residual run, PBSMIC", _pairs(trials)),
            Picture("learning", "learning: error of the position over cycles", _cycles(trials)),
        ),
        comparisons=tuple(_rows(trials)),
        data={"trials": [plain(trial) for trial in trials]},
    )


def _without_a_run(trials: Sequence[BeyondTrial]) -> str:
    """Return how many tracks have a residual run; in the others a guard ended it."""
    counts = [sum(t.prepared == word for t in trials) for word in ("", "dry_run")]
    return f"{counts[1]} of {counts[0]} tracks had residual runs; a guard ended the others."


def grip_section(found: BeyondTrials) -> Section:
    """Return the report's section on grips."""
    trials, rows = found.grips, list[Comparison]()
    for profile, values in grip_summary(trials).items():
        rows += [
            Comparison(
                f"{profile} grip: {words}",
                unit,
                None,
                values[name],
                f"worst {values[f'{name}_worst']:.3g} {unit}".rstrip(),
            )
            for name, (words, unit) in FIGURES.items()
        ]
    return Section(
        key="grip",
        title="Grips, timed",
        text=(
            "A quick grip loads at the touch without a stop, and follows the contact line as it "
            "is identified; a gentle one stops there. The same rigs, both classes together.",
        ),
        pictures=(Picture("grips", "largest and held force of each grip", _grips(trials)),),
        comparisons=tuple(rows),
        data={"trials": [plain(trial) for trial in trials]},
    )


def _rows(trials: Sequence[BeyondTrial]) -> list[Comparison]:
    rows: list[Comparison] = []
    for name, by_scheme in summary(trials).items():
        for scheme, by_frequency in by_scheme.items():
            for frequency_hz in FREQUENCIES_HZ:
                values = by_frequency[key_of(frequency_hz)]
                for prepared, words in PREPARED.items():
                    for quantity in QUANTITIES:
                        key = name_of(prepared, quantity)
                        if key not in values:
                            continue
                        text = f"{TITLES[name]}, {scheme.upper()} {quantity}, {frequency_hz:g} Hz"
                        worst = f"worst {values[f'{key}_worst']:.2f} %"
                        text = f"{text}{words}, median"
                        rows.append(Comparison(text, "%", None, values[key], worst))
    return rows


def plain(trial: BeyondTrial | GripTrial) -> dict[str, Any]:
    """Return a trial as a flat table for ``paper.json``."""
    tree: dict[str, Any] = {}
    for each in fields(trial):
        value = getattr(trial, each.name)
        if isinstance(value, Draw | Errors):
            tree |= {one.name: getattr(value, one.name) for one in fields(value)}
        else:
            tree[each.name] = value
    return tree


def _of(
    trials: Sequence[BeyondTrial], name: str, frequency_hz: float, prepared: str
) -> list[BeyondTrial]:
    wanted = (name, "pbsmic", frequency_hz, prepared)
    return [t for t in trials if (t.hysteresis, t.scheme, t.frequency_hz, t.prepared) == wanted]


def _by_class(draw: Callable[[Axis, str], None], x: str, y: str) -> bytes:
    """Draw one diagram for each class of hysteresis, with axes from 0; x and y are the axis
    labels.
    """

    def draw_all(axes: list[Axis]) -> None:
        for axis, name in zip(axes, CLASSES, strict=True):
            draw(axis, name)
            axis.set_ylim(bottom=0.0)
            label(axis, x, y, TITLES[name])
            legend(axis)

    return picture(1, 2, 4.2, draw_all)


def _scatter(trials: Sequence[BeyondTrial]) -> bytes:
    def draw(axis: Axis, name: str) -> None:
        for frequency_hz, color in COLORS.items():
            some = [trial.errors for trial in _of(trials, name, frequency_hz, "")]
            positions = [found.position_percent for found in some]
            forces = [found.force_percent for found in some]
            words = f"{frequency_hz:g} Hz"
            axis.plot(positions, forces, "o", color=color, markersize=4, label=words)
        axis.set_xlim(left=0.0)

    return _by_class(draw, "position RMSE / %", "force RMSE / %")


def _pairs(trials: Sequence[BeyondTrial]) -> bytes:
    """Draw the force error with a residual run over that without; points below the line are
    improvements.
    """

    def draw(axis: Axis, name: str) -> None:
        most = 0.0
        for frequency_hz, color in COLORS.items():
            plain, made = (
                {t.draw.seed: t.errors.force_percent for t in _of(trials, name, frequency_hz, w)}
                for w in ("", "dry_run")
            )
            before, after = [plain[seed] for seed in made], list(made.values())
            most = max((most, *before, *after))
            words = f"{frequency_hz:g} Hz"
            axis.plot(before, after, "o", color=color, markersize=4, label=words)
        axis.plot([0.0, most], [0.0, most], color=RED, linewidth=0.8, linestyle=":")
        axis.set_xlim(left=0.0)

    return _by_class(draw, "force RMSE before / %", "after / %")


def _cycles(trials: Sequence[BeyondTrial]) -> bytes:
    """Draw the position error of each cycle, as the median over the rigs."""

    def draw(axis: Axis, name: str) -> None:
        for frequency_hz, color in COLORS.items():
            some = [t.cycles_percent for t in _of(trials, name, frequency_hz, "learned")]
            medians = [median(errors) for errors in zip(*some, strict=True)]
            cycles = range(1, len(medians) + 1)
            words = f"{frequency_hz:g} Hz"
            axis.plot(cycles, medians, "o-", color=color, markersize=3, label=words)
        axis.axvline(LEARNED_CYCLES + 0.5, color=RED, linewidth=0.8, linestyle=":")

    return _by_class(draw, "cycle at full amplitude", "position RMSE, median / %")


def _grips(trials: Sequence[GripTrial]) -> bytes:
    def draw(axis: Axis, name: str) -> None:
        for profile, color in zip(PROFILES, (ORANGE, BLUE), strict=True):
            some = [t for t in trials if (t.hysteresis, t.profile) == (name, profile)]
            peaks = [one.peak_over_planned for one in some]
            held = [one.hold_error_percent for one in some]
            axis.plot(peaks, held, "o", color=color, markersize=4, label=profile)

    return _by_class(draw, "peak over planned", "error over the hold / %")
