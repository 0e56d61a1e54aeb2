"""Random rigs on an independent plant, brought up and used through the supervisor."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.campaign.__main__ import HEADING, campaign, write_section
from tests.support.campaign.arm import Part
from tests.support.campaign.drawing import draw
from tests.support.campaign.hysteresis import CLASSES, Class, drawn, loop
from tests.support.campaign.judgement import run_page, table, targets
from tests.support.campaign.treatment import Gripped, Treated

FEW, FIRST = 6, 1001
"""Rigs of the full test, and the seed of the first."""
ALL = 200
WORST_PEAK = 1.5
"""Largest true force over the plan that any rig may reach, in any event."""


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize("share", [0.05, 0.15, 0.25])
def test_a_randomly_drawn_arm_has_the_requested_hysteresis_width(kind: Class, share: float) -> None:
    arm, stroke, width = drawn(kind, share, np.random.default_rng(4), far=False)
    assert width == pytest.approx(share, abs=0.01)
    assert stroke > 1.0
    assert loop(arm)[1] == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize("seed", [1028, 2000, 5000, 6002])
def test_no_drawn_arm_moves_against_its_voltage(seed: int) -> None:
    """Every Bouc-Wen arm that could not be brought up moved against its voltage after a turn, by
    up to 0.8 of d_p."""
    hysteresis = draw(seed).arm.hysteresis
    rising = [hysteresis.to(u_V) for u_V in np.linspace(0.0, 3.0, 151)]
    falling = [hysteresis.to(u_V) for u_V in np.linspace(3.0, -1.0, 201)]
    assert np.all(np.diff(rising) > 0.0)
    assert np.all(np.diff(falling) < 0.0)


def test_a_pressed_arm_of_the_campaign_is_in_equilibrium_and_its_part_can_slip() -> None:
    arm = draw(FIRST).arm
    for _ in range(200):
        arm.put_out(1.5)
    free_um = arm.x_um
    arm.part = Part(free_um - 10.0, 2.0, slip_force_mN=None)
    arm.rest(1.0)
    kappa = 2.0 * arm.compliance_um_per_mN
    assert arm.force_mN == pytest.approx(10.0 * 2.0 / (1.0 + kappa), rel=0.02)
    pressed_mN = arm.force_mN
    arm.part = Part(free_um - 10.0, 2.0, slip_force_mN=0.5 * pressed_mN, slip_um=3.0, slips_left=1)
    arm.put_out(1.5)
    arm.rest(1.0)
    assert arm.slips == 1
    assert pressed_mN - arm.force_mN == pytest.approx(3.0 * 2.0 / (1.0 + kappa), rel=0.05)


def test_the_results_section_names_commit_seeds_and_failures(tmp_path: Path) -> None:
    page = tmp_path / "campaign.md"
    page.write_text(f"# Campaign\n\nWritten by hand.\n\n{HEADING}\nof an earlier run\n")
    one, other = draw(FIRST), draw(FIRST + 1)
    wish = replace(one.grips[0], force_mN=10.0)
    grips = [
        Gripped(FIRST, wish, "plain", "gripped", peak_mN=peak_mN, held_mN=10.1, true_mN=true_mN)
        for peak_mN, true_mN in ((10.5, 10.0), (14.0, 10.0), (10.5, 10.4))
    ]
    grips = [replace(grip, uncertainty_mN=0.2) for grip in grips]
    rows = [Treated(one, grips=grips), Treated(other, failed="free_response: failed")]
    write_section(page, run_page(rows, "0123456789ab", 5))
    text = page.read_text()
    assert text.startswith("# Campaign\n\nWritten by hand.\n\n## Latest run\n")
    assert "earlier run" not in text
    assert f"Commit `0123456789ab`, seeds {FIRST} to {FIRST + 1}: 2 of 5 rigs." in text
    misses = [line for line in text.splitlines() if line.startswith("| rig 1")]
    assert len(misses) == 3
    assert ["14.00" in line for line in misses] == [True, False, False]
    assert ["WRONG" in line for line in misses] == [False, True, False]
    assert ["free_response" in line for line in misses] == [False, False, True]


@pytest.mark.full
def test_some_rigs_of_the_campaign_stay_within_the_force_limits() -> None:
    rows = list(campaign(range(FIRST, FIRST + FEW), 1))
    for row in rows:
        print("\n".join(row.lines()))
    print(table(rows))
    grips = [grip for row in rows for grip in row.grips]
    assert grips
    assert all(grip.peak_mN < WORST_PEAK * grip.wish.force_mN for grip in grips)


@pytest.mark.slow
def test_the_campaign_meets_its_targets() -> None:
    jobs = max(1, (os.cpu_count() or 1) - 1)
    rows: list[Treated] = []
    for row in campaign(range(1, ALL + 1), jobs):
        rows.append(row)
        print("\n".join(row.lines()), flush=True)
    print(table(rows))
    missed = [target for target in targets(rows) if not target.met]
    assert not missed
