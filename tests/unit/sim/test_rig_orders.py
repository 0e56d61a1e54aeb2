"""Parts, weights and ageing of a simulated rig, each with its event."""

import math

import pytest

from pincette.config import Simulation
from pincette.config.simulation import Bead
from pincette.sim.rig.rig import SimulatedRig

PERIOD_S = 0.02


def _rig(simulation: Simulation, **changes: object) -> SimulatedRig:
    quiet = {"sensor_noise_um": 0.0, "sensor_step_um": 1e-6, **changes}
    return SimulatedRig(simulation.model_copy(update=quiet), PERIOD_S, True, lambda: 0.0)


def _held(rig: SimulatedRig, voltage_V: float, ticks: int = 60) -> float:
    """Return the position after a while at a voltage."""
    for _ in range(ticks):
        rig.put_out(voltage_V)
    return rig.measure_um()


def test_a_part_can_be_placed_and_removed(simulation: Simulation) -> None:
    rig = _rig(simulation, bead=False)
    _held(rig, 2.2)
    assert not rig.snapshot().part_present
    assert rig.snapshot().force_mN == 0.0
    rig.place_part(29.0)
    _held(rig, 2.2)
    pressed = rig.snapshot()
    assert pressed.part_present
    assert pressed.force_mN == pytest.approx(2.11 * (pressed.x_um - 29.0))
    assert pressed.force_mN > 10.0
    rig.remove_part()
    _held(rig, 2.2)
    assert rig.snapshot().force_mN == 0.0
    rig.place_part()
    rig.lose_part()
    messages = rig.events()
    assert [event.what for event in messages] == ["placed", "removed", "placed", "lost"]
    assert messages[0].time_s == pytest.approx(60 * PERIOD_S)
    assert messages[1].time_s == pytest.approx(120 * PERIOD_S)
    assert "29.000 µm" in messages[0].text
    assert rig.snapshot().events == tuple(messages)


def test_a_weight_pushes_the_arm_back(simulation: Simulation) -> None:
    rig = _rig(simulation, creep_per_decade=0.0)
    free_um = _held(rig, 0.5)
    rig.hang(5.0)
    assert _held(rig, 0.5) == pytest.approx(free_um - 0.46 * 5.0, abs=1e-5)
    rig.hang(0.0)
    assert _held(rig, 0.5) == pytest.approx(free_um, abs=1e-5)
    assert [event.what for event in rig.events()] == ["hung", "hung"]


@pytest.mark.parametrize("omega", [None, 2437.8])
def test_the_stiffness_of_the_passive_arm_can_be_changed(
    simulation: Simulation, omega: float | None
) -> None:
    rig = _rig(simulation, creep_per_decade=0.0, passive_natural_frequency_rad_per_s=omega)
    _held(rig, 2.2)
    before = rig.snapshot()
    rig.scale_stiffness(1.5)
    _held(rig, 2.2)
    after = rig.snapshot()
    assert before.force_mN == pytest.approx(2.11 * (before.x_um - 31.2), abs=1e-6)
    assert after.force_mN == pytest.approx(1.5 * 2.11 * (after.x_um - 31.2), abs=1e-6)
    assert after.force_mN > 1.1 * before.force_mN


def test_the_hysteresis_can_be_scaled(simulation: Simulation) -> None:
    ends = list[float]()
    for factor in (None, 1.0, 2.0):
        rig = _rig(simulation, creep_per_decade=0.0, bead=False)
        if factor is not None:
            rig.scale_hysteresis(factor)
        ends.append(_held(rig, 1.0))
    straight_um = simulation.piezo_um_per_V * round(1.0 / 20 * 2**14) * 20 / 2**14
    assert ends[1] == ends[0]
    assert straight_um - ends[2] == pytest.approx(2.0 * (straight_um - ends[0]), abs=1e-5)


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
def test_impossible_orders_are_refused(simulation: Simulation, factor: float) -> None:
    rig = _rig(simulation)
    for order in (rig.scale_stiffness, rig.scale_hysteresis):
        with pytest.raises(ValueError, match=r"factor = .*: must be above 0 and finite"):
            order(factor)
    with pytest.raises(ValueError, match=r"weight_mN = nan mN"):
        rig.hang(math.nan)
    assert rig.events() == []


def test_a_part_that_falls_is_reported(simulation: Simulation) -> None:
    part = Bead(friction=0.3, lift_after_s=0.5)
    rig = _rig(simulation, part=part, passive_natural_frequency_rad_per_s=2437.8)
    _held(rig, 2.2)
    assert rig.snapshot().force_mN > 10.0
    _held(rig, 0.5)
    (event,) = rig.events()
    assert event.what == "lost"
    assert 60 * PERIOD_S < event.time_s < 62 * PERIOD_S
    assert not rig.snapshot().part_present
    rig.place_part()
    assert rig.snapshot().part_present


def test_in_real_time_commands_act_after_catching_up(simulation: Simulation) -> None:
    now_s = [50.0]
    rig = SimulatedRig(simulation, PERIOD_S, False, lambda: now_s[0])
    rig.put_out(2.2)
    now_s[0] += 2.0
    rig.lose_part()
    (event,) = rig.events()
    assert event.time_s == pytest.approx(52.0)
    snapshot = rig.snapshot()
    assert snapshot.time_s == pytest.approx(52.0)
    assert snapshot.x_um == pytest.approx(41.0, abs=2.0)
    assert snapshot.force_mN == 0.0


@pytest.mark.parametrize("omega", [None, 2437.8])
def test_a_part_slips_on_command(simulation: Simulation, omega: float | None) -> None:
    rig = _rig(simulation, passive_natural_frequency_rad_per_s=omega, creep_per_decade=0.0)
    before_um, before_mN = _held(rig, 2.2), rig.snapshot().force_mN
    rig.slip_part(2.0)
    kappa = 0.46 * 2.11
    assert _held(rig, 2.2) - before_um == pytest.approx(2.0 * kappa / (1.0 + kappa), abs=1e-3)
    assert rig.snapshot().force_mN - before_mN == pytest.approx(-2.11 * 2.0 / (1.0 + kappa), 1e-3)
    assert [event.what for event in rig.events()] == ["slipped"]


@pytest.mark.parametrize("slips", [1, 3])
def test_a_part_slips_at_its_force(simulation: Simulation, slips: int) -> None:
    part = Bead(slip_force_mN=6.0, slip_um=1.5, slips=slips)
    rig, largest_mN = _rig(simulation, part=part, creep_per_decade=0.0), 0.0
    for tick in range(240):
        rig.put_out(2.4 * min(1.0, tick / 200))
        if len(rig.events()) < slips:
            largest_mN = max(largest_mN, rig.snapshot().force_mN)
    assert [event.what for event in rig.events()] == ["slipped"] * slips
    assert largest_mN < 6.5
