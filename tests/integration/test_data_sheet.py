"""Data sheets of simulated arms in virtual time, against the truth of the simulator."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from pincette.api.job_kinds import job_kinds
from pincette.config import RigFile
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.characterise import (
    CharacteriseJobRequest,
    CharacteriseResult,
    SheetValue,
)
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import FaultyRequestError, Run, functions_of
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.plugin.figures import Series, series
from pincette_supervisor.plugin.zero_return import zero_return_of
from pincette_supervisor.results.run_samples import RunSamples
from tests.support.rigs import Tree, demo_rig

NOISE_S = 4.0
ARMS: dict[str, Tree] = {
    "demo": {},
    "stiff": {
        "model": {"compliance_um_per_mN": 0.35, "natural_frequency_rad_per_s": 2000.0},
        "simulation": {
            "compliance_um_per_mN": 0.35,
            "natural_frequency_rad_per_s": 2000.0,
            "environment_stiffness_mN_per_um": 2.6,
        },
        "part": {"stiffness_mN_per_um": 2.5},
    },
    "noisy": {
        "sensor": {"noise_um": 0.06},
        "simulation": {"sensor_noise_um": 0.06, "seed": 7, "bead_contact_um": 29.0},
    },
}
"""Changes to the demo rig."""


def run_of(rig: RigFile, **members: Any) -> Run:
    body: dict[str, Any] = {"kind": "characterise", "noise_s": NOISE_S, **members}
    request = CharacteriseJobRequest.model_validate(body)
    planned = plan_job(request, rig)
    assert planned.plan.feasible, planned.plan.violations
    messages = ComposedLoop(rig).play(planned.program)
    return Run(rig, planned, RunSamples.of(messages, rig.rig.period_s).tables().even)


@cache
def sheet_of(name: str) -> tuple[Run, CharacteriseResult]:
    run = run_of(demo_rig(ARMS[name], time="lockstep"))
    found = functions_of(job_kinds()["characterise"]).evaluate(run)
    assert isinstance(found.result, CharacteriseResult)
    assert (found.result.outcome, found.fault) == ("gripped", "")
    return run, found.result


def test_an_arm_that_makes_strokes_before_each_grip_is_characterised() -> None:
    taught: Tree = {"model": {"free_response": {"taught_V": [-0.8, 3.4]}}}
    run = run_of(demo_rig(taught, time="lockstep"), grips=2, noise_s=2.0, condition="always")
    found = functions_of(job_kinds()["characterise"]).evaluate(run).result
    assert isinstance(found, CharacteriseResult)
    assert found.outcome == "gripped"
    left = value(found, "zero_return")
    assert left.conditions["grips"] == 2.0
    force_mN, spread_mN = number(left)
    assert abs(force_mN) <= spread_mN


def value(result: CharacteriseResult, quantity: str) -> SheetValue:
    return next(one for one in result.values if one.quantity == quantity)


def number(found: SheetValue) -> tuple[float, float]:
    assert found.value is not None
    assert found.uncertainty is not None
    return found.value, found.uncertainty


def second_loop(run: Run) -> tuple[Series, Series]:
    """Return true voltage and true position of the second of both loops.

    A tick of the truth contains the position at its sample and the voltage that is output after it:
    that voltage determines the position of the next tick.
    """
    place = series(run.table, "segment") == 2.0
    voltage_V = series(run.table, "true_voltage_V")[place][:-1]
    x_um = series(run.table, "true_x_um")[place][1:]
    return voltage_V[len(x_um) // 2 :], x_um[len(x_um) // 2 :]


@pytest.mark.parametrize("arm", ARMS)
def test_stroke_and_hysteresis_are_those_of_the_simulated_arm(arm: str) -> None:
    run, result = sheet_of(arm)
    voltage_V, x_um = second_loop(run)
    top = int(np.argmax(voltage_V))
    rise_um = float(x_um.max() - x_um[:top].min())
    stroke, spread = number(value(result, "free_stroke"))
    assert abs(stroke - rise_um) <= spread
    assert spread < 0.01 * stroke
    share = np.arange(50, dtype=np.float64) / 49.0
    at_V = voltage_V[0] + share * float(voltage_V[top] - voltage_V[0])
    up = np.asarray(np.interp(at_V, voltage_V[: top + 1], x_um[: top + 1]), dtype=np.float64)
    down = np.asarray(np.interp(at_V, voltage_V[top:][::-1], x_um[top:][::-1]), dtype=np.float64)
    width, spread = number(value(result, "hysteresis_open"))
    assert abs(width - 100.0 * np.max(down - up) / rise_um) <= spread
    assert number(value(result, "hysteresis_closed"))[0] < 0.2 * width


@pytest.mark.parametrize("arm", ARMS)
def test_stiffness_and_mode_are_those_of_the_simulated_arm(arm: str) -> None:
    run, result = sheet_of(arm)
    simulation = run.rig.simulation
    assert simulation is not None
    stiffness, spread = number(value(result, "contact_stiffness"))
    assert abs(stiffness - simulation.environment_stiffness_mN_per_um) <= spread
    mode = value(result, "mode")
    assert mode.value == pytest.approx(simulation.natural_frequency_rad_per_s / (2.0 * np.pi))
    assert (mode.source, mode.uncertainty) == ("assumed", None)
    arm_stiffness = value(result, "arm_stiffness").value
    assert arm_stiffness == pytest.approx(1.0 / simulation.compliance_um_per_mN)


@pytest.mark.parametrize("arm", ARMS)
def test_the_force_error_is_within_its_uncertainty_and_the_noise_equals_that_of_the_sensor(
    arm: str,
) -> None:
    run, result = sheet_of(arm)
    held = np.array([phase == "hold" for phase in run.table["phase"]])
    error_mN = series(run.table, "force_mN")[held] - series(run.table, "true_force_mN")[held]
    stated = [one for one in result.values if one.quantity == "force_uncertainty"]
    assert [one.conditions["at_mN"] for one in stated] == [20.0, 10.0, 5.0]
    assert stated[0].value is not None
    assert abs(float(np.mean(error_mN))) <= stated[0].value
    noise, _ = number(value(result, "position_noise_1_s"))
    # The closed loop adds to the noise of a reading, and removes none.
    assert run.rig.sensor.noise_um <= noise <= 2.0 * run.rig.sensor.noise_um


@pytest.mark.parametrize("arm", ARMS)
def test_the_zero_return_of_ten_grips_is_zero_within_its_uncertainty(arm: str) -> None:
    run, result = sheet_of(arm)
    pressed = series(run.table, "true_force_mN") > 15.0
    assert np.count_nonzero(pressed[1:] & ~pressed[:-1]) == 10
    found = [value(result, f"zero_return{name}") for name in ("", "_scatter", "_worst")]
    assert [one.conditions["grips"] for one in found] == [10.0, 10.0, 10.0]
    (mean_mN, spread_mN), (scatter_mN, _), (worst_mN, worst_spread_mN) = map(number, found)
    assert abs(mean_mN) <= spread_mN < 2.0
    assert abs(mean_mN) < abs(worst_mN) <= worst_spread_mN
    assert 0.0 < scatter_mN < spread_mN
    last = zero_return_of(run.table, run.rig)
    assert last is not None
    assert abs(last.force_mN) <= abs(worst_mN)


def test_measured_responses_have_a_gain_of_1_at_low_frequency_and_lower_bounds_are_marked() -> None:
    _, result = sheet_of("demo")
    assert result.position_response[0].frequency_hz == 0.5
    assert result.position_response[0].gain == pytest.approx(1.0, abs=0.02)
    assert result.force_response[0].gain == pytest.approx(1.0, abs=0.1)
    for quantity, at_hz in (("position_bandwidth", 12.5), ("force_bandwidth", 5.0)):
        found = value(result, quantity)
        assert (found.bound, found.value, found.uncertainty) == ("above", at_hz, None)
    assert result.position_bandwidth_hz is None


def test_the_data_sheet_is_available_as_page_print_and_numbers() -> None:
    run, result = sheet_of("demo")
    functions = functions_of(job_kinds()["characterise"])
    run = replace(run, started_at="2026-11-29T22:14:05.000Z")
    picture = functions.plot(run, functions.evaluate(run), "demo · 1")
    assert isinstance(picture, Picture)
    assert json.loads(picture.vector[".json"])["about"]["date"] == "2026-11-29"
    assert set(picture.vector) == {".svg", ".pdf", ".html", ".json"}
    assert picture.vector[".pdf"].count(b"/Type /Page ") == 2
    page = picture.vector[".html"].decode()
    assert page.count("<tr><td>") == len(result.values)
    assert "<svg" in page
    assert "<td>2026-11-29</td>" in page
    assert "@page { size: A4" in page


def test_a_part_that_leaves_no_room_for_the_stroke_is_refused() -> None:
    near: Tree = {"part": {"contact_um": 6.0}, "simulation": {"bead_contact_um": 6.2}}
    with pytest.raises(FaultyRequestError, match="free motion"):
        plan_job(CharacteriseJobRequest(kind="characterise"), demo_rig(near))


def test_a_job_that_misses_its_part_has_no_values() -> None:
    run = run_of(demo_rig({"simulation": {"bead": False}}, time="lockstep"))
    result = functions_of(job_kinds()["characterise"]).evaluate(run).result
    assert isinstance(result, CharacteriseResult)
    assert (result.outcome, result.values) == ("no_contact", [])
