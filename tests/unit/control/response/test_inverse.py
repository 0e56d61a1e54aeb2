"""The inverse of the free response: accurate, in few steps."""

from collections.abc import Callable
from statistics import median

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    displacements_after,
    start,
    step,
)
from pincette.control.response.inverse import MOST, TOLERANCE_UM, voltage_for
from tests.support.rigs import demo_rig

PERIOD_S, UM_PER_V = 0.02, 19.0
TAUGHT = demo_rig().model.free_response
assert TAUGHT is not None
TAUGHT_MODEL = TAUGHT.hysteresis()
SOME = settings(deadline=None, max_examples=50, derandomize=True)


@st.composite
def models(draw: st.DrawFn) -> HysteresisModel:
    """Return plays with and without decay, with creep, a little curvature, and with or without
    bends."""
    plays = draw(st.integers(0, 5))
    fadings = [draw(st.floats(0.0, 0.9)) / (0.2 * (place + 1)) for place in range(plays)]
    bent = draw(st.booleans())
    bends = st.lists(st.floats(-0.02, 0.02), min_size=plays + 1, max_size=plays + 1)
    return HysteresisModel(
        thresholds_V=(0.0, *(0.2 * (place + 1) for place in range(plays))),
        weights_um_per_V=(
            17.0,
            *draw(st.lists(st.floats(0.1, 3.0), min_size=plays, max_size=plays)),
        ),
        creep_times_s=(0.1, 5.0),
        creep_fractions=(draw(st.floats(0.0, 0.05)), draw(st.floats(0.0, 0.05))),
        fadings_per_V=(0.0, *fadings),
        curvature_um_per_V2=draw(st.floats(-0.3, 0.3)),
        squares_um_per_V2=tuple(draw(bends)) if bent else (),
        cubes_um_per_V3=tuple(draw(bends)) if bent else (),
        bent_V=(-0.5, 2.5) if bent else (0.0, 0.0),
    )


def led(model: HysteresisModel, voltages_V: list[float]) -> HysteresisState:
    memory = start(model)
    for voltage_V in voltages_V:
        memory = step(model, memory, voltage_V, PERIOD_S)
    return memory


histories = st.lists(st.floats(-1.0, 4.0), max_size=12)
ways_um = st.floats(-30.0, 30.0)


def inverted(model: HysteresisModel, memory: HysteresisState, wanted_um: float) -> float:
    return voltage_for(model, memory, wanted_um, um_per_V=UM_PER_V, period_s=PERIOD_S)


@SOME
@given(models(), histories, ways_um)
def test_the_voltage_applied_for_a_period_gives_the_displacement(
    model: HysteresisModel, voltages_V: list[float], way_um: float
) -> None:
    memory = led(model, voltages_V)
    wanted_um = displacement_um(model, memory) + way_um
    voltage_V = inverted(model, memory, wanted_um)
    reached_um = displacement_um(model, step(model, memory, voltage_V, PERIOD_S))
    assert abs(reached_um - wanted_um) <= TOLERANCE_UM


@SOME
@given(models(), histories, st.floats(-2.0, 5.0))
def test_the_displacement_after_a_period_equals_that_of_a_model_step(
    model: HysteresisModel, voltages_V: list[float], voltage_V: float
) -> None:
    memory = led(model, voltages_V)
    stepped = displacement_um(model, step(model, memory, voltage_V, PERIOD_S))
    assert displacements_after(model, memory, PERIOD_S)(voltage_V) == stepped


@SOME
@given(histories, ways_um, st.floats(0.01, 5.0))
def test_the_voltage_rises_with_the_displacement(
    voltages_V: list[float], way_um: float, more_um: float
) -> None:
    memory = led(TAUGHT_MODEL, voltages_V)
    at_um = displacement_um(TAUGHT_MODEL, memory) + way_um
    lower_V, higher_V = (inverted(TAUGHT_MODEL, memory, at_um + add) for add in (0.0, more_um))
    assert lower_V < higher_V


def evaluations(memory: HysteresisState, wanted_um: float) -> int:
    """Return the number of voltages that are tried in addition to the present one."""
    tried_V: list[float] = []

    def counted(
        model: HysteresisModel, state: HysteresisState, dt_s: float
    ) -> Callable[[float], float]:
        displacement_at = displacements_after(model, state, dt_s)

        def displacement(voltage_V: float) -> float:
            tried_V.append(voltage_V)
            return displacement_at(voltage_V)

        return displacement

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("pincette.control.response.inverse.displacements_after", counted)
        inverted(TAUGHT_MODEL, memory, wanted_um)
    return len(tried_V) - 1


def test_the_inversion_needs_few_evaluations() -> None:
    """A sinusoid of 2 Hz and 17 µm, whose steps between samples reach 2 µm."""
    memory, counts = start(TAUGHT_MODEL), list[int]()
    for tick in range(400):
        wanted_um = 40.0 + 17.0 * float(np.sin(2.0 * np.pi * 2.0 * tick * PERIOD_S))
        counts.append(evaluations(memory, wanted_um))
        memory = step(TAUGHT_MODEL, memory, inverted(TAUGHT_MODEL, memory, wanted_um), PERIOD_S)
    assert median(counts) <= 3
    assert max(counts) <= 7


@pytest.mark.parametrize("wanted_um", [1e12, -1e12, 1e308])
def test_an_unreachable_value_ends_the_search(wanted_um: float) -> None:
    """The controller refuses such a voltage as absurd."""
    memory = led(TAUGHT_MODEL, [1.0])
    assert evaluations(memory, wanted_um) <= MOST
    assert not abs(inverted(TAUGHT_MODEL, memory, wanted_um)) < 1e6
