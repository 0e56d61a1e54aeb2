"""Segments without a law: voltage paths, waiting for a person, swept sines, and the way back."""

import pytest
from msgspec.structs import replace

from pincette.control.planning.paths import Knot, Path
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow, Move, PlayedSweep, Segment
from pincette.control.planning.sweep import Sweep
from pincette.core.faults import Acted, ActionCode
from pincette.core.messages import Action
from pincette.core.service import RefusedError
from pincette_controller.step import handle

from .bench import CONFIG, GUARDS, Bench, T

SWEEP = Sweep(5.0, 800.0, 1.0, 0.02, 10_000.0)


def ramp(to_V: float, *, relative: bool = False) -> Path:
    knots = (Knot(0.0, 0.0, 0.0), Knot(0.4, to_V, 0.0))
    return Path("voltage", "waypoints", knots=knots, relative=relative)


def plays(*segments: Segment) -> Bench:
    return Bench(Program(segments, GUARDS, 2.0))


def test_a_voltage_path_is_sent_to_the_output_unchanged() -> None:
    bench = plays(Drive("rise", 0.4, courses=(Follow(ramp(0.3)),)))
    last = bench.until()
    requests = [tick.command.arms[0].voltage_V for tick in bench.ticks[:-1]]
    path = ramp(0.3)
    assert requests == [path.at((index + 1) * T) for index in range(len(requests))]
    assert last.telemetry.outcome == "moved"
    assert last.command.final
    assert last.command.arms[0].voltage_V == requests[-1] == pytest.approx(0.3)


def test_a_relative_path_starts_at_the_present_voltage() -> None:
    bench = plays(
        Drive("rise", 0.4, courses=(Follow(ramp(0.3)),)),
        Drive("more", 0.4, courses=(Follow(ramp(0.2, relative=True)),)),
        Drive("rest", 0.2),
    )
    bench.until()
    assert bench.applied_V == pytest.approx(0.5)


def test_a_wait_keeps_the_voltage_until_it_is_continued() -> None:
    bench = plays(Drive("rise", 0.4, courses=(Follow(ramp(0.3)),)), Drive("hang 5 mN", None))
    with pytest.raises(RefusedError, match="does not wait for a person"):
        handle(CONFIG, bench.state, Action(ActionCode.CONTINUE), 0.0)
    bench.until("hang 5 mN")
    for _ in range(100):
        assert not bench.tick().command.final
    bench.state, _, _ = handle(CONFIG, bench.state, Action(ActionCode.CONTINUE), 0.0)
    assert bench.tick().telemetry.acted == (Acted.CONTINUE,)
    assert bench.ticks[-1].command.final
    assert bench.applied_V == pytest.approx(0.3)


def test_a_sweep_is_sent_with_every_command_of_its_segment_only() -> None:
    bench = plays(
        Drive("rest", 0.1),
        PlayedSweep("sweep", SWEEP.duration_s, sweep=SWEEP),
        Drive("calm", 0.1),
    )
    bench.until()
    carried = [tick.command.sweep for tick in bench.ticks]
    assert carried.count(SWEEP) == 50
    assert {tick.telemetry.phase for tick in bench.ticks if tick.command.sweep} == {"sweep"}
    assert not any(tick.command.arms[0].voltage_V for tick in bench.ticks)


def test_a_law_that_follows_a_voltage_path_starts_without_a_jump() -> None:
    bench = plays(
        Drive("rise", 0.4, courses=(Follow(ramp(0.3)),)),
        Move("retreat", 0.6, to_um=(0.0,)),
    )
    bench.until("retreat")
    steps = [
        abs(after.command.arms[0].voltage_V - before.command.arms[0].voltage_V)
        for before, after in zip(bench.ticks, bench.ticks[1:], strict=False)
    ]
    assert steps[-1] < max(steps[:-1])
    last = bench.until()
    assert bench.x_um == pytest.approx(0.0, abs=0.02)
    assert last.telemetry.outcome == "moved"


@pytest.mark.parametrize("phase", ["rise", "sweep", "hang"])
def test_a_stop_ends_the_current_program(phase: str) -> None:
    bench = plays(
        Drive("rise", 0.4, courses=(Follow(ramp(0.3)),)),
        PlayedSweep("sweep", SWEEP.duration_s, sweep=SWEEP),
        Drive("hang", None),
    )
    bench.until(phase)
    bench.state, _, _ = handle(CONFIG, bench.state, Action(ActionCode.STOP), 0.0)
    stopping = bench.tick()
    assert stopping.telemetry.phase == "stopping"
    assert stopping.command.sweep is None
    assert bench.until().telemetry.outcome == "stopped"
    assert abs(bench.applied_V - stopping.command.arms[0].voltage_V) < 0.02


@pytest.mark.parametrize("own_retreat", [True, False])
def test_beyond_a_position_limit_the_arm_goes_back(own_retreat: bool) -> None:
    """No other guard monitors the position while no law is active."""
    retreat = (Move("retreat", 0.6, to_um=(0.0,)),) if own_retreat else ()
    segments = (Drive("rise", 0.4, courses=(Follow(ramp(0.5)),)), Drive("rest", 5.0))
    guards = replace(GUARDS, position_min_um=-5.0, position_max_um=8.0)
    bench = Bench(Program((*segments, *retreat), guards, 2.0))
    last = bench.until()
    assert last.telemetry.outcome == "overtravel"
    assert max(tick.estimate.arms[0].x_um for tick in bench.ticks) < 10.0
    assert bench.x_um == pytest.approx(0.0, abs=0.05)
