"""Stiffness of a contact on randomly drawn rigs, by their own calibrated free response."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pincette.control.calibration.contact_stiffness import (
    ContactStiffness,
    Swing,
    contact_stiffness,
)
from pincette.control.calibration.first_touch import first_touch

from .bench import drawn, percent, table, truth
from .freeing import SAMPLES_PER_CYCLE, free_calibration
from .pressing import pressed

S_P, K_E = 0.46, 2.17


def judge(seeds: range) -> None:
    rows: list[list[float]] = []
    for seed in seeds:
        free, true = free_calibration(seed), truth(seed)
        run = pressed(drawn(seed), free)
        s_p = true.compliance_um_per_mN
        growth = free.rehearsed.growth
        found = contact_stiffness(
            run.swings,
            SAMPLES_PER_CYCLE,
            compliance_um_per_mN=s_p,
            free_errors_um=[growth.at(swing.level_V) for swing in run.swings],
            least_force_mN=1.0,
        )
        way_V = float(np.ptp(run.bench.voltage_V[run.approach]))
        touch = first_touch(*run.approached(), s_p, growth.at(way_V))
        K_e = true.contact_stiffness_mN_per_um
        rows.append(
            [
                percent(found.stiffness_mN_per_um, K_e),
                100.0 * found.uncertainty_mN_per_um / K_e,
                percent(found.line.slope, K_e),
                found.line.offset,
                touch.contact_um - true.contact_um,
                touch.uncertainty_um,
                min(level.lowest_mN for level in found.levels),
                max(run.bench.true_force_mN),
            ]
        )
    head = "  K_e / %    u(K_e)    line/% offset/mN    x_e/µm    u(x_e) trough/mN   crest/mN"
    print(table(head, rows))
    errors = np.abs(np.array(rows))
    assert float(np.max(errors[:, 0])) < 2.0
    assert (errors[:, 0] < 2.5 * errors[:, 1]).all()
    assert float(np.max(errors[:, 4])) < 0.25
    assert (errors[:, 4] < 2.5 * errors[:, 5]).all()


def test_the_contact_of_two_rigs_is_identified() -> None:
    judge(range(2))


@pytest.mark.slow
def test_the_contact_of_twenty_rigs_is_identified() -> None:
    judge(range(20))


def swings(noise_um: float = 0.0, s_p: float = S_P, seed: int = 1) -> list[Swing]:
    """Return four levels on a spring, with known free response and a noisy sensor."""
    chance = np.random.default_rng(seed)
    made: list[Swing] = []
    for level_V in (0.3, 1.0, 1.5, 2.0):
        phase = 2.0 * np.pi * np.arange(400) / 100.0
        free_um = 30.0 + 9.5 * level_V * np.sin(phase)
        x = free_um / (1.0 + S_P * K_E) + chance.normal(0.0, noise_um, 400)
        made.append(Swing(level_V, x, (free_um - x) / s_p))
    return made


def stiffness_of(made: list[Swing], **more: Any) -> ContactStiffness:
    return contact_stiffness(made, 100.0, compliance_um_per_mN=S_P, **more)


def test_a_spring_without_noise_is_exact() -> None:
    found = stiffness_of(swings())
    assert found.stiffness_mN_per_um == pytest.approx(K_E, rel=1e-9)
    assert (found.line.slope, found.line.offset) == pytest.approx((K_E, 0.0), abs=1e-6)
    assert [level.residual_mN for level in found.levels] == pytest.approx([0.0] * 4, abs=1e-8)
    assert found.levels[3].x_pp_um == pytest.approx(38.0 / (1.0 + S_P * K_E), rel=1e-4)


def test_noise_in_both_coordinates_does_not_bias_the_stiffness() -> None:
    values = [stiffness_of(swings(0.1, seed=seed)).stiffness_mN_per_um for seed in range(200)]
    standard_error = float(np.std(values)) / 200**0.5
    assert float(np.mean(values)) == pytest.approx(K_E, abs=4.0 * standard_error)
    assert standard_error < 0.002 * K_E


def test_an_error_of_the_compliance_is_stated_as_an_error_of_the_stiffness() -> None:
    wrong = contact_stiffness(
        swings(s_p=1.03 * S_P),
        100.0,
        compliance_um_per_mN=1.03 * S_P,
        compliance_uncertainty_um_per_mN=0.03 * S_P,
    )
    assert percent(wrong.stiffness_mN_per_um, K_E) == pytest.approx(-2.91, abs=0.02)
    stated = wrong.stiffness_mN_per_um * 0.03 / 1.03
    assert wrong.uncertainty_mN_per_um == pytest.approx(stated, rel=1e-3)
    assert wrong.scatter_mN_per_um < 1e-6


def test_an_error_of_the_free_response_common_to_all_levels_is_part_of_the_uncertainty() -> None:
    """If x_1 swings 1 % too far, each level's force is too large by 1 % of x_1 over s_p."""
    made = [
        replace(swing, force_mN=swing.force_mN + 0.01 * (1.0 / S_P + K_E) * np.asarray(swing.x_um))
        for swing in swings()
    ]
    far_um = [0.01 * 19.0 * swing.level_V for swing in made]
    found = stiffness_of(made, free_errors_um=far_um)
    off = found.stiffness_mN_per_um - K_E
    assert off == pytest.approx(0.01 * (1.0 / S_P + K_E), rel=1e-6)
    assert found.uncertainty_mN_per_um == pytest.approx(off, rel=1e-3)
    with pytest.raises(ValueError, match="4 levels for 3 errors of the free response"):
        stiffness_of(made, free_errors_um=far_um[:3])


def lost(made: list[Swing], *levels: int) -> list[Swing]:
    """Return swings of which some lose the contact at their trough."""
    low = [np.maximum(0.0, np.asarray(swing.force_mN) - 20.0) for swing in made]
    return [
        replace(swing, force_mN=low[place]) if place in levels else swing
        for place, swing in enumerate(made)
    ]


def test_a_level_that_loses_the_contact_is_left_out() -> None:
    errors_um = [0.1, 0.2, 0.3, 5.0]
    found = stiffness_of(lost(swings(), 3), least_force_mN=1.0, free_errors_um=errors_um)
    assert found.lost_V == (2.0,)
    assert found.stiffness_mN_per_um == pytest.approx(K_E, rel=1e-9)
    assert [level.level_V for level in found.levels] == [0.3, 1.0, 1.5]
    kept = stiffness_of(swings()[:3], free_errors_um=errors_um[:3])
    assert found.uncertainty_mN_per_um == pytest.approx(kept.uncertainty_mN_per_um)
    assert kept.lost_V == ()


def test_a_contact_that_is_lost_at_two_of_four_levels_is_refused() -> None:
    made = lost(swings(), 2, 3)
    with pytest.raises(ValueError, match="at 2 V peak to peak, must stay above 1 mN"):
        stiffness_of(made, least_force_mN=1.0)


def test_too_few_levels_are_refused() -> None:
    with pytest.raises(ValueError, match="2 levels of voltage: must be at least 3"):
        stiffness_of(swings()[:2])
    made = swings()
    with pytest.raises(ValueError, match="400 positions for 399 forces"):
        stiffness_of([*made[:3], replace(made[3], force_mN=np.asarray(made[3].force_mN)[1:])])
