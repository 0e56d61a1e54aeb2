"""The free response of randomly drawn rigs: gain within 1 %, and a model that is valid on other
motions."""

from dataclasses import replace

import numpy as np
import pytest

from pincette.control.response.free_calibration import calibrate_free_response
from tests.unit.control.calibration.bench import base, drawn, percent, table, truth
from tests.unit.control.calibration.freeing import (
    SAMPLES_PER_CYCLE,
    free_calibration,
    freed,
    freed_demo,
    try_few_models,
)


def judge(seeds: range) -> None:
    rows: list[list[float]] = []
    for seed in seeds:
        found, true = free_calibration(seed), truth(seed)
        creep = 100.0 * drawn(seed).creep_per_decade
        rows.append(
            [
                percent(found.gain.gain_um_per_V, true.piezo_um_per_V),
                100.0 * found.gain.uncertainty_um_per_V / true.piezo_um_per_V,
                found.gain.loop_percent,
                found.gain.loop_percent - true.loop_percent,
                percent(found.creep.percent_per_decade, creep),
                found.model_residual_um,
                found.cycles_residual_um,
            ]
        )
    print(table("  d_p / %    u(d_p)    loop/%     error   creep/%   left/µm cycles/µm", rows))
    worst = np.max(np.abs(np.array(rows)), axis=0)
    assert worst[0] < 0.2
    assert worst[3] < 1.0
    # The creep of the previous motion continues during that of the step.
    assert worst[4] < 15.0
    assert worst[5] < 0.25


def test_the_free_response_of_two_rigs_is_identified() -> None:
    judge(range(2))


@pytest.mark.slow
def test_the_free_response_of_twenty_rigs_is_identified() -> None:
    judge(range(20))


def test_the_demo_rig_has_the_papers_gain() -> None:
    motion = freed_demo()
    found = calibrate_free_response(motion, SAMPLES_PER_CYCLE)
    assert found.gain.gain_um_per_V == pytest.approx(19.0, rel=0.005)
    assert found.gain.loop_percent == pytest.approx(18.5, abs=0.5)
    # Once the growing swings are slow, a new arm is described as well as one that was moved before.
    new = calibrate_free_response(motion, SAMPLES_PER_CYCLE, unpoled=True)
    assert new.model_residual_um == pytest.approx(found.model_residual_um, rel=0.05)
    assert found.model_residual_um < 0.1
    assert float(np.std(found.x_um - found.model_um)) < 0.2


def test_an_arm_that_was_moved_before_is_recognized() -> None:
    _, motion = freed(base(), moved_before=True)
    moved = calibrate_free_response(motion, SAMPLES_PER_CYCLE)
    assert not moved.unpoled
    assert moved.model_residual_um < 0.15


def test_a_record_without_a_voltage_step_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    try_few_models(monkeypatch)
    motion = freed_demo()
    rest = slice(motion.after_step.start, motion.after_step.start + 100)
    still = slice(motion.after_step.start + 100, motion.after_step.stop)
    with pytest.raises(ValueError, match="must be a step"):
        calibrate_free_response(
            replace(motion, before_step=rest, after_step=still), SAMPLES_PER_CYCLE, unpoled=True
        )
