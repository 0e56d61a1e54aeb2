"""The Prandtl-Ishlinskii operator and its creep, compared with their definitions."""

from dataclasses import replace
from math import exp, nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    bend_um,
    displacement_um,
    start,
    step,
)
from pincette.control.response.hysteresis_motion import play_columns, simulate, slopes_um_per_V
from pincette.sim.plant.hysteresis import BoucWen, advance_hysteresis

PLAYS = HysteresisModel((0.0, 0.5, 1.0), (10.0, 4.0, 2.0))
CREEPING = replace(PLAYS, creep_times_s=(0.1, 10.0), creep_fractions=(0.05, 0.02))
FADING = HysteresisModel(
    (0.0, 0.5, 1.0, 0.5, 1.0), (10.0, 4.0, 2.0, 1.0, 1.5), fadings_per_V=(0.0, 0.8, 0.8, 1.4, 0.0)
)
"""Two thresholds, each twice; one play of four has no decay."""
BOUC_WEN = HysteresisModel(
    (0.0, 0.8, 0.5, 2.0),
    (10.0, 3.0, 2.0, 1.0),
    fadings_per_V=(0.0, 1.25, 0.0, 0.9),
    return_fadings_per_V=(0.0, 0.6, 0.0, 1.3),
)
"""Two plays of four that never yield and that decay at another rate after a reversal."""
VOLTAGES = st.lists(st.floats(-2.0, 3.0), min_size=1, max_size=20)


def driven(model: HysteresisModel, *voltages_V: float, dt_s: float = 0.0) -> HysteresisState:
    state = start(model)
    for voltage in voltages_V:
        state = step(model, state, voltage, dt_s)
    return state


def position(*voltages_V: float) -> float:
    return displacement_um(PLAYS, driven(PLAYS, *voltages_V))


def test_the_first_stroke_and_its_return_follow_the_play_operators() -> None:
    assert position(2.0) == pytest.approx(10 * 2.0 + 4 * 1.5 + 2 * 1.0)
    # After a reversal a play moves only after 2r.
    assert position(2.0, 1.2) == pytest.approx(10 * 1.2 + 4 * 1.5 + 2 * 1.0)
    assert position(2.0, 0.0) == pytest.approx(10 * 0.0 + 4 * 0.5 + 2 * 1.0)


def test_a_closed_minor_loop_is_erased_from_the_memory() -> None:
    assert position(2.0, 1.0, 1.6, 1.0) == pytest.approx(position(2.0, 1.0))
    assert position(1.0, 0.2, 0.8, 2.0) == pytest.approx(position(2.0))


EACH = pytest.mark.parametrize(
    "model", [PLAYS, FADING, BOUC_WEN], ids=["plays", "fading", "Bouc-Wen"]
)


@EACH
@given(voltages=VOLTAGES)
def test_the_hysteresis_is_rate_independent(model: HysteresisModel, voltages: list[float]) -> None:
    halves: list[float] = []
    before = 0.0
    for voltage in voltages:
        halves += [0.5 * (before + voltage), voltage]
        before = voltage
    whole_um = displacement_um(model, driven(model, *voltages))
    assert displacement_um(model, driven(model, *halves)) == pytest.approx(whole_um, abs=1e-9)


@EACH
@given(voltages=VOLTAGES)
def test_the_displacement_is_an_odd_function_of_the_voltage(
    model: HysteresisModel, voltages: list[float]
) -> None:
    mirrored = driven(model, *[-voltage for voltage in voltages])
    there = driven(model, *voltages)
    assert displacement_um(model, mirrored) == pytest.approx(-displacement_um(model, there))


@EACH
@given(voltages=VOLTAGES)
def test_the_displacement_rises_with_the_voltage(
    model: HysteresisModel, voltages: list[float]
) -> None:
    state = driven(model, *voltages)
    higher = step(model, state, state.voltage_V + 0.01, 0.0)
    assert displacement_um(model, higher) > displacement_um(model, state)


def test_fading_decreases_the_displacement_of_small_loops() -> None:
    there = driven(FADING, 2.0, 1.2)
    shaken = driven(FADING, 2.0, *[1.2 + 0.05 * (-1) ** k for k in range(200)], 1.2)
    assert min(abs(1.2 - play) for play in there.plays_V[1:]) > 0.04
    assert max(abs(1.2 - play) for play in shaken.plays_V[:-1]) < 0.03
    assert shaken.plays_V[-1] == there.plays_V[-1]
    unfaded = driven(PLAYS, 2.0, *[1.2 + 0.05 * (-1) ** k for k in range(200)], 1.2)
    assert displacement_um(PLAYS, unfaded) == pytest.approx(position(2.0, 1.15, 1.2))


def test_a_fading_play_solves_its_differential_equation() -> None:
    end_V, steps = 0.45, 20000
    state = driven(FADING, end_V)
    for play, fading in ((1, 0.8), (3, 1.4)):
        z = 0.0
        for _ in range(steps):
            z += (1.0 - fading * z) * end_V / steps
        assert end_V - state.plays_V[play] == pytest.approx(z, rel=1e-4)


@given(voltages=VOLTAGES, b=st.floats(0.1, 3.0), share=st.floats(-1.0, 1.0))
def test_a_play_that_never_yields_equals_the_bouc_wen_operator(
    voltages: list[float], b: float, share: float
) -> None:
    shape = BoucWen(A_um_per_V=1.0, b_per_V=b, g_per_V=share * b)
    fading, returning = b + shape.g_per_V, b - shape.g_per_V
    if not fading:
        return
    model = HysteresisModel(
        (0.0, 1.0 / fading),
        (10.0, 0.1),
        fadings_per_V=(0.0, fading),
        return_fadings_per_V=(0.0, returning),
    )
    state, h, before = start(model), 0.0, 0.0
    for voltage in voltages:
        state = step(model, state, voltage, 0.0)
        h, before = advance_hysteresis(shape, h, voltage - before), voltage
        assert voltage - state.plays_V[1] == pytest.approx(h, rel=1e-6, abs=1e-9)


@given(voltages=VOLTAGES)
def test_without_fading_a_play_equals_the_plain_play_operator_to_the_bit(
    voltages: list[float],
) -> None:
    play, thresholds = [0.0, 0.0, 0.0], PLAYS.thresholds_V
    for u in voltages:
        play = [max(u - r, min(u + r, y)) for r, y in zip(thresholds, play, strict=True)]
    assert driven(PLAYS, *voltages).plays_V == tuple(play)
    # Such a play is not affected by the decay of others either.
    assert driven(FADING, *voltages).plays_V[-1] == play[-1]


def bent_plays(model: HysteresisModel) -> HysteresisModel:
    """Return bends that make every play a different function, within and beyond its range."""
    count = len(model.thresholds_V)
    return replace(
        model,
        squares_um_per_V2=tuple(0.2 - 0.1 * place for place in range(count)),
        cubes_um_per_V3=tuple(0.03 * place - 0.02 for place in range(count)),
        bent_V=(-0.7, 0.9),
    )


@pytest.mark.parametrize("bends", [False, True])
@EACH
def test_computed_slopes_equal_those_of_small_voltage_steps(
    model: HysteresisModel, bends: bool
) -> None:
    bent = replace(model, curvature_um_per_V2=0.4)
    if bends:
        bent = bent_plays(bent)
    random = np.random.default_rng(3)
    voltage_V = np.cumsum(random.normal(0.0, 0.4, 60))
    plays_V = play_columns(
        bent.thresholds_V, bent.fadings_per_V, voltage_V, bent.return_fadings_per_V
    )
    slopes = slopes_um_per_V(bent, plays_V, voltage_V)
    state = start(bent)
    for voltage, (up, down) in zip(voltage_V.tolist(), slopes.tolist(), strict=True):
        state = step(bent, state, voltage, 0.0)
        for way_V, slope in ((1e-6, up), (-1e-6, down)):
            moved = step(bent, state, voltage + way_V, 0.0)
            rise_um = displacement_um(bent, moved) - displacement_um(bent, state)
            assert rise_um / way_V == pytest.approx(slope, abs=1e-4)


def test_curvature_adds_to_the_static_displacement() -> None:
    bent = replace(PLAYS, curvature_um_per_V2=-0.3)
    assert displacement_um(bent, driven(bent, 2.0, 1.5)) == pytest.approx(
        position(2.0, 1.5) - 0.3 * 1.5**2
    )


def test_the_bend_of_a_play_is_cubic_between_two_voltages_and_linear_beyond() -> None:
    def g(y: float) -> float:
        return bend_um(0.3, -0.1, -1.0, 2.0, y)

    for y in (-1.0, -0.4, 0.0, 1.7, 2.0):
        assert g(y) == pytest.approx(0.3 * y**2 - 0.1 * y**3)
    for end, way in ((2.0, 1.0), (-1.0, -1.0)):
        slope = 0.6 * end - 0.3 * end**2
        assert g(end + 3.0 * way) == pytest.approx(g(end) + 3.0 * way * slope)


def test_bent_plays_have_wider_loops_at_one_voltage_than_at_another() -> None:
    def width_um(model: HysteresisModel, low_V: float, high_V: float) -> float:
        middle_V = 0.5 * (low_V + high_V)
        settled = (low_V, high_V, low_V, high_V)
        falling = displacement_um(model, driven(model, *settled, middle_V))
        rising = displacement_um(model, driven(model, *settled, low_V, middle_V))
        return falling - rising

    assert width_um(PLAYS, 0.0, 2.0) == pytest.approx(width_um(PLAYS, 2.0, 4.0))
    squares = (0.0, *(0.4 for _ in PLAYS.thresholds_V[1:]))
    bent = replace(
        PLAYS,
        squares_um_per_V2=squares,
        cubes_um_per_V3=(0.0,) * len(squares),
        bent_V=(-5.0, 5.0),
    )
    assert width_um(bent, 2.0, 4.0) > 1.2 * width_um(bent, 0.0, 2.0) > 0.0


def test_impossible_bends_are_refused() -> None:
    count = len(PLAYS.thresholds_V)
    some = (0.1,) * count
    with pytest.raises(ValueError, match="1 squares_um_per_V2, must be"):
        replace(PLAYS, squares_um_per_V2=(0.1,), cubes_um_per_V3=some, bent_V=(0.0, 1.0))
    with pytest.raises(ValueError, match="0 squares_um_per_V2, must be"):
        replace(PLAYS, cubes_um_per_V3=some, bent_V=(0.0, 1.0))
    with pytest.raises(ValueError, match="all must be finite"):
        replace(
            PLAYS,
            squares_um_per_V2=some,
            cubes_um_per_V3=(*some[1:], float("nan")),
            bent_V=(0.0, 1.0),
        )
    with pytest.raises(ValueError, match="must be ascending"):
        replace(PLAYS, squares_um_per_V2=some, cubes_um_per_V3=some)


@pytest.mark.parametrize("bends", [False, True])
@EACH
def test_one_large_motion_equals_many_small_steps(model: HysteresisModel, bends: bool) -> None:
    if bends:
        model = bent_plays(model)
    bent = replace(
        model, creep_times_s=(0.1, 10.0), creep_fractions=(0.05, 0.02), curvature_um_per_V2=0.4
    )
    random = np.random.default_rng(7)
    voltage_V = np.cumsum(random.normal(0.0, 0.2, 400))
    voltage_V[50:60] = voltage_V[49]
    state, steps_um = start(bent), list[float]()
    for voltage in voltage_V.tolist():
        state = step(bent, state, voltage, 0.02)
        steps_um.append(displacement_um(bent, state))
    assert simulate(bent, voltage_V, 0.02) == pytest.approx(np.array(steps_um), abs=1e-12)


def test_creep_does_not_depend_on_the_time_steps() -> None:
    once = step(CREEPING, start(CREEPING), 1.0, 4.0)
    cut = driven(CREEPING, *[1.0] * 200, dt_s=0.02)
    static = position(1.0)
    expected = static * (1.0 + 0.05 * (1 - exp(-40.0)) + 0.02 * (1 - exp(-0.4)))
    assert displacement_um(CREEPING, once) == pytest.approx(expected)
    assert displacement_um(CREEPING, cut) == pytest.approx(expected)


PLAIN = ((), (), (0.0, 0.0), 0.0, (), (), (0.0, 0.0))
BOTH_FADE = ((), (), (0.0, 0.5), 0.0, (), (), (0.0, 0.0))
"""Fields between the weights and the rates after a reversal."""


@pytest.mark.parametrize(
    ("model", "text"),
    [
        (((0.0, 0.5), (1.0,)), "1 weights_um_per_V, must be 2"),
        (((0.1,), (1.0,)), "the first must be 0 V"),
        (((), ()), "the first must be 0 V"),
        (((0.0, 0.5, 0.5), (1.0, 1.0, 1.0)), "0.5 V with fading 0.0 per V occurs twice"),
        (((0.0, 0.0), (1.0, 1.0)), "threshold = 0.0 V"),
        (((0.0, nan), (1.0, 1.0)), "threshold = nan V"),
        (((0.0, 0.5), (1.0, -1.5)), "slope up to 0.5 V = -0.5 µm/V"),
        (((0.0, 0.5, 0.2), (9.0, -2.0, -8.0)), "slope up to 0.5 V = -1.0 µm/V"),
        (((0.0, 1.0), (9.0, 1.0), (), (), (1.0,)), "1 fadings_per_V, must be 2"),
        (((0.0, 1.0), (9.0, 1.0), (), (), (0.5, 0.5)), "fading 0.5 per V of the linear part"),
        (((0.0, 1.0), (9.0, 1.0), *BOTH_FADE, (0.0,)), "1 return_fadings_per_V, must be 2"),
        (((0.0, 1.0), (9.0, 1.0), *BOTH_FADE, (0.5, 0.5)), "return fading 0.5 per V of the linear"),
        (((0.0, 1.0), (9.0, 1.0), *BOTH_FADE, (0.0, -0.5)), "return fading = -0.5 per V"),
        (((0.0, 1.0), (9.0, 1.0), *PLAIN, (0.0, 0.5)), "0.5 per V of a play that does not fade"),
        (((0.0, 1.0), (9.0, 1.0), (), (), (0.0, -1.0)), "fading = -1.0 per V"),
        (((0.0, 1.0), (9.0, 1.0), (), (), (0.0, nan)), "fading = nan per V"),
        (((0.0, 1.0), (1.0, 4.0), (), (), (0.0, 0.5)), "slope after a turn = -1.0 µm/V"),
        (((0.0,), (9.0,), (), (), (), nan), "curvature nan"),
        (((0.0,), (1.0,), (1.0,), ()), "0 creep_fractions, must be 1"),
        (((0.0,), (1.0,), (0.0,), (0.1,)), "creep time = 0.0 s"),
        (((0.0,), (1.0,), (1.0,), (nan,)), "creep fraction nan"),
    ],
)
def test_impossible_models_are_refused(model: tuple[Any, ...], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        HysteresisModel(*model)
