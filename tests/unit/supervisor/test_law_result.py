"""Figures of the law computed from samples with known figures."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from pincette.api.results import JobResult
from pincette.control.arm.plant import discretize, printed_arm
from pincette.control.record import replace
from pincette.core.messages import Message
from pincette.records.columns import columns
from pincette_supervisor.plugin.result import common, law_figures, true_perturbation_error
from tests.support.arms import with_arm
from tests.unit.control.laws.model_loop import ModelArm

from . import samples
from .samples import PERIOD_S, PLANT, Tick, run_of

STIFFNESS, TOUCH_UM = 2.1, 4.0
RATES = (0.0, 0.3, -0.2, 0.05)
"""Changes of the perturbation from one sample to the next, in mN, repeated."""


def pressed_arm(count: int = 60) -> tuple[list[Tick], list[float]]:
    """Return samples of an arm that satisfies (4) with a known perturbation, pressed on a
    spring."""
    arm = ModelArm(PLANT, STIFFNESS, TOUCH_UM, TOUCH_UM, TOUCH_UM, TOUCH_UM / 19.0)
    ticks: list[Tick] = []
    p_mN: list[float] = [0.0]
    for seq, tick in enumerate(samples.grip()[:count]):
        voltage_V = (TOUCH_UM + 0.1 * seq) / 19.0
        ticks.append(
            replace(
                tick,
                position=with_arm(tick.position, x_um=arm.x_um),
                estimate=with_arm(tick.estimate, x_um=arm.x_um, force_mN=99.0),
                applied=with_arm(tick.applied, voltage_V=voltage_V),
                truth=with_arm(tick.truth, x_um=99.0, force_mN=arm.force_mN),
            )
        )
        p_mN.append(p_mN[-1] + RATES[seq % len(RATES)])
        arm.drive(voltage_V, p_mN[-1])
    return ticks, p_mN[:-1]


def table_of(ticks: Sequence[Tick]) -> dict[str, list[object]]:
    return columns([message for tick in ticks for message in tick.messages()], PERIOD_S)


def test_the_true_perturbation_error_is_that_of_the_arm() -> None:
    ticks, p_mN = pressed_arm()
    found = true_perturbation_error(table_of(ticks), PLANT)
    # p needs three positions, the voltage before, and the p before.
    assert np.isnan(found[:3]).all()
    wanted = [before - after for before, after in pairwise(p_mN[2:])]
    assert found[3:] == pytest.approx(wanted, abs=1e-9)


def test_the_common_result_has_a_value_for_each_of_its_fields() -> None:
    """The example of a job kind builds its result from them."""
    found = common(run_of("grip", table_of(samples.grip())))
    assert set(JobResult.model_fields) <= set(found)


def test_the_law_result_is_that_of_the_parameter_set() -> None:
    ticks, _ = pressed_arm()
    table = table_of(ticks)
    printed = discretize(printed_arm(), PERIOD_S)
    own, other = (law_figures(table, plant) for plant in (PLANT, printed))
    assert own["true_perturbation_error_mN"].p99 == pytest.approx(0.3)
    # k of the printed set is 2.7e6 times that of the rig, so that a force hardly counts.
    assert other["true_perturbation_error_mN"].p50 > 1e4


def test_missing_or_invalid_measurements_leave_a_gap() -> None:
    ticks, _ = pressed_arm()
    blind = replace(ticks[20], position=with_arm(ticks[20].position, x_um=0.0, valid=False))
    found = true_perturbation_error(table_of([*ticks[:20], blind, *ticks[21:]]), PLANT)
    assert np.flatnonzero(np.isnan(found)).tolist() == [0, 1, 2, 20, 21, 22, 23]
    table = table_of([*ticks[:30], *ticks[31:]])
    found = true_perturbation_error(table, PLANT)
    holes = [table["seq"][place] for place in np.flatnonzero(np.isnan(found))]
    assert holes == [0, 1, 2, 31, 32, 33]


def test_a_real_rig_has_no_true_force() -> None:
    messages: list[Message] = [m for tick in samples.grip() for m in tick.messages()[:-1]]
    found = law_figures(columns(messages, PERIOD_S), PLANT)
    assert found["true_perturbation_error_mN"] is None
    assert found["perturbation_error_mN"].p95 == pytest.approx(0.1)


def test_figures_use_absolute_values_and_the_force_used_by_the_law() -> None:
    ticks = samples.grip()
    seen = [
        replace(tick, telemetry=replace(tick.telemetry, sliding_um=-0.02, perturbation_mN=-0.2))
        for tick in ticks
    ]
    quarter = len(ticks) // 4
    close = [
        replace(tick, telemetry=replace(tick.telemetry, sliding_um=0.01)) for tick in seen[:quarter]
    ]
    found = law_figures(table_of([*close, *seen[quarter:]]), PLANT)
    assert found["sliding_um"].p95 == pytest.approx(0.02)
    # Half width of the band 0.01 µm, and on its edge counts as inside.
    assert found["sliding_in_band"] == pytest.approx(quarter / len(ticks))
    assert found["law_perturbation_mN"].p50 == pytest.approx(0.2)
    assert found["perturbation_error_mN"].p50 == pytest.approx(0.1)
    assert found["residual_um"].p99 == pytest.approx(0.05)


def test_a_job_without_a_sample_has_no_figures() -> None:
    assert set(law_figures(columns([], PERIOD_S), PLANT).values()) == {None}
