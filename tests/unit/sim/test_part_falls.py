"""A part that falls, breaks, or is put at a new position."""

from dataclasses import replace

import pytest

from pincette.config import Simulation
from pincette.sim.plant import plant
from pincette.sim.plant.parameters import PartParameters
from pincette.sim.plant.plant import PlantParameters, PlantState
from tests.unit.sim.elaborate import SHARE, at_rest, bare_arms

FALLS = PartParameters(hold_mN=0.06, lift_after_s=0.5)


def _through(p: PlantParameters, *voltages_V: float, dwell_s: float = 1.0) -> PlantState:
    state = plant.start()
    for voltage_V in voltages_V:
        state = plant.advance(p, plant.set_voltage(p, state, voltage_V), dwell_s)
    return state


def test_a_lifted_part_falls_when_it_is_released(simulation: Simulation) -> None:
    p = bare_arms(simulation, second_share=SHARE, part=FALLS, output_lag_s=0.003)
    held = _through(p, 2.0)
    assert held.part == "there"
    assert held.events == ()
    assert held.held_s == pytest.approx(1.0, abs=0.01)
    lost = plant.advance(p, plant.set_voltage(p, held, 1.0), 1.0)
    assert lost.part == "lost"
    (event,) = lost.events
    assert event.what == "lost"
    assert 1.0 < event.time_s < 1.02
    assert "below the 0.0600 mN" in event.text
    again = plant.advance(p, plant.set_voltage(p, lost, 2.4), 1.0)
    assert plant.contact_force_mN(p, again) == 0.0
    assert again.x_um == pytest.approx(2.4 * p.piezo_um_per_V, abs=1e-6)
    assert again.events == lost.events


def test_a_part_that_was_held_too_briefly_stays_in_place(simulation: Simulation) -> None:
    p = bare_arms(simulation, part=FALLS, output_lag_s=0.003)
    state = _through(p, 2.0, 1.0, 2.0, 1.0, dwell_s=0.3)
    assert state.part == "there"
    assert state.held_s == 0.0
    assert _through(p, 2.0, 1.0, dwell_s=0.6).part == "lost"


def test_a_part_falls_in_a_long_rest_too(simulation: Simulation) -> None:
    # Reverse creep removes the rest of the force, minutes after the voltage was set.
    p = replace(
        bare_arms(simulation, part=FALLS, output_lag_s=0.003),
        creep_per_decade=0.02,
    )
    held = plant.advance(p, plant.set_voltage(p, plant.start(), 2.4), 300.0)
    touch_V = (p.contact_um - sum(held.creep_um) + 1.5) / p.piezo_um_per_V
    eased = plant.advance(p, plant.set_voltage(p, held, touch_V), 0.6)
    assert eased.part == "there"
    later = plant.advance(p, eased, 3600.0)
    assert later.part == "lost"
    assert later.x_um < p.contact_um
    assert later.passive_um == 0.0


@pytest.mark.parametrize("share", [0.0, SHARE])
def test_a_part_breaks_above_its_limit(simulation: Simulation, share: float) -> None:
    p = bare_arms(simulation, second_share=share, part=PartParameters(break_mN=15.0))
    p = replace(p, output_lag_s=0.003)
    assert _through(p, 1.6).part == "there"
    broken = _through(p, 1.6, 2.4)
    assert broken.part == "broken"
    assert [event.what for event in broken.events] == ["broken"]
    assert "above 15.000 mN" in broken.events[0].text
    assert broken.events[0].time_s == pytest.approx(1.002, abs=0.002)


def test_a_part_placed_behind_the_tip_is_held_at_once(simulation: Simulation) -> None:
    p = bare_arms(simulation)
    gone = plant.take_part(p, plant.start(), "removed")
    free = plant.advance(p, plant.set_voltage(p, gone, 1.6), 2.0)
    assert free.x_um > p.contact_um
    placed = plant.place_part(p, free)
    assert placed.joined
    assert placed.x_um == free.x_um
    force_mN = plant.contact_force_mN(p, plant.advance(p, placed, 2.0))
    assert force_mN == pytest.approx(plant.contact_force_mN(p, at_rest(p, 1.6)), abs=1e-6)
    assert force_mN > 5.0
