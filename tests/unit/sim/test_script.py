"""The script of a simulated rig: when its commands take effect, and how they change readings and
voltages."""

from collections.abc import Sequence

import pytest

from pincette.config import ConfigError, RigFile, parse_rig
from pincette.config.script import OPERATIONS
from pincette.core.messages import SimCommand
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.script.script import FORBIDDEN, script_of
from tests.unit.sim.stand import Rig, Stand, T, entry, stand


def test_without_a_command_nothing_changes() -> None:
    bench = stand()
    assert bench.run(5) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert bench.rig.writes == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])


def test_a_stuck_sensor_shows_its_last_reading_for_its_time() -> None:
    bench = stand(entry(3 * T, "sensor", "stuck", for_s=3 * T))
    assert bench.run(8) == [0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 6.0, 7.0]


def test_a_sensor_stays_stuck_for_longer_than_the_past_is_stored() -> None:
    bench = stand(entry(3 * T, "sensor", "stuck"))
    assert set(bench.run(1000)[3:]) == {2.0}


def test_simulated_sensor_faults_give_wrong_old_or_out_of_range_readings() -> None:
    assert stand(entry(2 * T, "sensor", "wrong", value=-5.0)).run(4) == [0.0, 1.0, -3.0, -2.0]
    delayed = stand(entry(4 * T, "sensor", "delayed", value=3 * T)).run(7)
    assert delayed == [0.0, 1.0, 2.0, 3.0, 1.0, 2.0, 3.0]
    shown = stand(entry(T, "sensor", "over_range", value=-1.0))
    keyence = SimulatedKeyence(shown.measure)
    assert keyence.answer(b"MS,01") == b"MS,01,+0000.00"
    shown.run(2)
    assert keyence.answer(b"MS,01") == b"MS,01,-FFFFFFF"


def test_simulated_output_faults_freeze_switch_off_or_delay_the_output() -> None:
    def put(what: str, **value: float) -> list[float]:
        bench = stand(entry(2 * T, "output", what, **value))
        bench.run(5)
        return bench.rig.writes

    assert put("stuck") == pytest.approx([0.0, 0.1, 0.1, 0.1, 0.1])
    assert put("wrong", value=1.0) == pytest.approx([0.0, 0.1, 1.2, 1.3, 1.4])
    assert put("delayed", value=2 * T) == pytest.approx([0.0, 0.1, 0.0, 0.1, 0.2])


def test_simulated_output_faults_freeze_switch_off_or_delay_an_output_that_plays_shaped_steps() -> (
    None
):
    def put(what: str, **value: float) -> list[tuple[float, ...]]:
        bench, played = stand(entry(2 * T, "output", what, **value)), list[tuple[float, ...]]()

        def play(voltages_V: Sequence[float], rate_hz: float) -> None:
            assert rate_hz == 1000.0
            played.append(tuple(voltages_V))

        put_parts = bench.script.put_out_wave(play)
        bench.run(2)
        put_parts([0.15, 0.25], 1000.0)
        return played

    assert put("stuck") == [pytest.approx((0.1, 0.1))]
    assert put("wrong", value=1.0) == [pytest.approx((1.15, 1.25))]
    assert put("delayed", value=2 * T) == [pytest.approx((0.0, 0.0))]


def test_commands_of_the_rig_file_count_time_from_the_first_write_and_other_commands_from_now() -> (
    None
):
    bench = stand(entry(T, "part", "lose"))
    for _ in range(5):
        bench.measure()
    assert bench.rig.done == []
    bench.run(2)
    assert bench.rig.done == [(T, "lose")]
    bench.order("arm", "hysteresis", 3.0, after_s=2 * T)
    bench.run(4)
    assert bench.rig.done[1:] == [(4 * T, "hysteresis 3.0")]


def test_each_operation_acts_on_the_rig() -> None:
    bench = stand()
    bench.order("part", "remove")
    bench.order("part", "place")
    bench.order("part", "place", 31.0)
    bench.order("part", "lose")
    bench.order("weight", "hang", 5.0)
    bench.order("weight", "hang", 0.0)
    bench.order("arm", "stiffen", 2.0)
    bench.order("arm", "hysteresis", 0.5)
    assert [text for _, text in bench.rig.done] == [
        "remove",
        "place None",
        "place 31.0",
        "lose",
        "hang 5.0",
        "hang 0.0",
        "stiffness 2.0",
        "hysteresis 0.5",
    ]


def test_the_command_heal_ends_only_faults_that_started_before_it() -> None:
    bench = stand()
    bench.order("sensor", "wrong", 5.0)
    bench.order("output", "stuck")
    assert bench.run(1) == [5.0]
    bench.order("sensor", "heal")
    bench.order("sensor", "wrong", 7.0)
    bench.order("sensor", "heal", after_s=2 * T)
    assert bench.run(4) == [8.0, 9.0, 3.0, 4.0]
    assert set(bench.rig.writes) == {0.0}


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (
            SimCommand("bead", "remove"),
            "no target 'bead'; targets are part, weight, arm, sensor, output",
        ),
        (SimCommand("part", "melt"), "part has no operation 'melt'; it has remove, place, lose"),
        (SimCommand("output", "over_range"), "output has no operation 'over_range'"),
        (SimCommand("weight", "hang"), "weight hang needs a value: weight in mN"),
        (SimCommand("weight", "hang", 1e6), "weight hang 1000000.0: beyond -1000..1000"),
        (SimCommand("arm", "stiffen", float("nan")), "arm stiffen nan: beyond 0.01..100"),
        (SimCommand("sensor", "slow", 6.0), "sensor slow 6.0: beyond 0..5 (s)"),
        (SimCommand("sensor", "stuck", 1.0), "sensor stuck takes no value, 1.0 was given"),
        (SimCommand("part", "lose", for_s=1.0), "part lose happens once: for_s = 1.0 s"),
        (SimCommand("sensor", "off", after_s=-1.0), "after_s = -1.0 s is not a future time"),
        (SimCommand("sensor", "off", for_s=0.0), "for_s = 0.0 s is not a duration"),
    ],
)
def test_a_wrong_command_is_refused_with_the_list_of_valid_ones(
    order: SimCommand, words: str
) -> None:
    bench = stand()
    assert words in bench.script.order(order)
    assert bench.run(2) == [0.0, 1.0]
    assert bench.rig.done == []


def test_impossible_commands_are_reported() -> None:
    bench = stand()
    assert "there is no room" in bench.script.order(SimCommand("part", "place", 13.0))


def test_commands_need_permission(demo: RigFile) -> None:
    script = script_of(demo)
    script.operate(Rig())
    assert script.order(SimCommand("part", "remove")) == FORBIDDEN
    assert "scripts = true" in FORBIDDEN


def test_a_rig_file_may_contain_commands_to_the_simulated_rig_and_wrong_ones_are_refused(
    demo: RigFile,
) -> None:
    tree = demo.model_dump(mode="json", exclude_unset=True)
    tree["simulation"]["script"] = [{"at_s": 0.04, "target": "sensor", "what": "stuck"}]
    rig = Rig()
    bench = Stand(script_of(parse_rig(tree)), rig)
    assert bench.run(4) == [0.0, 1.0, 1.0, 1.0]
    tree["simulation"]["script"][0]["what"] = "stuk"
    with pytest.raises(ConfigError, match=r"script\.0.*sensor has no operation 'stuk'"):
        parse_rig(tree)


def test_a_run_can_be_repeated_bit_for_bit() -> None:
    def said() -> list[float]:
        orders = (
            entry(0.1, "sensor", "delayed", value=0.05, for_s=0.2),
            entry(0.2, "output", "wrong", value=0.3),
            entry(0.3, "sensor", "wrong", value=0.7),
        )
        bench = stand(*orders)
        return [*bench.run(50), *bench.rig.writes]

    assert said() == said()


def test_the_table_names_each_operation_once() -> None:
    for operations in OPERATIONS.values():
        names = [operation.what for operation in operations]
        assert len(names) == len(set(names))
