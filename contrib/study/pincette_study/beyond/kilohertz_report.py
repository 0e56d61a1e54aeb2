"""Tables of grips and paths at T = 1 ms."""

from collections.abc import Mapping, Sequence
from typing import Any

from pincette_study.beyond.report import (
    FIGURES,
    QUANTITIES,
    TITLES,
    key_of,
    medians,
    name_of,
    plain,
)
from pincette_study.beyond.report import summary as tracks_summary
from pincette_study.beyond.tracks import BeyondTrial, BeyondTrials, GripTrial
from pincette_study.report import Comparison, Section

PREPARED: Mapping[str, str] = {
    "": "",
    "dry_run": ", after a residual run",
    "mode_80": ", the mode 20 % lower",
    "mode_120": ", the mode 20 % higher",
    "contact_50": ", the contact half as stiff",
    "contact_200": ", the contact twice as stiff, half the path",
    "delay_100": ", a delay of 1 T",
    "noise_300": ", three times the noise",
    "missed_1": ", 1 % of the samples lost",
}
GRIPS: Mapping[str, str] = {"quick": "", "dry_run": ", after a residual run"}


def summary(found: BeyondTrials) -> dict[str, Any]:
    """Return medians over the rigs of tracks and grips, by class, scheme and frequency.

    The names are those of ``report.summary`` and ``report.grip_summary``.
    """
    grips = {
        name: medians({one: [getattr(trial, one) for trial in some] for one in FIGURES})
        for name, some in _grips(found.grips).items()
    }
    return {**tracks_summary(found.tracks), "grip": grips}


def _grips(trials: Sequence[GripTrial]) -> dict[str, list[GripTrial]]:
    by_name = {name: [one for one in trials if one.profile == name] for name in GRIPS}
    return {name: some for name, some in by_name.items() if some}


def section(found: BeyondTrials) -> Section:
    """Return the report's section on T = 1 ms."""
    rigs = len({trial.draw.seed for trial in found.tracks})
    return Section(
        key="beyond.kilohertz",
        title="At 1 kHz: the law with a filtered perturbation",
        text=(
            f"{rigs} rigs of each class of hysteresis, the first of those above, with fast "
            "instruments and T = 1 ms: default gains, estimated force in the loop, and the "
            "models that were found at 20 ms. Position as measured, force as it truly was, in "
            "per cent of peak to peak.",
            "Off nominal, one rig of each class differs from its calibration, and the law "
            "is not informed. Every such path ran to its end: it is stable.",
        ),
        comparisons=(*_grip_rows(found.grips), *_track_rows(found.tracks)),
        data={"trials": [plain(trial) for trial in (*found.grips, *found.tracks)]},
    )


def _grip_rows(trials: Sequence[GripTrial]) -> list[Comparison]:
    rows: list[Comparison] = []
    for name, some in _grips(trials).items():
        for figure, (words, unit) in FIGURES.items():
            values = medians({figure: [getattr(one, figure) for one in some]})
            worst = f"worst {values[f'{figure}_worst']:.3g} {unit}".rstrip()
            text = f"quick grip{GRIPS[name]}: {words}"
            rows.append(Comparison(text, unit, None, values[figure], worst))
    return rows


def _track_rows(trials: Sequence[BeyondTrial]) -> list[Comparison]:
    tree = tracks_summary(trials)
    seen = dict.fromkeys((one.hysteresis, one.scheme, one.frequency_hz) for one in trials)
    rows: list[Comparison] = []
    for name, scheme, frequency_hz in seen:
        values = tree[name][scheme][key_of(frequency_hz)]
        for prepared, words in PREPARED.items():
            for quantity in QUANTITIES:
                key = name_of(prepared, quantity)
                if key not in values:
                    continue
                text = f"{TITLES[name]}, {quantity}, {frequency_hz:g} Hz{words}, median"
                worst = f"worst {values[f'{key}_worst']:.2f} %"
                rows.append(Comparison(text, "%", None, values[key], worst))
    return rows
