"""The supervisor's side of a lease: granted with the arming, renewed in time, its end reported."""

from collections.abc import Callable

import pytest

from pincette.bus.protocol import BusError, RefusalError
from pincette.config import RigFile
from pincette.core.faults import Acted, FaultCode, LeaseEnd, Outcome, fault
from pincette.core.messages import Ack, Lease, Message
from pincette.core.topics import LEASE, Request
from pincette.engine.arming import arm
from pincette_supervisor.jobs.lease import RENEWALS, Renewal, lease_of, renewing
from pincette_supervisor.kinds.calibrate.requests import NoiseRequest
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job

from .canned import IN_APPROACH, IN_HOLD, CannedRig
from .harness import Harness

LENGTH_S = 10.0
ENDED = fault(FaultCode.LEASE_ENDED, silent_s=10.0, limit_s=10.0)
WORDS = "lease: nothing received from the supervisor for 10.0 s, limit 10 s"


class Line(CannedRig):
    """A controller that accepts or refuses a lease, and records the times of the requests."""

    def __init__(self, rig: RigFile) -> None:
        super().__init__(rig)
        self.now_s = 0.0
        self.answer: Exception | None = None
        self.takes_s = 0.0

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        if question != LEASE:
            return super().call(question, request, timeout_s)
        self.now_s += min(self.takes_s, timeout_s)
        self.asked.append(f"lease at {self.now_s:g} s")
        if self.answer is not None:
            raise self.answer
        return Ack(0)


def test_a_job_in_real_time_plays_under_the_lease_of_its_rig(real_time: RigFile) -> None:
    grip = GripJobRequest(kind="grip")
    assert lease_of(real_time, grip, 7) == Lease(7, LENGTH_S, LeaseEnd.STOP)
    for on_stop, then in (("hold", "stop"), ("release", "let_go"), ("retract", "retract")):
        requested = grip.model_copy(update={"on_stop": on_stop})
        lease = lease_of(real_time, requested, 7)
        assert lease is not None
        assert lease.then == then


def test_a_calibration_survives_a_stalled_supervisor_and_releases_at_its_end(
    real_time: RigFile,
) -> None:
    noise = NoiseRequest(calibration="noise")
    lease = lease_of(real_time, noise, 7)
    assert lease == Lease(7, 3.0 * LENGTH_S, LeaseEnd.RETRACT)
    stood_s = 10.0
    assert lease is not None
    assert stood_s + lease.length_s / RENEWALS < lease.length_s
    safety = real_time.safety.model_copy(update={"lease_s": 0.0})
    assert lease_of(real_time.model_copy(update={"safety": safety}), noise, 7) is None


def test_no_lease_applies_in_lockstep_or_to_a_rig_without_one(
    rig_file: RigFile, real_time: RigFile
) -> None:
    grip = GripJobRequest(kind="grip")
    assert lease_of(rig_file, grip, 7) is None
    safety = real_time.safety.model_copy(update={"lease_s": 0.0})
    assert lease_of(real_time.model_copy(update={"safety": safety}), grip, 7) is None


def test_the_lease_is_granted_before_the_first_sample(real_time: RigFile) -> None:
    bus = Line(real_time)
    bus.latch = ""
    program = plan_job(GripJobRequest(kind="grip"), real_time).program
    arm(bus, program, epoch=7, digest=real_time.digest(), owner=1, lease=Lease(7, LENGTH_S))
    granted = bus.asked.index("lease at 0 s")
    assert bus.asked.index("controller/arm") < granted < bus.asked.index("sensor/arm")


def test_unanswered_renewals_are_repeated_and_refused_ones_are_not(
    real_time: RigFile,
) -> None:
    bus = Line(real_time)
    renewal = Renewal(bus, Lease(7, LENGTH_S), lambda: bus.now_s)
    bus.answer = BusError("no program answers")
    bus.now_s = 4.0
    assert renewal.renew(1.0)
    assert renewal.age_s == 4.0
    bus.answer = None
    assert renewal.renew(1.0)
    assert renewal.age_s == 0.0
    bus.answer = RefusalError("no program runs: its lease cannot be renewed")
    assert not renewal.renew(1.0)


def test_the_renewal_thread_ends_with_the_job(real_time: RigFile) -> None:
    bus = Line(real_time)
    with renewing(Renewal(bus, Lease(7, 0.05))):
        while len(bus.asked) < 3:
            pass
    count = len(bus.asked)
    assert count >= 3
    with renewing(None):
        pass
    assert len(bus.asked) == count


def lapse(harness: Harness) -> None:
    """The controller has stopped at the end of the lease, and states that."""
    harness.bus.findings["controller"] = (ENDED,)
    bus, place = harness.bus, harness.bus.place
    held = bus.ticks[place].telemetry.held
    bus.say(bus.ticks[place], (Acted.LEASE, Acted.STOP), Outcome.STOPPED)
    if not held:  # nor is anything from here on: the arm comes to rest
        bus.ticks[place:-1] = bus.ticks[place : place + 1]
    bus.play(place + 1 if held else None)


@pytest.mark.parametrize(("place", "held"), [(IN_APPROACH, False), (IN_HOLD, True)])
def test_a_supervisor_that_was_away_finds_the_job_stopped_with_the_cause(
    harness: Harness, place: int, held: bool
) -> None:
    job = harness.playing_to(place)
    lapse(harness)
    ended = harness.ended(job)
    assert (ended["state"], ended["cause"]) == ("stopped", WORDS)
    assert harness.bus.acts == []
    (row,) = harness.get("/alarms")["alarms"]
    assert (row["cause"], row["words"], row["job"]) == ("lease", WORDS, job)
    if held:
        harness.acted(job, "release")
    assert harness.freed(job)["state"] == "stopped"


def test_a_program_that_ended_while_no_supervisor_ran_is_reported_by_the_next_supervisor(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    before = open_harness(rig_file, guard_s=1e6)
    job = before.playing_to(IN_APPROACH)
    unfinished = before.store.interrupt_unfinished("2026-03-01T12:00:00.000Z")
    assert unfinished == [job]
    after = open_harness(rig_file)
    after.bus.findings["controller"] = (ENDED,)
    after.health.refresh(force=True)
    after.manager.recover(unfinished)
    reported = after.get(f"/jobs/{job}")
    assert reported["state"] == "interrupted"
    assert reported["cause"].endswith(WORDS)
    (row,) = after.get("/alarms")["alarms"]
    assert row["words"] == WORDS


def test_the_lease_is_among_the_checks(harness: Harness) -> None:
    (check,) = [one for one in harness.get("/rigs/demo")["checks"] if one["name"] == "lease"]
    assert check["ok"]
    job = harness.playing_to(IN_HOLD)
    live = harness.live
    now_s = 0.0
    live.renewal = Renewal(harness.bus, Lease(live.epoch, LENGTH_S), lambda: now_s)
    now_s = 4.0
    (check,) = [one for one in harness.get("/rigs/demo")["checks"] if one["name"] == "lease"]
    assert (check["ok"], check["value"], check["limit"], check["unit"]) == (True, 4.0, 10.0, "s")
    now_s = 10.5
    (check,) = [one for one in harness.get("/rigs/demo")["checks"] if one["name"] == "lease"]
    assert not check["ok"]
    assert check["words"] == "lease renewed 10.5 s ago, limit 10 s"
    harness.acted(job, "abort")
    harness.ended(job)
