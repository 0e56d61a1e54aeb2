"""Actions requested of the service: when they take effect, their telemetry, and refusals."""

import pytest

from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive
from pincette.core.faults import Acted, ActionCode
from pincette.core.messages import Ack, Action
from pincette.core.service import RefusedError
from pincette_controller.step import handle

from .bench import CONFIG, GUARDS, Bench, program


def ask(bench: Bench, action: str, at_seq: int | None = None) -> int:
    bench.state, reply, _ = handle(CONFIG, bench.state, Action(ActionCode(action), at_seq), 0.0)
    assert isinstance(reply, Ack)
    return reply.seq


def until_paused(bench: Bench) -> int:
    for _ in range(200):
        tick = bench.tick()
        if tick.telemetry.paused:
            return tick.telemetry.seq
    raise AssertionError("no pause began")


def test_a_pause_holds_the_force_and_reports_its_start_and_end() -> None:
    bench = Bench(program())
    bench.until("hold")
    requested = ask(bench, "pause")
    began = until_paused(bench)
    assert requested <= began
    assert [t.telemetry.seq for t in bench.ticks if t.telemetry.acted == (Acted.PAUSE,)] == [began]
    ticks = [bench.tick() for _ in range(100)]
    assert {tick.telemetry.segment_tick for tick in ticks} == {ticks[0].telemetry.segment_tick}
    assert {tick.telemetry.force_r_mN for tick in ticks} == {20.0}
    assert all(tick.command.part_held and tick.command.valid for tick in ticks)
    assert [tick.estimate.arms[0].force_mN for tick in ticks[20:]] == pytest.approx(
        [20.0] * 80, abs=0.2
    )
    resumed = ask(bench, "resume")
    tick = bench.tick()
    assert (tick.telemetry.seq, tick.telemetry.acted) == (resumed, (Acted.RESUME,))
    assert not tick.telemetry.paused
    assert bench.until().telemetry.outcome == "gripped"


def test_a_pause_acts_at_the_requested_seq_or_later() -> None:
    bench = Bench(program())
    bench.until("hold")
    at_seq = bench.seq + 15
    assert ask(bench, "pause", at_seq) == at_seq
    assert until_paused(bench) == at_seq


def test_a_pause_requested_twice_acts_once() -> None:
    bench = Bench(program())
    bench.until("hold")
    ask(bench, "pause")
    until_paused(bench)
    ask(bench, "pause")
    assert bench.tick().telemetry.paused
    ask(bench, "resume")
    assert not bench.tick().telemetry.paused


def test_a_resume_cancels_a_pause_that_has_not_begun_yet() -> None:
    bench = Bench(program())
    bench.until("load")
    ask(bench, "pause")
    ask(bench, "resume")
    assert bench.tick().telemetry.acted == (Acted.RESUME,)
    last = bench.until()
    assert not any(tick.telemetry.paused for tick in bench.ticks)
    assert last.telemetry.outcome == "gripped"


def test_a_stop_during_a_pause_keeps_the_voltage() -> None:
    bench = Bench(program())
    bench.until("hold")
    ask(bench, "pause")
    until_paused(bench)
    settled = [bench.tick() for _ in range(60)][-1].command.arms[0].voltage_V
    ask(bench, "stop")
    ticks = [bench.tick() for _ in range(60)]
    assert ticks[0].telemetry.acted == (Acted.STOP,)
    assert not ticks[0].telemetry.paused
    assert max(abs(tick.command.arms[0].voltage_V - settled) for tick in ticks) < 1e-3
    ask(bench, "release")
    last = bench.until()
    assert (last.telemetry.outcome, last.command.part_held) == ("stopped", False)


@pytest.mark.parametrize(
    ("action", "phases"), [("let_go", ["unload"]), ("retract", ["unload", "retreat"])]
)
def test_actions_that_stop_and_release_are_reported_as_stops(
    action: str, phases: list[str]
) -> None:
    bench = Bench(program())
    bench.until("hold")
    seq = ask(bench, action)
    last = bench.until()
    assert next(t.telemetry.acted for t in bench.ticks if t.telemetry.seq == seq) == (Acted.STOP,)
    after = [tick.telemetry.phase for tick in bench.ticks if tick.telemetry.seq > seq]
    assert list(dict.fromkeys(after)) == phases
    assert last.telemetry.outcome == "stopped"


def test_the_action_keep_holds_the_part_at_the_applied_voltage_for_the_next_job() -> None:
    bench = Bench(program())
    bench.until("hold")
    ask(bench, "stop")
    for _ in range(30):
        bench.tick()
    ask(bench, "keep")
    last = bench.tick()
    assert (last.command.final, last.command.part_held) == (True, True)
    assert last.command.arms[0].voltage_V == last.estimate.arms[0].applied_V
    assert (last.telemetry.acted, last.telemetry.outcome) == ((), "stopped")


def test_an_action_without_effect_is_refused_with_the_reason() -> None:
    bench = Bench(program())
    for action, why in (
        ("resume", "not paused"),
        ("release", "no part is held"),
        ("keep", "no part is held at rest"),
        ("continue", "does not wait for a person"),
    ):
        with pytest.raises(RefusedError, match=why):
            ask(bench, action)
    bench.until("hold")
    ask(bench, "stop")
    bench.tick()
    with pytest.raises(RefusedError, match=r"has ended \(stopped\)"):
        ask(bench, "pause")
    ask(bench, "release")
    bench.until()
    with pytest.raises(RefusedError, match="no program runs: pause"):
        ask(bench, "pause")


def test_a_paused_wait_needs_a_resume_first() -> None:
    bench = Bench(Program((Drive("hang 5 mN", None),), GUARDS, 2.0))
    bench.tick()
    ask(bench, "pause")
    assert bench.tick().telemetry.paused
    with pytest.raises(RefusedError, match="paused: resume it first"):
        ask(bench, "continue")
    ask(bench, "resume")
    bench.tick()
    ask(bench, "continue")
    assert bench.tick().command.final
