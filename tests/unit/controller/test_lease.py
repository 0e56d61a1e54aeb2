"""A program whose lease is not renewed is stopped as its job specifies, and only by the
controller itself."""

import pytest
from msgspec.structs import replace

from pincette.core.faults import Acted, ActionCode, LeaseEnd, Outcome
from pincette.core.messages import Ack, Action, Command, Lease, RequestLog, Telemetry
from pincette.core.service import RefusedError
from pincette.core.wording import fault_text
from pincette_controller.actions import RunningLease, lease_end, lease_objection
from pincette_controller.step import Inputs, handle, step

from .bench import Bench, T, program

LENGTH_S = 0.2


class Leased(Bench):
    """A bench whose controller plays under a lease, on a separate clock."""

    def __init__(self, then: str = "stop", length_s: float | None = LENGTH_S) -> None:
        super().__init__(program())
        self.now_s = 100.0
        self.asked: list[RequestLog] = []
        if length_s is not None:
            self.renew(then, length_s)

    def renew(self, then: str = "stop", length_s: float = LENGTH_S) -> None:
        lease = Lease(1, length_s, LeaseEnd(then))
        self.state, reply, _ = handle(self.config, self.state, lease, self.now_s)
        assert isinstance(reply, Ack)

    def tock(self) -> tuple[Command, Telemetry]:
        self.now_s += T
        self.state, outputs = step(self.config, self.state, Inputs(self.estimate()), self.now_s)
        command, telemetry = outputs[:2]
        assert isinstance(command, Command)
        assert isinstance(telemetry, Telemetry)
        self.asked += [output for output in outputs if isinstance(output, RequestLog)]
        self._drive(command.arms[0].voltage_V)
        self.seq += 1
        if command.zero:
            self.zero_seq = self.seq
        return command, telemetry

    def reach(self, phase: str) -> None:
        """Continue to a phase, renewing at every tick."""
        for _ in range(500):
            self.renew()
            if self.tock()[1].phase == phase:
                return
        raise AssertionError(f"{phase} never came")


def test_a_free_arm_comes_to_rest_and_the_program_ends() -> None:
    bench = Leased()
    bench.reach("approach")
    for _ in range(3):
        bench.tock()
    before = len(bench.asked)
    received: list[Telemetry] = []
    while bench.state.playing:
        received.append(bench.tock()[1])
        assert len(received) < 100
    assert before == 0
    (noted,) = bench.asked
    assert noted.action is not None
    assert noted.action.action == "stop"
    assert (
        fault_text(noted.action.reason)
        == "lease: nothing received from the supervisor for 0.2 s, limit 0.2 s"
    )
    assert bench.state.found == noted.action.reason
    assert [sample.acted for sample in received if sample.acted] == [(Acted.LEASE, Acted.STOP)]
    (acted,) = [sample.seq for sample in received if sample.acted]
    assert acted == noted.seq + 1
    assert (received[-1].phase, received[-1].outcome, received[-1].held) == (
        "stopping",
        "stopped",
        False,
    )


def test_a_held_part_keeps_its_force_until_a_person_acts() -> None:
    bench = Leased()
    bench.reach("hold")
    while not bench.asked:
        command, _ = bench.tock()
    pressed_mN = bench.force_mN
    for _ in range(500):
        command, telemetry = bench.tock()
        assert command.valid
        assert (telemetry.phase, telemetry.held) == ("hold", True)
    assert bench.force_mN == pytest.approx(pressed_mN, abs=0.5)
    assert len(bench.asked) == 1


@pytest.mark.parametrize(("then", "last"), [("let_go", "unload"), ("retract", "retreat")])
def test_the_job_decides_about_a_held_part(then: str, last: str) -> None:
    bench = Leased(then)
    bench.reach("hold")
    bench.renew(then)
    received: list[Telemetry] = []
    while bench.state.playing:
        received.append(bench.tock()[1])
        assert len(received) < 500
    assert (received[-1].phase, received[-1].outcome, received[-1].held) == (last, "stopped", False)


def test_after_a_pause_nothing_moves_when_the_lease_has_ended() -> None:
    bench = Leased()
    bench.reach("hold")
    bench.state = handle(bench.config, bench.state, Action(ActionCode.PAUSE), bench.now_s)[0]
    while not bench.tock()[1].paused:
        bench.renew()
    where_um = bench.x_um
    while not bench.asked:
        bench.tock()
    after = [bench.tock()[1] for _ in range(50)]
    assert all(telemetry.held for telemetry in after)
    assert abs(bench.x_um - where_um) < 0.05


@pytest.mark.parametrize("late", [0, 1, 5, 9])
def test_a_late_renewal_within_the_lease_changes_nothing(late: int) -> None:
    alone, renewed = Bench(program()), Leased()
    while renewed.state.playing:
        if renewed.seq % (late + 1) == late:
            renewed.renew()
        command, telemetry = renewed.tock()
        tick = alone.tick()
        assert (command, telemetry) == (tick.command, tick.telemetry)
    assert renewed.asked == []
    assert not alone.state.playing


def test_without_a_lease_a_program_runs_to_its_end() -> None:
    bench = Leased(length_s=None)
    last = None
    while bench.state.playing:
        bench.now_s += 3600.0
        last = bench.tock()[1]
        assert bench.seq < 500
    assert bench.asked == []
    assert last is not None
    assert last.outcome == "gripped"


def test_a_stopped_program_is_not_stopped_again() -> None:
    bench = Leased()
    bench.reach("hold")
    bench.state = handle(bench.config, bench.state, Action(ActionCode.STOP), bench.now_s)[0]
    for _ in range(200):
        bench.tock()
    assert bench.asked == []


def test_a_lease_that_has_ended_is_not_granted_again() -> None:
    bench = Leased()
    bench.reach("approach")
    while not bench.asked:
        bench.tock()
    with pytest.raises(RefusedError, match="the lease of this epoch has ended: arm again"):
        bench.renew()


def test_the_next_arming_starts_without_the_previous_lease() -> None:
    bench = Leased()
    fresh = Bench(program())
    assert bench.state.lease is not None
    assert fresh.state.lease is None


def test_an_impossible_lease_is_refused_with_its_value() -> None:
    good = Lease(7, 10.0)
    assert lease_objection(good, 7, playing=True, ended=False) == ""
    assert lease_objection(good, 8, playing=True, ended=False) == (
        "lease of epoch 7, the controller is in 8"
    )
    assert "no program runs" in lease_objection(good, 7, playing=False, ended=False)
    assert "-1 s" in lease_objection(replace(good, length_s=-1.0), 7, playing=True, ended=False)


def test_a_lease_ends_only_after_its_limit_is_exceeded() -> None:
    running = RunningLease(Lease(1, 10.0), 5.0)
    assert lease_end(running, Outcome.NONE, 15.0) is None
    assert lease_end(running, Outcome.STOPPED, 99.0) is None
    requested = lease_end(running, Outcome.NONE, 15.06)
    assert requested is not None
    assert (
        fault_text(requested.reason)
        == "lease: nothing received from the supervisor for 10.1 s, limit 10 s"
    )
