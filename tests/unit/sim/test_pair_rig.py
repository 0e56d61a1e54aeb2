"""The simulated rig of two arms: ticks, both kinds of time, and its commands."""

import pytest

from pincette.config import ConfigError, Simulation
from pincette.core.messages import GroundTruth, SimCommand
from pincette.sim.bench import open_bench
from pincette.sim.rig.pair_rig import ArmOfPair, SimulatedPair
from pincette.sim.script.script import Script, script_of
from tests.support.rigs import Tree, demo_rig
from tests.support.two_arms import two_arm_rig


def made(
    *changes: Tree, time: str = "lockstep"
) -> tuple[SimulatedPair, list[GroundTruth], list[float]]:
    truths: list[GroundTruth] = []
    now = [0.0]

    bench = open_bench(two_arm_rig(*changes, time=time), lambda: now[0], truths.append)
    assert isinstance(bench.rig, SimulatedPair)
    return bench.rig, truths, now


def test_a_tick_of_lockstep_ends_once_both_outputs_are_written() -> None:
    pair, truths, _ = made()
    pair.put_out(0, 0.5)
    pair.put_out(0, 1.0)
    assert (pair.now_s(), truths) == (0.0, [])
    pair.put_out(1, 0.5)
    assert pair.now_s() == 0.02
    first, second = truths[0].arms
    assert (truths[0].seq, first.x_um, first.force_mN) == (0, 0.0, 0.0)
    assert first.voltage_V == pytest.approx(1.0, abs=1e-3)
    assert second.voltage_V == pytest.approx(0.5, abs=1e-3)
    assert truths[0].part_um == 6.2
    pair.pass_time()
    assert pair.snapshot().tips_um[0] > pair.snapshot().tips_um[1] > 1.0


def test_readings_of_both_arms_have_independent_reproducible_noise() -> None:
    pair, _, _ = made()
    assert [pair.measure_um(0) for _ in range(3)] == [pair.measure_um(0)] * 3
    fine: Tree = {"simulation": {"sensor_step_um": 1e-6}}
    one, two = made(fine)[0], made(fine)[0]
    assert one.measure_um(0) == two.measure_um(0)
    assert one.measure_um(0) != one.measure_um(1)


def test_in_real_time_each_voltage_acts_from_its_write_on() -> None:
    pair, truths, now = made({"simulation": {"bead": False}}, time="real")
    now[0] = 0.01
    pair.put_out(0, 1.0)
    now[0] = 0.2
    assert pair.snapshot().tips_um[0] > 10.0
    assert pair.snapshot().tips_um[1] == 0.0
    pair.put_out(1, 1.0)
    pair.pass_time()
    assert [truth.seq for truth in truths] == [0, 0]
    first_V, second_V = ([truth.arms[arm].voltage_V for truth in truths] for arm in (0, 1))
    assert first_V == [pytest.approx(1.0, abs=1e-3)] * 2
    assert second_V == [0.0, pytest.approx(1.0, abs=1e-3)]
    now[0] = 0.4
    assert pair.snapshot().tips_um[1] > 5.0


def test_parts_can_be_removed_and_placed_where_there_is_room() -> None:
    pair, _, _ = made()
    pair.remove_part()
    assert not pair.snapshot().part_present
    pair.place_part(5.0)
    assert (pair.snapshot().part_present, pair.snapshot().part_um) == (True, 5.0)
    pair.lose_part()
    for arm in (0, 1):
        pair.put_out(arm, 2.0)
    with pytest.raises(ValueError, match=r"the arms are at .*: open the gripper first"):
        pair.place_part()
    pair.hang(0.1)
    pair.scale_stiffness(2.0)
    pair.scale_hysteresis(1.1)
    what = [event.what for event in pair.events()]
    assert what == ["removed", "placed", "lost", "hung", "stiffness", "hysteresis"]


def test_a_rig_may_start_without_a_part() -> None:
    pair, _, _ = made({"simulation": {"bead": False}})
    assert not pair.snapshot().part_present


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"averaging_s": 0.001}, "sensors of a pair do not average"),
        ({"passive_natural_frequency_rad_per_s": 2000.0}, "a pair has no passive arm"),
        ({"second_mode": {"share": 0.02}}, "one mode"),
        ({"actuation_delay_s": 0.5}, "is above the period"),
    ],
)
def test_unsupported_features_of_a_pair_are_refused(change: Tree, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        made({"simulation": change})


def test_an_arm_of_a_pair_refuses_waves_and_averaging() -> None:
    pair, _, _ = made()
    arm = ArmOfPair(pair, 1)
    arm.set_averaging(0.0)
    with pytest.raises(ValueError, match="do not average"):
        arm.set_averaging(0.01)
    with pytest.raises(ValueError, match="cannot play or acquire waves"):
        arm.put_out_wave((1.0,), 100.0)


def test_drivers_of_either_arm_must_be_simulated() -> None:
    with pytest.raises(ConfigError, match=r"second\.output\.driver = 'nobody': only "):
        made({"second": {"output": {"driver": "nobody"}}})


def test_faults_of_the_second_arm_do_not_affect_the_first() -> None:
    rig = two_arm_rig()
    script = script_of(rig)
    bench = open_bench(rig, lambda: 0.0, None, script)
    assert set(bench.fitted) == {"sensor", "output", "second_sensor", "second_output"}
    assert not script.order(SimCommand("second_sensor", "off"))
    assert bench.fitted["second_sensor"].instrument.answer(b"MS,01") is None
    assert bench.fitted["sensor"].instrument.answer(b"MS,01") is not None


def test_a_rig_of_one_arm_accepts_no_commands_for_a_second() -> None:
    rig = demo_rig({"simulation": {"scripts": True}})
    script = script_of(rig)
    open_bench(rig, lambda: 0.0, None, script)
    words = script.order(SimCommand("second_output", "off"))
    assert words == "second_output: this rig has one driven arm; name output"
    assert Script().order(SimCommand("part", "lose")) == "there is no rig to operate"


def test_a_simulation_of_two_arms_has_default_values_for_the_pair() -> None:
    simulation = two_arm_rig().simulation
    assert isinstance(simulation, Simulation)
    assert simulation.pair_of_arms.ground_slip_mN == 1.5
    assert simulation.model_copy(update={"pair": None}).pair_of_arms.face_mN_per_um == 80.0
