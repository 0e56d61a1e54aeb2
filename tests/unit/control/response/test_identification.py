"""Identification of a free response: data from its own model class, and from another."""

from collections.abc import Callable
from dataclasses import replace
from math import sin, sqrt

import numpy as np
import pytest

from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.teaching import COURSE
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import (
    Column,
    creep_columns,
    play_columns,
    simulate,
)
from pincette.control.response.identification import (
    ALL,
    Candidates,
    identify_free_response,
)
from pincette.control.response.play_fit import REACH, spread_creep_times, spread_thresholds
from pincette.sim.plant.hysteresis import BoucWen, advance_hysteresis
from pincette.sim.plant.relays import follow_relays, loop_of_relays

PERIOD_S, NOISE_UM = 0.02, 0.03
MODEL = HysteresisModel((0.0, 0.4, 0.8), (12.0, 4.0, 2.0), (0.5, 5.0), (0.03, 0.05))
PLAIN = Candidates(families=((0.0,),), curved=(False,), bent=(False,), ridges=(1e-6,), beside=())
FEW = PLAIN._replace(families=((0.0,), (0.7,)), curved=(False, True))


def drive(count: int) -> list[float]:
    """Return two incommensurate swings, which give nested loops."""
    return [1.2 * sin(0.011 * k) + 0.9 * sin(0.037 * k) for k in range(count)]


def noise(count: int, seed: int = 1) -> Column:
    return np.random.default_rng(seed).normal(0.0, NOISE_UM, count)


def test_the_model_that_generated_the_motion_is_identified() -> None:
    voltage_V = drive(2000)
    x_um = simulate(MODEL, np.array(voltage_V), PERIOD_S) + noise(2000) + 70.0
    found = identify_free_response(
        voltage_V, x_um.tolist(), PERIOD_S, thresholds_V=(0.0, 0.4, 0.8), creep_times_s=(0.5, 5.0)
    )
    assert found.model.weights_um_per_V == pytest.approx(MODEL.weights_um_per_V, rel=0.02)
    assert found.model.creep_fractions == pytest.approx(MODEL.creep_fractions, rel=0.1)
    assert found.residual_um == pytest.approx(0.03, rel=0.1)


def test_an_initially_poled_actuator_is_recognized_by_its_later_motion() -> None:
    drives = np.array([*np.linspace(0.0, 3.0, 100), *np.linspace(3.0, 0.0, 100), *drive(3000)])
    x_um = simulate(MODEL, drives, PERIOD_S) + noise(len(drives))
    found, taken_for_unpoled = (
        identify_free_response(
            drives[200:].tolist(),
            x_um[200:].tolist(),
            PERIOD_S,
            thresholds_V=(0.0, 0.4, 0.8),
            creep_times_s=(0.5, 5.0),
            unpoled=unpoled,
        )
        for unpoled in (False, True)
    )
    assert found.model.weights_um_per_V == pytest.approx(MODEL.weights_um_per_V, rel=0.1)
    assert found.residual_um < taken_for_unpoled.residual_um


def test_fading_and_curvature_are_identified_if_present() -> None:
    thresholds = spread_thresholds(4.0, 0.7, 9)
    fadings = [0.7 / threshold for threshold in thresholds]
    model = HysteresisModel(
        (0.0, *thresholds),
        (12.0, 0.5, 0.5, 2.5, 0.5, 0.5, 2.5, 0.5, 0.5, 5.0),
        (0.5,),
        (0.03,),
        fadings_per_V=(0.0, *fadings),
        curvature_um_per_V2=-0.3,
    )
    voltage_V = drive(2500)
    x_um = simulate(model, np.array(voltage_V), PERIOD_S) + noise(2500)
    arguments = (voltage_V, x_um.tolist(), PERIOD_S)
    found = identify_free_response(*arguments, candidates=FEW)
    faded = [
        threshold * fading
        for threshold, fading in zip(
            found.model.thresholds_V, found.model.fadings_per_V, strict=True
        )
    ]
    assert max(faded) == pytest.approx(0.7)
    assert found.model.curvature_um_per_V2 == pytest.approx(-0.3, rel=0.1)
    assert found.residual_um < 0.045
    assert identify_free_response(*arguments, candidates=PLAIN).residual_um > (
        2.0 * found.residual_um
    )


def bouc_wen_um(voltage_V: Column, shape: BoucWen) -> Column:
    """Return an actuator of the Bouc-Wen class with a loop some 35 % wide, and creep."""
    h, before = 0.0, 0.0
    rows = np.empty(len(voltage_V))
    for index, u in enumerate(voltage_V.tolist()):
        h, before = advance_hysteresis(shape, h, u - before), u
        rows[index] = 22.0 * (u - h)
    return rows + creep_columns((0.3, 3.0), rows, PERIOD_S) @ np.array([0.02, 0.02])


def test_an_actuator_of_the_bouc_wen_class_is_modelled_with_one_play_that_never_yields() -> None:
    """This also holds if the plays leave at most three times the noise."""
    noise_um = 2.0 * NOISE_UM
    voltage_V = 1.3 * np.array(drive(2500))
    shape = BoucWen(A_um_per_V=0.55, b_per_V=1.0, g_per_V=0.3)
    x_um = bouc_wen_um(voltage_V, shape) + 2.0 * noise(2500)
    arguments = (voltage_V.tolist(), x_um.tolist(), PERIOD_S)
    found = identify_free_response(*arguments, candidates=FEW._replace(beside=ALL.beside))
    model = found.model
    assert model.fadings_per_V[-1] * model.thresholds_V[-1] == pytest.approx(1.0)
    assert model.fadings_per_V[-1] == pytest.approx(1.3, rel=0.03)
    assert model.return_fadings_per_V[-1] == pytest.approx(0.7, rel=0.03)
    assert found.residual_um < 1.3 * noise_um
    without = identify_free_response(*arguments, candidates=FEW)
    assert 2.0 * found.residual_um < without.residual_um < 3.0 * noise_um


def relays_um(voltage_V: Column) -> Column:
    """Return an actuator of 1200 Preisach relays, which has neither plays nor decay, and a line."""
    random = np.random.default_rng(6)
    half_width = random.gamma(2.0, 0.25, 1200)
    middle = random.normal(0.3, 1.0, 1200)
    up = np.zeros(1200, dtype=bool)
    rows = np.empty(len(voltage_V))
    for index, u in enumerate(voltage_V.tolist()):
        up = (up | (u > middle + half_width)) & (u > middle - half_width)
        rows[index] = 10.0 * u + 0.02 * np.count_nonzero(up)
    return rows


def stops_um(voltage_V: Column) -> Column:
    """Return an actuator of 60 stops, whose density falls with their height, a line, and creep."""
    heights = np.linspace(0.02, 2.4, 60)
    stops, before = np.zeros(60), 0.0
    rows = np.empty(len(voltage_V))
    for index, u in enumerate(voltage_V.tolist()):
        stops = np.clip(stops + (u - before), -heights, heights)
        before = u
        rows[index] = 19.0 * u - 0.18 * float(np.exp(-0.6 * heights) @ stops)
    return rows + creep_columns((0.3, 3.0), rows, PERIOD_S) @ np.array([0.02, 0.02])


@pytest.mark.parametrize("made_um", [relays_um, stops_um], ids=["relays", "stops"])
def test_an_actuator_of_another_class_without_fading_gets_no_fading(
    made_um: Callable[[Column], Column],
) -> None:
    voltage_V = np.array([0.0, *np.linspace(0.0, -2.2, 60), *drive(4000)])
    x_um = made_um(voltage_V)
    found = identify_free_response(
        voltage_V.tolist(), (x_um + noise(len(x_um))).tolist(), PERIOD_S, unpoled=False
    )
    straight_um = float(np.std(x_um - np.polyval(np.polyfit(voltage_V, x_um, 1), voltage_V)))
    print(f"residual {found.residual_um:.4f} µm of {straight_um:.4f} µm, {found.model}")
    assert found.model.fadings_per_V == ()
    assert found.residual_um < 0.2 * straight_um


def teaching(laps: int) -> Column:
    """Return the motion of the calibration ``free_response``, in volts at its rate."""
    legs = [(-0.3 + leg.to * 3.2, leg.pace * 3.0, leg.rest_s) for leg in COURSE] * laps
    path = voltage_moves([(0.0, 3.0, 0.0), *legs])
    count = int(path.duration_s / PERIOD_S)
    return np.array([path.at(k * PERIOD_S) for k in range(count)])


def test_bends_are_identified_if_the_loop_width_depends_on_the_voltage() -> None:
    """Preisach relays, as in the simulated rig: the model removes three quarters of the error."""
    relays = loop_of_relays(19.0, 0.2, 2.5, 2.0, 4.0, 1.4)
    voltage_V = teaching(1)
    behind_um = [0.0] * len(voltage_V)
    follow_relays(relays, 0.0, (), voltage_V.tolist(), behind_um)
    x_um = 19.0 * voltage_V - np.array(behind_um)
    arguments = (voltage_V.tolist(), (x_um + noise(len(x_um))).tolist(), PERIOD_S)
    found, plain = (
        identify_free_response(*arguments, candidates=FEW._replace(bent=bent), unpoled=False)
        for bent in ((False, True), (False,))
    )
    missed_um, before_um = (
        sqrt(max(0.0, one.residual_um**2 - NOISE_UM**2)) for one in (found, plain)
    )
    print(f"besides noise {missed_um:.3f} µm, without bends {before_um:.3f} µm")
    assert found.model.squares_um_per_V2
    assert missed_um < 0.5 * before_um


def test_plays_that_need_no_bends_get_none() -> None:
    voltage_V = teaching(1)
    x_um = simulate(MODEL, voltage_V, PERIOD_S) + noise(len(voltage_V))
    found = identify_free_response(voltage_V.tolist(), x_um.tolist(), PERIOD_S)
    assert found.model.squares_um_per_V2 == ()
    assert found.residual_um < 2.0 * NOISE_UM


def test_collinear_plays_stay_bounded() -> None:
    voltage_V = drive(4000)
    x_um = simulate(MODEL, np.array(voltage_V), PERIOD_S)
    thresholds = [0.01 * index for index in range(80)]
    found = identify_free_response(
        voltage_V, x_um.tolist(), PERIOD_S, thresholds_V=thresholds, candidates=PLAIN
    )
    assert max(abs(weight) for weight in found.model.weights_um_per_V) < 20.0


def test_the_ridge_parameter_is_chosen_by_validation_on_other_motion() -> None:
    voltage_V = drive(1600)
    x_um = simulate(MODEL, np.array(voltage_V), PERIOD_S) + noise(1600)
    arguments = (voltage_V, x_um.tolist(), PERIOD_S)
    heavy = identify_free_response(*arguments, candidates=PLAIN._replace(ridges=(0.1,)))
    chosen = identify_free_response(*arguments, candidates=PLAIN._replace(ridges=(0.1, 1e-6)))
    assert chosen.residual_um < 0.5 * heavy.residual_um


@pytest.mark.parametrize("share", [0.0, 0.35, 0.7])
def test_the_widest_play_of_a_family_yields_within_the_travelled_range(share: float) -> None:
    thresholds = spread_thresholds(3.0, share, 9)
    assert thresholds == pytest.approx([thresholds[0] * (k + 1) for k in range(9)])
    widest_V = thresholds[-1]
    way_V = np.array([-4.0, *np.linspace(0.0, 3.0, 301) - 4.0])
    plays_V = play_columns((widest_V,), (share / widest_V,), way_V)[1:, 0]
    behind_V = way_V[1:] - plays_V
    yields = int(np.argmax(behind_V >= widest_V * (1.0 - 1e-9)))
    assert yields * 0.01 == pytest.approx(REACH * 3.0, abs=0.01)


def test_creep_time_constants_are_spread_over_the_duration_of_the_motion() -> None:
    assert spread_creep_times(0.02, 60.0) == pytest.approx((0.1, 0.5, 2.5, 12.5))
    assert spread_creep_times(0.02, 63.0)[-1] == pytest.approx(62.5)


def test_a_displacement_that_would_decrease_after_a_reversal_is_refused() -> None:
    """Rising over the whole travel, falling where a curved branch turns back."""
    voltage_V = drive(2000)
    bent = replace(MODEL, creep_times_s=(), creep_fractions=(), curvature_um_per_V2=-5.0)
    x_um = simulate(bent, np.array(voltage_V), PERIOD_S)
    with pytest.raises(ValueError, match=r"slope at 2\.\d+ V = -"):
        identify_free_response(
            voltage_V,
            x_um.tolist(),
            PERIOD_S,
            thresholds_V=MODEL.thresholds_V,
            creep_times_s=(),
            candidates=PLAIN._replace(curved=(True,)),
        )


@pytest.mark.parametrize(
    ("voltage_V", "x_um", "text"),
    [
        ([0.0] * 100, [0.0] * 99, "100 voltages for 99 positions"),
        (drive(15), [0.0] * 15, r"travels 0\.\d+ V, must be at least 1\.000 V"),
        (drive(76), [0.0] * 76, "57 samples, must be at least 60 for 3 coefficients"),
        ([float("nan")] * 100, [0.0] * 100, "a sample is not finite"),
        (drive(400), [-19.0 * u for u in drive(400)], "slope up to .* V = -"),
    ],
)
def test_an_uninformative_motion_is_refused(
    voltage_V: list[float], x_um: list[float], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        identify_free_response(voltage_V, x_um, PERIOD_S, thresholds_V=(0.0, 0.5), creep_times_s=())


def rests(seconds: float) -> Column:
    return np.zeros(round(seconds / PERIOD_S))


AWKWARD: dict[str, Column] = {
    "a constant voltage": np.full(2000, 1.5),
    "rests first": np.concatenate([rests(120.0), drive(2000)]),
    "rests last": np.concatenate([drive(2000), rests(120.0)]),
    "rests most of the time": np.concatenate([rests(60.0), drive(400), rests(60.0)]),
    "one step": np.concatenate([rests(10.0), np.full(500, 2.0)]),
    "one stroke": np.linspace(0.0, 3.0, 1500),
    "few samples": np.array(drive(130)),
    "no samples": np.empty(0),
    "one sample": np.zeros(1),
    "steps of the output": np.round(np.array(drive(2000)) / 0.1) * 0.1,
    "rests between": np.concatenate(
        [drive(1000), np.full(1000, drive(1000)[-1]), drive(2000)[1000:]]
    ),
    "one late step": np.concatenate([rests(32.0), np.full(400, 2.0)]),
    "one swing": np.concatenate([np.linspace(0.0, 3.0, 1000), np.linspace(3.0, 0.0, 1000)]),
    "faster than creep": 1.5 * np.sin(2.9 * np.arange(2000)),
}


@pytest.mark.parametrize(
    ("unpoled", "still", "period_s", "candidates"),
    [
        (False, False, 0.02, ALL),
        (True, False, 0.005, FEW),
        (False, True, 0.02, PLAIN),
    ],
    ids=["", "unpoled, 5 ms", "still"],
)
@pytest.mark.parametrize("record", AWKWARD)
def test_an_unusual_record_gives_a_valid_model_or_an_error_message(
    record: str, *, unpoled: bool, still: bool, period_s: float, candidates: Candidates
) -> None:
    u = AWKWARD[record]
    x = np.full(len(u), 3.0)
    if not still and len(u):
        x = simulate(MODEL, u, period_s) + noise(len(u))
    stated = ""
    try:
        found = identify_free_response(
            u.tolist(), x.tolist(), period_s, unpoled=unpoled, candidates=candidates
        )
    except np.linalg.LinAlgError:
        raise
    except ValueError as error:
        stated, found = str(error), None
    if found is None:
        assert any(unit in stated for unit in (" V", "samples", "µm/V")), stated
        return
    assert not still
    left_um = x - simulate(found.model, u, period_s)
    assert float(np.std(left_um[int(0.75 * len(u)) :])) == pytest.approx(found.residual_um)
    assert found.residual_um < 0.03 * float(np.ptp(x))
