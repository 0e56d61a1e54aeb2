"""Two driven arms and the part between them, compared with mechanics."""

import math
from typing import Any

import pytest

from pincette.config import Simulation, read_rig
from pincette.control.record import replace
from pincette.sim.plant import plant
from pincette.sim.plant.hysteresis import BoucWen
from pincette.sim.plant.pair import advance_pair
from pincette.sim.plant.pair_modes import Contact, Ground
from pincette.sim.plant.pair_state import (
    APART,
    PairParameters,
    PairState,
    pair_forces_mN,
    remove_pair_part,
    set_pair_voltages,
    start_pair,
)
from pincette.sim.plant.parameters import PartParameters, PlantParameters
from pincette.sim.plant.plant import plant_parameters
from tests.unit.sim.conftest import DEMO

GAP_UM, FACE, SOFTER = 60.0, 80.0, 0.5
"""g, K_f, and s_p of the second arm."""


def _simulation() -> Simulation:
    simulation = read_rig(DEMO).simulation
    assert simulation is not None
    return simulation


def _bare(**changes: Any) -> PlantParameters:
    """Return an arm without hysteresis, creep, lag and steps."""
    arm = replace(
        plant_parameters(_simulation()),
        hysteresis=BoucWen(0.0, 0.0, 0.0),
        creep_per_decade=0.0,
        output_lag_s=0.0,
        output_step_V=1e-9,
        environment_stiffness_mN_per_um=0.0,
    )
    return replace(arm, **changes)


def _pair(**changes: Any) -> PairParameters:
    given = PairParameters(_bare(), _bare(compliance_um_per_mN=SOFTER), GAP_UM, 30.0)
    return replace(given, **changes)


def _pressed(p: PairParameters, state: PairState, free_um: tuple[float, float]) -> PairState:
    """Return the arms at rest where each alone would be at ``free_um``, reached slowly."""
    goals = [u / arm.piezo_um_per_V for u, arm in zip(free_um, p.arms, strict=True)]
    begin = state.first.drive_V, state.second.drive_V
    for step in range(1, 401):
        way = 0.5 - 0.5 * math.cos(math.pi * step / 400)
        V_1, V_2 = (a + (b - a) * way for a, b in zip(begin, goals, strict=True))
        state = advance_pair(p, set_pair_voltages(p, state, (V_1, V_2)), 5e-4)
    return advance_pair(p, state, 0.15)


def test_arms_that_do_not_touch_move_like_single_arms() -> None:
    arm = replace(plant_parameters(_simulation()), environment_stiffness_mN_per_um=0.0)
    p = PairParameters(arm, replace(arm, piezo_um_per_V=20.0), GAP_UM, 30.0)
    pair, alone = start_pair(p), plant.start()
    for voltage_V in (0.3, 1.0, 0.2):
        pair = advance_pair(p, set_pair_voltages(p, pair, (voltage_V, 0.1)), 0.0233)
        alone = plant.advance(arm, plant.set_voltage(arm, alone, voltage_V), 0.0233)
        assert pair.first.x_um == pytest.approx(alone.x_um, abs=1e-9)
        assert pair.first.speed_um_per_s == pytest.approx(alone.speed_um_per_s, abs=1e-6)
        assert pair.first.creep_um == alone.creep_um


def test_a_part_between_both_is_squeezed_by_the_sum_and_placed_by_the_difference() -> None:
    p = _pair(ground_slip_mN=0.0)
    state = _pressed(p, start_pair(p), (38.0, 34.0))
    s_1, s_2 = p.first.compliance_um_per_mN, SOFTER
    force_mN = (38.0 + 34.0 - GAP_UM) / (s_1 + s_2 + 2.0 / FACE)
    assert pair_forces_mN(p, state) == pytest.approx((force_mN, force_mN), abs=1e-4)
    x_1, x_2 = state.tips_um
    assert x_1 == pytest.approx(38.0 - s_1 * force_mN, abs=1e-4)
    assert state.part_um == pytest.approx(0.5 * (x_1 - x_2 + GAP_UM), abs=1e-6)


@pytest.mark.parametrize("side", [0, 1])
def test_the_arm_that_touches_first_pushes_the_part_against_friction(side: int) -> None:
    p = _pair(ground_slip_mN=1.5, ground_mN_per_um=5.0)
    near, far = (30.8, 0.0), (40.0, 0.0)
    turned = (near, far) if side == 0 else ((0.0, near[0]), (0.0, far[0]))
    state = _pressed(p, start_pair(p), turned[0])
    stiffness = 1.0 / (1.0 / 5.0 + 1.0 / FACE + p.arms[side].compliance_um_per_mN)
    # Held: springs in series. Pushed on: friction, minus the overshoot of the last slip.
    assert pair_forces_mN(p, state)[side] == pytest.approx(0.8 * stiffness, rel=1e-3)
    assert pair_forces_mN(p, state)[1 - side] == 0.0
    state = _pressed(p, state, turned[1])
    force_mN = pair_forces_mN(p, state)[side]
    assert 0.8 * 1.5 < force_mN <= 1.5
    way_um = state.part_um - 30.0 if side == 0 else 30.0 - state.part_um
    pressed_um = force_mN * (p.arms[side].compliance_um_per_mN + 1.0 / FACE)
    assert way_um == pytest.approx(10.0 - pressed_um, abs=1e-6)


def test_a_loose_part_is_pushed_without_a_force() -> None:
    p = _pair(ground_slip_mN=0.0)
    state = _pressed(p, start_pair(p), (35.0, 0.0))
    assert state.part_um == pytest.approx(35.0, abs=0.02)
    assert abs(pair_forces_mN(p, state)[0]) < 1e-3


@pytest.mark.parametrize(("pull_off_mN", "keeps"), [((0.3, 0.1), 0), ((0.1, 0.3), 1)])
def test_a_lifted_part_stays_on_the_face_with_more_adhesion(
    pull_off_mN: tuple[float, float], keeps: int
) -> None:
    part = PartParameters(lift_after_s=0.1)
    p = _pair(pull_off_mN=pull_off_mN, part=part)
    state = _pressed(p, start_pair(p), (36.0, 36.0))
    assert state.contact == Contact(first=True, second=True, ground=Ground.AWAY)
    state = _pressed(p, state, (20.0, 20.0))
    assert (state.contact.first, state.contact.second) == (keeps == 0, keeps == 1)
    at_um = state.tips_um[0] if keeps == 0 else GAP_UM - state.tips_um[1]
    assert state.part_um == pytest.approx(at_um, abs=1e-9)


def test_a_lifted_part_with_a_weight_falls_when_the_arms_open() -> None:
    p = _pair(part=PartParameters(hold_mN=0.05, lift_after_s=0.1))
    state = _pressed(p, start_pair(p), (36.0, 36.0))
    assert state.part == "there"
    state = _pressed(p, state, (20.0, 20.0))
    assert state.part == "lost"
    assert [event.what for event in state.events] == ["lost"]


def test_a_carried_part_that_lands_keeps_its_position_and_can_be_gripped_again() -> None:
    part = PartParameters(hold_mN=0.05, lift_after_s=0.1)
    p = _pair(part=part, lands=True, ground_slip_mN=1.5)
    state = _pressed(p, start_pair(p), (36.0, 36.0))
    state = _pressed(p, state, (40.0, 32.0))
    carried_um = state.part_um
    assert carried_um > p.part_um + 3.0
    state = _pressed(p, state, (24.0, 16.0))
    assert [event.what for event in state.events] == ["landed"]
    assert (state.part, state.contact) == ("there", APART)
    assert state.part_um == state.anchor_um == pytest.approx(carried_um, abs=0.5)
    state = _pressed(p, state, (40.0, 32.0))
    assert min(pair_forces_mN(p, state)) > 1.0


@pytest.mark.parametrize("aside_s", [0.0, 0.1])
@pytest.mark.parametrize("shares", [(0.0,), (0.9, 0.3, 0.0)])
@pytest.mark.parametrize("carried", [True, False])
def test_a_part_at_rest_after_its_release_is_not_hit_again_by_the_arms(
    carried: bool, shares: tuple[float, ...], aside_s: float
) -> None:
    """The voltages fall in one step, as by a watchdog, or in one step per tick, one arm before the
    other."""
    part = PartParameters(hold_mN=0.05, lift_after_s=0.1 if carried else math.inf)
    p = _pair(part=part, lands=True, ground_slip_mN=1.5)
    state = _pressed(p, start_pair(p), (35.0, 33.0))
    held_V = state.first.drive_V, state.second.drive_V
    held_mN = max(pair_forces_mN(p, state))
    for share in shares:
        state = set_pair_voltages(p, state, (share * held_V[0], held_V[1]))
        for _ in range(round((aside_s + 0.02) / 2e-4)):
            state = advance_pair(p, state, 2e-4)
            assert max(pair_forces_mN(p, state)) <= held_mN
    for share in shares:
        state = set_pair_voltages(p, state, (0.0, share * held_V[1]))
        for _ in range(100):
            state = advance_pair(p, state, 2e-4)
            assert max(pair_forces_mN(p, state)) <= held_mN
    assert state.part == "there"
    assert pair_forces_mN(p, state) == (0.0, 0.0)


def test_a_part_breaks_above_its_force() -> None:
    p = _pair(part=PartParameters(break_mN=5.0))
    state = _pressed(p, start_pair(p), (36.0, 36.0))
    assert state.part == "broken"
    assert pair_forces_mN(p, state) == (0.0, 0.0)


def test_a_held_pair_swings_with_both_masses_on_both_springs() -> None:
    p = _pair(part=PartParameters(lift_after_s=0.1))
    state = _pressed(p, start_pair(p), (36.0, 36.0))
    pushed = replace(state.first, speed_um_per_s=200.0)
    back = replace(state.second, speed_um_per_s=-200.0)
    state = replace(state, first=pushed, second=back)
    places: list[float] = []
    for _ in range(400):
        state = advance_pair(p, state, 5e-5)
        places.append(0.5 * (state.tips_um[0] - state.tips_um[1]))
    middle = sum(places) / len(places)
    ups = [n for n in range(1, 400) if places[n - 1] < middle <= places[n]]
    period_s = 5e-5 * (ups[-1] - ups[0]) / (len(ups) - 1)
    s_1, s_2 = p.first.compliance_um_per_mN, SOFTER
    omega = p.first.natural_frequency_rad_per_s
    expected = math.sqrt((1 / s_1 + 1 / s_2) / (1 / s_1 / omega**2 + 1 / s_2 / omega**2))
    assert 2.0 * math.pi / period_s == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("step_s", [5e-4, 2e-4, 3.7e-5])
def test_arms_that_lose_a_loose_part_for_an_instant_close_on_the_part_again(
    step_s: float,
) -> None:
    """Only the faces hold the part: the force of a single face is exactly 0 and reveals nothing."""
    p = _pair(ground_slip_mN=1.5)
    state = _pressed(p, start_pair(p), (30.5, 30.5))
    held_mN = (2.0 * 30.5 - GAP_UM) / (p.first.compliance_um_per_mN + SOFTER + 2.0 / FACE)
    apart = [replace(arm, speed_um_per_s=-500.0) for arm in (state.first, state.second)]
    contact = Contact(first=True, second=True, ground=Ground.AWAY)
    state = replace(state, first=apart[0], second=apart[1], contact=contact)
    struck_mN, parted = 0.0, False
    for _ in range(round(0.12 / step_s)):
        state = advance_pair(p, state, step_s)
        struck_mN = max(struck_mN, *pair_forces_mN(p, state))
        parted |= max(pair_forces_mN(p, state)) == 0.0
        assert sum(state.tips_um) < GAP_UM + 0.12
    assert parted
    assert struck_mN < 4.5
    assert pair_forces_mN(p, state) == pytest.approx((held_mN, held_mN), abs=0.05)


def test_contact_and_separation_add_no_energy() -> None:
    p = _pair(ground_slip_mN=0.5)
    state = replace(start_pair(p), first=replace(plant.start(), speed_um_per_s=1.2e5))
    highest, before = 0.0, math.inf
    for _ in range(60):
        state = advance_pair(p, state, 2.577e-3)
        energy = _energy_nJ(p, state)
        assert energy < before * (1.0 + 2e-3) + 1e-9
        before, highest = energy, max(highest, energy)
    assert before < 0.2 * highest


def _energy_nJ(p: PairParameters, state: PairState) -> float:
    """Return kinetic and elastic energy about rest at 0 V, faces and ground included."""
    total = 0.5 * p.ground_mN_per_um * (state.part_um - state.anchor_um) ** 2
    for arm, tip, force in zip(
        p.arms, (state.first, state.second), pair_forces_mN(p, state), strict=True
    ):
        k = 1.0 / arm.compliance_um_per_mN
        speed = tip.speed_um_per_s / arm.natural_frequency_rad_per_s
        total += 0.5 * k * (tip.x_um**2 + speed**2)
        total += 0.5 * force * force / p.face_mN_per_um
    return total


def test_a_removed_part_leaves_the_arms_free() -> None:
    p = _pair()
    state = remove_pair_part(_pressed(p, start_pair(p), (36.0, 36.0)))
    state = advance_pair(p, state, 1.0)
    assert state.tips_um == pytest.approx((36.0, 36.0), abs=1e-6)


def test_the_same_motion_gives_the_same_bits() -> None:
    p = _pair(ground_slip_mN=0.7)
    runs = [_pressed(p, start_pair(p), (37.0, 33.0)) for _ in range(2)]
    assert runs[0] == runs[1]


def test_an_arm_with_two_modes_is_refused() -> None:
    with pytest.raises(ValueError, match="one mode"):
        _pair(first=_bare(second_share=0.02))
