"""A part in the path of the free motion is detected; no hysteresis is mistaken for one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pincette.config import Simulation, derived
from pincette.control.planning.free_response_program import free_response_program
from pincette.control.response.contact_kink import ContactKink, contact_kink
from pincette.control.response.free_calibration import calibrate_free_response
from pincette.control.response.hysteresis_motion import Column
from tests.support.drawn.random_rigs import random_simulation
from tests.unit.control.calibration.bench import DEMO, PERIOD_S, Bench, base
from tests.unit.control.calibration.freeing import SAMPLES_PER_CYCLE, freed_demo, try_few_models
from tests.unit.control.response.test_measured_hysteresis import measured

RIGS = [(False, None), (False, 3), (True, 4)]
"""Rigs: True if the hysteresis consists of relays; and the seed, None for the demo rig."""


def simulated(relays: bool, seed: int | None) -> Simulation:
    return base() if seed is None else random_simulation(base(), seed, relays=relays)


@cache
def moved(relays: bool, seed: int | None, at_um: float | None) -> tuple[Column, Column, slice]:
    """Return the motion of ``free_response`` with a part at a position, or without one."""
    bead = {"bead": at_um is not None, "bead_contact_um": at_um or 30.0}
    bench = Bench(simulated(relays, seed).model_copy(update=bead))
    program = free_response_program(
        derived.planned_rig(DEMO), from_V=-0.3, to_V=3.5, rate_V_per_s=3.2
    )
    places = bench.play(program.segments)
    until = places["creep"].stop
    return np.array(bench.voltage_V[:until]), np.array(bench.x_um[:until]), places["teach"]


def kink(relays: bool, seed: int | None, at_um: float | None) -> ContactKink | None:
    u, x, course = moved(relays, seed, at_um)
    return contact_kink(u, x, PERIOD_S, course)


@pytest.mark.parametrize(("relays", "seed"), RIGS)
def test_a_free_arm_has_no_kink(relays: bool, seed: int | None) -> None:
    assert kink(relays, seed, None) is None


@pytest.mark.parametrize(
    ("relays", "seed", "at_um"),
    [(*rig, at_um) for rig, at_um in zip(RIGS, (31.2, 5.0, 60.0), strict=True)],
)
def test_a_part_in_the_way_is_found_at_its_position(
    relays: bool, seed: int | None, at_um: float
) -> None:
    found, rig = kink(relays, seed, at_um), simulated(relays, seed)
    print(found)
    assert found is not None
    assert found.x_um == pytest.approx(at_um, abs=2.0)
    softening = rig.compliance_um_per_mN * rig.environment_stiffness_mN_per_um
    # The model of the free motion absorbs some of the contact's effect.
    assert 0.4 * softening < found.softening < 1.6 * softening


@pytest.mark.parametrize("softening", [0.2, 0.5, 1.0])
def test_a_soft_part_is_found_by_its_slope(softening: float) -> None:
    u, x, course = moved(False, None, None)
    pressed = x - softening / (1.0 + softening) * np.maximum(0.0, x - 31.0)
    found = contact_kink(u, pressed, PERIOD_S, course)
    assert found is not None
    assert found.slope_share == pytest.approx(1.0 / (1.0 + softening), abs=0.06)


@pytest.mark.parametrize("bend", [-0.15, 0.15])
def test_a_bent_characteristic_is_not_mistaken_for_a_part(bend: float) -> None:
    u, x, course = moved(False, None, None)
    assert contact_kink(u, x + bend * u**3, PERIOD_S, course) is None


@pytest.mark.parametrize("every", [1, 2, 4], ids=["5 ms", "10 ms", "20 ms"])
def test_a_measured_piezo_stack_shows_a_kink_only_if_one_is_added(every: int) -> None:
    voltage_V, x_um = (np.array(values) for values in measured(0, every))
    assert contact_kink(voltage_V, x_um, every * 0.005) is None
    place_um = float(np.min(x_um) + 0.45 * np.ptp(x_um))
    pressed = x_um - 0.5 * np.maximum(0.0, x_um - place_um)
    found = contact_kink(voltage_V, pressed, every * 0.005)
    assert found is not None
    assert found.x_um == pytest.approx(place_um, abs=0.1 * np.ptp(x_um))


def test_the_calibration_names_the_part_and_what_to_do() -> None:
    motion = freed_demo()
    x = np.asarray(motion.x_um)
    pressed = x - 0.5 * np.maximum(0.0, x - 31.0)
    with pytest.raises(
        ValueError, match=r"changes its slope at 3\d\.\d µm \(1\.\d+ V .*part .*in the way"
    ):
        calibrate_free_response(replace(motion, x_um=pressed), SAMPLES_PER_CYCLE, unpoled=True)


def test_an_unexplained_motion_is_refused() -> None:
    motion = freed_demo()
    x = np.asarray(motion.x_um)
    shaken = x + 4.0 * np.sin(np.arange(len(x)) * 0.021)
    with pytest.raises(ValueError, match=r"\d\.\d+ µm r\.m\.s\., limit"):
        calibrate_free_response(replace(motion, x_um=shaken), SAMPLES_PER_CYCLE, unpoled=True)


def test_a_kink_is_reported_instead_of_refused_if_a_person_has_confirmed_that_there_is_no_part(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    try_few_models(monkeypatch)
    motion = freed_demo()
    x = np.asarray(motion.x_um)
    bent = replace(motion, x_um=x - 0.12 * np.maximum(0.0, x - 31.0))
    with pytest.raises(ValueError, match="no_part"):
        calibrate_free_response(bent, SAMPLES_PER_CYCLE, unpoled=True)
    found = calibrate_free_response(bent, SAMPLES_PER_CYCLE, unpoled=True, no_part=True)
    assert found.kink is not None
    assert found.kink.x_um == pytest.approx(31.0, abs=3.0)


def test_the_calibration_of_a_free_arm_reports_no_findings() -> None:
    motion = freed_demo()
    assert calibrate_free_response(motion, SAMPLES_PER_CYCLE, unpoled=True).kink is None
