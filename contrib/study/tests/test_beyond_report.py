"""Medians and worst values of the results beyond the paper, and their pictures."""

from dataclasses import replace

import pytest

from pincette_study.beyond.report import grip_section, grip_summary, section, summary
from pincette_study.beyond.tracks import CLASSES, PROFILES, BeyondTrial, BeyondTrials, GripTrial
from pincette_study.closed_loop import Errors
from pincette_study.precision import FREQUENCIES_HZ, SCHEMES
from pincette_study.rigs import Draw

PERCENTS = (0.4, 0.9, 0.5)
SHARE = {"": 1.0, "dry_run": 0.5, "learned": 0.25}
"""Share of the error for each preparation of a trial; all differ, so that a mix-up is detected."""


def draw(seed: int) -> Draw:
    return Draw(seed, 2.1, 15.0, 1.5)


def errors(percent: float) -> Errors:
    return Errors(
        position_um=0.0845 * percent,
        position_percent=percent,
        force_mN=0.4 * percent,
        force_percent=2.0 * percent,
        largest_um=0.3,
        largest_mN=0.9,
        true_position_percent=0.1,
        estimated_force_percent=0.2,
    )


def trials() -> BeyondTrials:
    tracks = [
        BeyondTrial(
            name,
            draw(101 + number),
            scheme,
            frequency_hz,
            errors(share * percent),
            prepared,
            (1.0, 0.5, share * percent) if prepared == "learned" else (),
        )
        for name in CLASSES
        for number, percent in enumerate(PERCENTS)
        for scheme in SCHEMES
        for frequency_hz in FREQUENCIES_HZ
        for prepared, share in SHARE.items()
    ]
    grips = [
        GripTrial(name, draw(101 + number), profile, 3.0 + number, 1.0 + 0.01 * number, percent)
        for name in CLASSES
        for number, percent in enumerate(PERCENTS)
        for profile in PROFILES
    ]
    return BeyondTrials(tracks, grips)


def test_a_summary_has_the_median_and_the_worst_value_of_each_figure() -> None:
    found = summary(trials().tracks)
    assert list(found) == list(CLASSES)
    for by_scheme in found.values():
        assert list(by_scheme) == list(SCHEMES)
        for by_frequency in by_scheme.values():
            assert list(by_frequency) == ["hz_0_5", "hz_2", "hz_5"]
            for values in by_frequency.values():
                assert values["position_percent"] == 0.5
                assert values["position_percent_worst"] == 0.9
                assert values["force_percent"] == 1.0
                assert values["dry_run_force_percent"] == 0.5
                assert values["dry_run_force_percent_worst"] == 0.9
                assert values["learned_position_percent"] == 0.125
                assert values["learned_position_percent_worst"] == 0.225


def test_one_bad_rig_changes_only_the_worst_value() -> None:
    tracks = trials().tracks
    first = tracks[0]
    tracks[0] = replace(first, errors=errors(7.0))
    values = summary(tracks)[first.hysteresis][first.scheme]["hz_0_5"]
    assert (values["position_percent"], values["position_percent_worst"]) == (0.9, 7.0)


def test_a_rig_without_a_residual_run_is_omitted_from_its_medians_and_reported() -> None:
    found = trials()
    missing = [
        trial
        for trial in found.tracks
        if trial.prepared != "dry_run" or (trial.draw.seed, trial.frequency_hz) == (101, 0.5)
    ]
    values = summary(missing)["relays"]["dsmifc"]
    assert values["hz_0_5"]["dry_run_force_percent"] == pytest.approx(0.4)
    assert "dry_run_force_percent" not in values["hz_2"]
    reported = section(BeyondTrials(missing, found.grips))
    assert any("4 of 36 tracks had residual runs" in text for text in reported.text)


def test_grip_figures_cover_all_classes_and_are_grouped_by_profile() -> None:
    found = grip_summary(trials().grips)
    assert list(found) == list(PROFILES)
    for values in found.values():
        assert values["seconds_without_hold"] == 4.0
        assert values["seconds_without_hold_worst"] == 5.0
        assert values["peak_over_planned"] == pytest.approx(1.01)
        assert values["peak_over_planned_worst"] == pytest.approx(1.02)
        assert (values["hold_error_percent"], values["hold_error_percent_worst"]) == (0.5, 0.9)


def test_the_page_shows_every_number_and_four_pictures() -> None:
    found = trials()
    reported, grips = section(found), grip_section(found)
    assert [picture.name for picture in (*reported.pictures, *grips.pictures)] == [
        "beyond",
        "dry_run",
        "learning",
        "grips",
    ]
    assert all(one.png.startswith(b"\x89PNG") for one in (*reported.pictures, *grips.pictures))
    # Class, scheme, frequency, preparation, quantity; profile, figure.
    assert len(reported.comparisons) == 2 * 2 * 3 * 3 * 2
    assert len(grips.comparisons) == 2 * 3
    assert reported.data is not None
    row = reported.data["trials"][-1]
    assert row["seed"] == 103
    assert row["prepared"] == "learned"
    assert row["position_percent"] == pytest.approx(0.125)
