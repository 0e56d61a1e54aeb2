"""The simulated arm keeps its state over a restart of the rig program."""

from pathlib import Path

import pytest

from pincette.config import RigFile
from pincette.sim.bench import Bench, open_bench
from pincette.sim.rig.pair_rig import ArmOfPair, SimulatedPair
from pincette.sim.rig.rig import SimulatedRig
from pincette_rig.arm_file import ArmFile
from tests.support.rigs import Tree, demo_rig
from tests.support.two_arms import two_arm_rig

MOVED_V = 2.0
DAY_S = 86_400.0
RELAYS: Tree = {"hysteresis": None, "relays": {"loop_share": 0.15, "full_drive_V": 4.0}}


class Clock:
    """Time of day that the test advances."""

    now_s = 1.0e9

    def __call__(self) -> float:
        return self.now_s


def bench_of(rig: RigFile) -> Bench:
    return open_bench(rig, lambda: 0.0)


def moved(bench: Bench, ticks: int, voltage_V: float) -> None:
    rig = bench.rig
    arms = [rig] if isinstance(rig, SimulatedRig) else [ArmOfPair(rig, 0), ArmOfPair(rig, 1)]
    for _ in range(ticks):
        for arm in arms:
            arm.measure_um()
            arm.put_out(voltage_V)


def places_um(bench: Bench) -> tuple[float, ...]:
    return tuple(arm.x_um for arm in bench.rig.arm_states())


@pytest.mark.parametrize("hysteresis", [{}, RELAYS], ids=["Bouc-Wen", "relays"])
def test_hysteresis_and_creep_outlive_the_program(tmp_path: Path, hysteresis: Tree) -> None:
    rig, clock = demo_rig({"simulation": hysteresis}, time="lockstep"), Clock()
    first = bench_of(rig)
    file = ArmFile(rig, tmp_path, first.rig, clock)
    file.start()
    moved(first, 100, MOVED_V)
    file.close()
    moved(first, 50, 0.0)  # output of the restarted rig in its first second
    second = bench_of(rig)
    assert places_um(second) == (0.0,)
    resumed_file = ArmFile(rig, tmp_path, second.rig, clock)
    resumed_file.start()
    resumed_file.close()
    (as_it_went_on,), (resumed,) = places_um(first), places_um(second)
    assert as_it_went_on > 0.3  # remanence and creep
    assert resumed == pytest.approx(as_it_went_on, abs=0.01)


def test_the_stored_arm_creeps_while_no_program_runs(tmp_path: Path) -> None:
    clock, bench_s = Clock(), [0.0]
    rig = demo_rig({"simulation": {"creep_per_decade": 0.02}}, time="real")
    first = open_bench(rig, lambda: bench_s[0])
    file = ArmFile(rig, tmp_path, first.rig, clock)
    assert isinstance(first.rig, SimulatedRig)
    first.rig.put_out(MOVED_V)
    bench_s[0] = 60.0
    file.save()
    kept = rig.simulated_arm(tmp_path).read_bytes()
    left_um: list[float] = []
    for away_s in (2.0, DAY_S):
        clock.now_s = Clock.now_s + away_s
        rig.simulated_arm(tmp_path).write_bytes(kept)
        later = bench_of(rig)
        again = ArmFile(rig, tmp_path, later.rig, clock)
        again.start()
        again.close()
        left_um.extend(places_um(later))
    just_now_um, a_day_ago_um = left_um
    assert a_day_ago_um < just_now_um - 0.3  # creep has decayed, remanence has not
    assert a_day_ago_um > 0.1


def test_both_arms_of_a_pair_are_saved(tmp_path: Path) -> None:
    rig, clock = two_arm_rig(time="lockstep"), Clock()
    first = bench_of(rig)
    assert isinstance(first.rig, SimulatedPair)
    file = ArmFile(rig, tmp_path, first.rig, clock)
    file.start()
    moved(first, 100, 1.0)
    file.close()
    second = bench_of(rig)
    resumed = ArmFile(rig, tmp_path, second.rig, clock)
    resumed.start()
    resumed.close()
    assert all(0.1 < x_um < 5.0 for x_um in places_um(second))


def test_a_stored_arm_of_another_hysteresis_or_in_a_damaged_file_is_replaced_by_a_new_arm(
    tmp_path: Path,
) -> None:
    rig, clock = demo_rig(time="lockstep"), Clock()
    bench = bench_of(rig)
    file = ArmFile(rig, tmp_path, bench.rig, clock)
    file.start()
    moved(bench, 100, MOVED_V)
    file.close()
    other = demo_rig({"simulation": RELAYS}, time="lockstep")
    for rig_file, damaged in ((other, False), (rig, True)):
        if damaged:
            rig.simulated_arm(tmp_path).write_bytes(b'{"arms": [')
        fresh = bench_of(rig_file)
        other_file = ArmFile(rig_file, tmp_path, fresh.rig, clock)
        other_file.start()
        other_file.close()
        assert places_um(fresh) == (0.0,)
