"""The simulated arm with relays has the proven properties of Preisach's model, and the requested
loop."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.config import Simulation
from pincette.config.simulation import Relays as RelaysTable
from pincette.sim.plant import plant
from pincette.sim.plant.relays import Relays, Turns, everett, follow_relays, loop_of_relays

SHAPE = Relays(gain_um_per_V=10.0, full_drive_V=2.0, coercive_V=0.6, spread_V=0.8, centre_V=0.15)
PATHS = st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=12)


def followed(path_V: Sequence[float], shape: Relays = SHAPE) -> tuple[list[float], Turns]:
    """Return h after each voltage, from the unpoled state at zero."""
    levels_um = [0.0] * len(path_V)
    return levels_um, follow_relays(shape, 0.0, (), path_V, levels_um)


def test_the_everett_function_equals_the_number_of_relays_between_two_voltages() -> None:
    cells = 400
    for upper_V, lower_V in ((1.5, -1.2), (0.3, 0.1), (3.0, -3.0), (-1.0, -2.0)):
        size_V = (upper_V - lower_V) / cells
        edges = lower_V + size_V * (np.arange(cells) + 0.5)
        up = 1.0 / np.cosh((edges - SHAPE.coercive_V) / SHAPE.spread_V) ** 2
        down = 1.0 / np.cosh((edges + SHAPE.coercive_V) / SHAPE.spread_V) ** 2
        density = np.tril(np.outer(up, down))
        density[np.diag_indices(cells)] *= 0.5
        counted = float(np.sum(density)) * size_V**2
        assert everett(SHAPE, upper_V, lower_V) == pytest.approx(counted, rel=1e-4)
    assert everett(SHAPE, 0.7, 0.7) == 0.0


def test_the_model_moves_like_a_lattice_of_single_relays() -> None:
    """Each relay is computed separately, starting with those up where α + β < 0."""
    shape = Relays(gain_um_per_V=10.0, full_drive_V=2.0, coercive_V=0.6, spread_V=0.8)
    cell_V = 0.02
    centres_V = cell_V * (np.arange(400) - 199.5)
    alpha, beta = np.meshgrid(centres_V, centres_V)
    weight = cell_V**2 / np.cosh((alpha - 0.6) / 0.8) ** 2 / np.cosh((beta + 0.6) / 0.8) ** 2
    weight *= np.where(alpha > beta, 1.0, 0.5) * (alpha > beta - 0.5 * cell_V)
    states = -np.sign(np.round((alpha + beta) / cell_V))
    path_V = cell_V * np.random.default_rng(4).integers(-100, 101, 40)
    ways = list[float]()
    for voltage_V in path_V:
        states[alpha < voltage_V] = 1.0
        states[beta > voltage_V] = -1.0
        ways.append(float(np.sum(weight * states)))
    expected_um = 10.0 * (path_V - np.array(ways) * 2.0 / everett(shape, 2.0, -2.0))
    assert np.ptp(expected_um) > 5.0
    levels_um, _ = followed(path_V.tolist(), shape)
    assert levels_um == pytest.approx(expected_um.tolist(), abs=0.01)


@given(PATHS, PATHS)
def test_a_larger_swing_erases_smaller_ones(path_V: list[float], inner_V: list[float]) -> None:
    with_loops, kept = followed([*path_V, 4.0, -3.1, *inner_V, 3.2, -1.0])
    without, plain = followed([*path_V, 4.0, -3.1, 3.2, -1.0])
    assert with_loops[-2:] == without[-2:]
    assert kept == plain


@given(PATHS, PATHS)
def test_loops_between_the_same_voltages_are_congruent(
    path_V: list[float], other_V: list[float]
) -> None:
    def loop_um(before_V: list[float]) -> list[float]:
        levels_um, _ = followed([*before_V, 0.9, -0.4, 0.1, 0.5, 0.9, 0.2, -0.4])
        return [level - levels_um[-1] for level in levels_um[-5:]]

    assert loop_um(path_V) == pytest.approx(loop_um(other_V), abs=1e-9)


@given(PATHS, st.integers(2, 7))
def test_the_result_depends_on_the_path_and_not_on_its_sampling(
    path_V: list[float], pieces: int
) -> None:
    cut_V, before_V = list[float](), 0.0
    for voltage_V in path_V:
        steps = np.linspace(before_V, voltage_V, pieces + 1)[1:-1]
        cut_V += [*steps.tolist(), voltage_V]
        before_V = voltage_V
    assert followed(cut_V)[0][-1] == followed(path_V)[0][-1]
    assert followed(cut_V)[1] == followed(path_V)[1]


def test_the_response_saturates() -> None:
    levels_um, turns = followed([50.0, 60.0, -60.0, 60.0])
    assert levels_um[1] - levels_um[0] == pytest.approx(SHAPE.gain_um_per_V * 10.0)
    assert levels_um[3] == pytest.approx(levels_um[1])
    assert len(turns) <= 2


def test_only_turning_points_that_still_have_an_effect_are_stored() -> None:
    """A decaying swing is stored turn by turn; the first one beyond them all erases them."""
    decaying = [2.0 * (-0.8) ** index for index in range(30)]
    _, turns = followed(decaying)
    assert [v + SHAPE.centre_V for v, _ in turns] == pytest.approx(decaying[:-1])
    assert followed([*decaying, 2.5])[1] == ()


@pytest.mark.parametrize("share", [0.05, 0.2, 0.4])
@pytest.mark.parametrize("centre_V", [-0.3, 0.0, 0.5])
def test_the_loop_has_the_requested_width(share: float, centre_V: float) -> None:
    full_V, gain = 1.5, 19.0
    shape = loop_of_relays(gain, share, full_V, 0.45, 0.9, centre_V)
    rising_V = np.linspace(-full_V, full_V, 2001)
    levels_um, _ = followed([full_V, *rising_V, *rising_V[::-1]], shape)
    up_um = gain * rising_V - np.array(levels_um[1:2002])
    down_um = gain * rising_V - np.array(levels_um[2002:])[::-1]
    assert up_um[-1] - up_um[0] == pytest.approx(2.0 * gain * full_V)
    assert np.max(down_um - up_um) == pytest.approx(share * 2.0 * gain * full_V, rel=1e-5)
    assert np.all(np.diff(up_um) > 0.0)


def test_play_operators_cannot_have_these_loops() -> None:
    """Loops of plays with the same width are equal about any voltage; loops of relays are not."""
    widths_um = list[float]()
    for middle_V in (0.0, 1.0, 2.0):
        levels_um, _ = followed(
            [-4.0, middle_V + 0.5, middle_V - 0.5, middle_V, middle_V + 0.5, middle_V]
        )
        widths_um.append(levels_um[3] - levels_um[5])
    assert widths_um[0] > 1.2 * widths_um[1] > 1.44 * widths_um[2] > 0.0


def test_the_arm_starts_unpoled_and_remembers(simulation: Simulation) -> None:
    table = RelaysTable(loop_share=0.3, full_drive_V=2.0, centre_V=0.2)
    p = plant.plant_parameters(
        simulation.model_copy(
            update={"hysteresis": None, "relays": table, "creep_per_decade": 0.0, "bead": False}
        )
    )
    state = plant.start()
    state = plant.advance(p, state, 1.0)
    assert state.x_um == 0.0
    ends = list[float]()
    for voltage_V in (2.0, 0.5, 1.0, 0.5, 1.9, 0.5, 2.0):
        state = plant.advance(p, plant.set_voltage(p, state, voltage_V), 2.0)
        ends.append(state.x_um)
    assert ends[3] == pytest.approx(ends[1], abs=1e-9)
    assert ends[5] == pytest.approx(ends[1], abs=1e-9)
    assert ends[6] == pytest.approx(ends[0], abs=1e-9)
    assert abs(ends[2] - 1.0 * ends[0] / 2.0) > 0.5
    again = plant.advance(p, plant.set_voltage(p, state, 2.0), 2.0)
    assert (again.x_um, again.turns) == (pytest.approx(state.x_um), state.turns)


def test_a_loop_too_wide_for_relays_is_refused() -> None:
    with pytest.raises(ValueError, match=r"loop_share = 0\.9: at most 0\.\d+ with thresholds at"):
        loop_of_relays(19.0, 0.9, 1.0, 0.3, 0.6)
    with pytest.raises(ValueError, match=r"coercive voltage 1\.0 V: must be above 0 and up to 5"):
        Relays(1.0, 2.0, 1.0, 0.1)
    assert math.isfinite(everett(Relays(1.0, 2.0, 1.0, 0.2), 8.0, -8.0))


def test_a_rig_file_names_exactly_one_class(simulation: Simulation) -> None:
    plain = simulation.model_dump()
    relays = {"loop_share": 0.2, "full_drive_V": 1.0}
    with pytest.raises(ValueError, match=r"both of \[simulation.hysteresis\] and \[simulation.rel"):
        Simulation.model_validate({**plain, "relays": relays})
    with pytest.raises(ValueError, match=r"neither of \[simulation.hysteresis\]"):
        Simulation.model_validate({**plain, "hysteresis": None})
    other = Simulation.model_validate({**plain, "hysteresis": None, "relays": relays})
    with pytest.raises(ValueError, match=r"give \[simulation.hysteresis\] instead of"):
        _ = other.bouc_wen
