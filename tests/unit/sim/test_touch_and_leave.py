"""Impact, adhesion and compression of the part between two arms."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.config import Simulation, read_rig
from pincette.control.record import replace
from pincette.sim.plant import plant
from pincette.sim.plant.arms import arms_of
from pincette.sim.plant.parameters import PartParameters
from pincette.sim.plant.plant import PlantParameters, PlantState
from tests.unit.sim.conftest import DEMO
from tests.unit.sim.elaborate import SHARE, at_rest, bare_arms, energy_nJ, moving

TIME_S = 1e-3
ROUNDING = 1e-9
"""Rounding error of energies of about 100 nJ."""


def _demo_arms(**changes: Any) -> PlantParameters:
    simulation = read_rig(DEMO).simulation
    assert simulation is not None
    return bare_arms(simulation, **changes)


def _thrown(p: PlantParameters, voltage_V: float, x_um: float, speed: float) -> PlantState:
    """Return the driven arm displaced from rest, separate from the part."""
    state = replace(plant.start(), voltage_V=voltage_V, drive_V=voltage_V, target_V=voltage_V)
    return replace(state, x_um=min(x_um, p.contact_um - 0.01), speed_um_per_s=speed)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    st.floats(0.8, 2.4),
    st.floats(0.0, 31.0),
    st.floats(-3e4, 3e4),
    st.sampled_from([0.0, SHARE]),
    st.sampled_from([0.0, 0.2]),
    st.sampled_from([1e-3, 1e-4]),
)
def test_energy_never_grows_at_a_constant_voltage(
    voltage_V: float, x_um: float, speed: float, share: float, pull_off_mN: float, substep_s: float
) -> None:
    part = PartParameters(pull_off_mN=pull_off_mN)
    p = _demo_arms(second_share=share, part=part, substep_s=substep_s)
    state = _thrown(p, voltage_V, x_um, speed)
    energies = [energy_nJ(p, state)]
    energies += [energy_nJ(p, one) for one in moving(p, state, substep_s, 100)]
    assert all(after <= before + ROUNDING * (1.0 + before) for before, after in pairwise(energies))


def test_energy_in_contact_decays(simulation: Simulation) -> None:
    p = bare_arms(simulation, second_share=SHARE)
    ringing = plant.set_voltage(p, at_rest(p, 2.4), 2.2)
    states = list(moving(p, ringing, TIME_S, 100))
    assert all(state.joined for state in states)
    rest_nJ = energy_nJ(p, at_rest(p, 2.2))
    above_nJ = [energy_nJ(p, state) - rest_nJ for state in states]
    assert all(after < before for before, after in pairwise(above_nJ))
    assert above_nJ[-1] < 1e-3 * above_nJ[0]


def test_the_bounces_do_not_depend_on_the_substep(simulation: Simulation) -> None:
    state = plant.set_voltage(bare_arms(simulation), plant.start(), 1.7)
    ends = list[PlantState]()
    for substep_s in (1e-3, 1e-4, 1e-5):
        p = bare_arms(simulation, second_share=SHARE, substep_s=substep_s)
        ends.append(plant.advance(p, state, 0.02))
    assert any(one.joined for one in moving(p, state, TIME_S, 20))
    for end in ends[:-1]:
        assert end.x_um == pytest.approx(ends[-1].x_um, abs=2e-3)


def test_an_impact_conserves_the_momentum(simulation: Simulation) -> None:
    p = bare_arms(simulation, second_share=SHARE)
    first, second = arms_of(p).inverse_masses
    passive = arms_of(p).passive_mass
    start = replace(
        _thrown(p, 2.4, 0.0, 5000.0),
        x_um=p.contact_um - 1e-9,
        second_um=SHARE * p.contact_um,
        second_speed_um_per_s=200.0,
    )
    end = plant.advance(p, start, 2e-9)
    assert end.joined
    assert end.speed_um_per_s == pytest.approx(end.passive_speed_um_per_s)
    # The impulse acts on each modal mass equally, and on the passive arm in the opposite direction.
    given_first = 4800.0 - (end.speed_um_per_s - end.second_speed_um_per_s)
    given_second = 200.0 - end.second_speed_um_per_s
    assert given_first / first == pytest.approx(given_second / second, rel=1e-3)
    assert given_first / first == pytest.approx(end.passive_speed_um_per_s * passive, rel=1e-3)


@pytest.mark.parametrize("pull_off_mN", [0.0, 0.2])
def test_the_part_sticks_until_the_pull_off_force(
    simulation: Simulation, pull_off_mN: float
) -> None:
    p = bare_arms(simulation, part=PartParameters(pull_off_mN=pull_off_mN), output_lag_s=0.01)
    state, least_mN, jump_um = at_rest(p, 1.6), 0.0, 0.0
    touch_V = p.contact_um / p.piezo_um_per_V
    for step in range(300):
        before = state
        voltage_V = touch_V + 0.01 - 1e-4 * step
        state = plant.advance(p, plant.set_voltage(p, state, voltage_V), 0.2)
        least_mN = min(least_mN, plant.contact_force_mN(p, state))
        if before.joined and not state.joined:
            jump_um = before.x_um - state.x_um
    assert not state.joined
    assert least_mN == pytest.approx(-pull_off_mN, abs=0.005)
    # The tip jumps by the deflection that the force had caused, and by a step of the voltage.
    assert jump_um == pytest.approx(pull_off_mN * 0.46, abs=0.003)


def test_the_faces_are_indented_according_to_hertz(simulation: Simulation) -> None:
    part = PartParameters(hertz_um_per_mN23=0.0166)
    p, rigid = bare_arms(simulation, part=part), bare_arms(simulation)
    held, stiff = at_rest(p, 2.2), at_rest(rigid, 2.2)
    force_mN = plant.contact_force_mN(p, held)
    assert held.dent_um == pytest.approx(0.0166 * force_mN ** (2.0 / 3.0))
    assert force_mN < plant.contact_force_mN(rigid, stiff)
    assert held.x_um - held.passive_um - p.contact_um == pytest.approx(held.dent_um)
    assert force_mN == pytest.approx((2.2 * p.piezo_um_per_V - held.x_um) / 0.46)
    slowly = plant.start()
    for voltage_V in (1.0, 1.5, 1.9, 2.2):
        slowly = plant.advance(p, plant.set_voltage(p, slowly, voltage_V), 0.5)
    assert slowly.x_um == pytest.approx(held.x_um, abs=1e-6)


def test_a_massless_passive_arm_gives_the_same_motion_as_the_simple_model(
    simulation: Simulation,
) -> None:
    plain = plant.plant_parameters(simulation)
    spring = replace(plain, part=PartParameters(break_mN=1e6))
    assert spring.elaborate
    assert not plain.elaborate
    ends = [
        plant.advance(p, plant.set_voltage(p, at_rest(p, 1.2), 2.3), 2.0) for p in (plain, spring)
    ]
    assert ends[1].x_um == pytest.approx(ends[0].x_um, abs=1e-5)
    forces_mN = [
        plant.contact_force_mN(p, end) for p, end in zip((plain, spring), ends, strict=True)
    ]
    assert forces_mN[1] == pytest.approx(forces_mN[0], abs=1e-4)
    assert forces_mN[0] > 10.0


def test_the_same_path_gives_the_same_bits(simulation: Simulation) -> None:
    p = bare_arms(simulation, second_share=SHARE, part=PartParameters(0.0166, 0.2))
    runs = [list(moving(p, plant.set_voltage(p, plant.start(), 1.7), TIME_S, 200)) for _ in "ab"]
    assert runs[0] == runs[1]


def _against_a_stiff_damper(p: PlantParameters, voltage_V: float, time_s: float) -> float:
    """Return the tip position by small steps of both arms against a stiff, overdamped stop."""
    dt_s, stop, damper = 1e-7, 4000.0, 0.3
    omega, k = p.natural_frequency_rad_per_s, 1.0 / p.compliance_um_per_mN
    k_p = p.environment_stiffness_mN_per_um
    m, m_p = k / omega**2, k_p / omega**2
    x = v = y = w = 0.0
    for _ in range(round(time_s / dt_s)):
        over_um = x - y - p.contact_um
        force_mN = max(0.0, stop * over_um + damper * (v - w)) if over_um > 0.0 else 0.0
        rest_um = p.piezo_um_per_V * voltage_V
        v += dt_s * (omega**2 * (rest_um - x) - 2.0 * 0.026 * omega * v - force_mN / m)
        w += dt_s * (force_mN / m_p - omega**2 * y - 2.0 * 0.026 * omega * w)
        x, y = x + dt_s * v, y + dt_s * w
    return x


@pytest.mark.parametrize("voltage_V", [1.1, 1.4])
@pytest.mark.parametrize("time_s", [0.002, 0.006, 0.011])
def test_bounces_agree_with_a_direct_numerical_integration(
    simulation: Simulation, time_s: float, voltage_V: float
) -> None:
    p = bare_arms(simulation)
    thrown = plant.set_voltage(p, plant.start(), voltage_V)
    states = list(moving(p, thrown, 1e-4, round(time_s / 1e-4)))
    assert max(state.passive_um for state in states) > 2.0
    expected_um = _against_a_stiff_damper(p, voltage_V, time_s)
    assert abs(states[-1].x_um - voltage_V * p.piezo_um_per_V) > 1.0
    assert states[-1].x_um == pytest.approx(expected_um, abs=0.1)


def _leaving(p: PlantParameters, rest_s: float, pulled_um: float) -> tuple[PlantState, float]:
    """Return the state of arms that were in contact for a time and are pulled apart, and the
    largest pull."""
    state, touch_V = at_rest(p, 1.6), p.contact_um / p.piezo_um_per_V
    state, least_mN = plant.advance(p, state, rest_s), 0.0
    for step in range(1, 301):
        voltage_V = touch_V - step / 300 * pulled_um / p.piezo_um_per_V
        state = plant.advance(p, plant.set_voltage(p, state, voltage_V), 0.02)
        least_mN = min(least_mN, plant.contact_force_mN(p, state))
    return state, -least_mN


def test_adhesion_grows_with_the_logarithm_of_the_contact_time(simulation: Simulation) -> None:
    part = PartParameters(pull_off_mN=0.2, ageing_per_decade=0.3)
    p = bare_arms(simulation, part=part, output_lag_s=0.01)
    pulls_mN = [_leaving(p, rest_s, 1.0)[1] for rest_s in (1.0, 93.0)]
    assert pulls_mN[0] == pytest.approx(0.2 * 1.3, abs=0.015)
    assert pulls_mN[1] == pytest.approx(0.2 * 1.6, abs=0.015)


def test_the_pull_of_a_liquid_bridge_decreases_with_the_gap_until_it_ruptures(
    simulation: Simulation,
) -> None:
    part = PartParameters(bridge_mN=0.4, bridge_um=2.0, rupture_um=8.0)
    p = bare_arms(simulation, part=part, output_lag_s=0.01)
    pulls_mN: list[float] = []
    for pulled_um in (2.0, 6.0, 12.0):
        state, _ = _leaving(p, 0.0, pulled_um)
        assert not state.joined
        pulls_mN.append(-plant.contact_force_mN(p, state))
        gap_um = p.contact_um - state.x_um
        expected_mN = 0.4 * (1.0 - gap_um / (gap_um**2 + 4.0) ** 0.5) if state.bridged else 0.0
        assert pulls_mN[-1] == pytest.approx(expected_mN, abs=1e-3)
    assert pulls_mN[0] > pulls_mN[1] > pulls_mN[2] == 0.0


@pytest.mark.parametrize(("rest_s", "joined"), [(0.5, True), (30.0, False)])
def test_a_bond_breaks_after_some_time_under_a_pull(
    simulation: Simulation, rest_s: float, joined: bool
) -> None:
    """At a pull of 5.4 mN the bond lasts e^0.6 times some seconds."""
    p = bare_arms(simulation, part=PartParameters(bond_mN=6.0, bond_scale_mN=0.4))
    state, _ = _leaving(p, 0.0, 5.0)
    assert state.joined
    assert plant.advance(p, state, rest_s).joined == joined
