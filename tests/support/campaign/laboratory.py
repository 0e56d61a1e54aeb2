"""One rig of the campaign in use: an arm that lives on, programs and supervisors that come and go.

A person brings the rig up by its checklist, accepts what is proposed, and grips. Every job goes
through the supervisor's job manager, its journal and its records; only time is virtual.
"""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from pydantic import TypeAdapter

from pincette.api.jobs import Job
from pincette.api.requests import JobRequest
from pincette.config.derived import conditioning_V
from pincette.control.response.conditioned_branch import STROKES
from pincette.core.messages import Estimate, Message, Reset, Telemetry
from pincette.core.topics import ESTIMATE, RESET, TELEMETRY, Topic
from pincette.sim.bench import Bench
from pincette.sim.instruments.fitting import Fitted, Setting, simulated_driver
from pincette_supervisor.jobs.bring_up import checklist
from pincette_supervisor.kinds.bodies import Body
from tests.support.campaign.arm import Part, Truth
from tests.support.campaign.drawing import Drawn
from tests.support.office import Office
from tests.support.virtual_rig import VirtualRig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
LONGEST_TICKS = 60_000
"""Longest duration of one job, 20 virtual minutes."""
HANDS_TICKS = 25
COMPUTES_S = 900.0
"""Longest wall-clock time of one calibration's evaluation on a loaded machine."""


@dataclass(frozen=True)
class Sample:
    """One sample of a job: the stated and the true values."""

    estimate: Estimate
    truth: Truth


@dataclass
class Watched:
    """Samples of one job."""

    samples: dict[int, Sample] = field(default_factory=dict[int, Sample])
    views: dict[int, Telemetry] = field(default_factory=dict[int, Telemetry])


class Laboratory:
    """An arm, its instruments, and the programs that are started with it."""

    def __init__(self, drawn: Drawn, data: Path) -> None:
        self.drawn, self.arm, self.data = drawn, drawn.arm, data
        self._bench = bench_of(drawn)
        self.watched = Watched()
        self._open()

    def _open(self) -> None:
        self.rig = VirtualRig(self.drawn.rig, self.data, self._bench)
        for topic in (ESTIMATE, TELEMETRY):
            self.rig.bus.subscribe(topic, self._hear)
        self.office = Office(self.rig, self.data)
        self.office.steps.guard_s = COMPUTES_S
        self.rig.call(RESET, Reset(acknowledge=True))
        self.office.health.refresh(force=True)

    def _hear(self, _topic: Topic, message: Message) -> None:
        if isinstance(message, Estimate):
            self.watched.samples[message.seq] = Sample(message, self.arm.truth)
        elif isinstance(message, Telemetry):
            self.watched.views[message.seq] = message

    def close(self) -> None:
        """End supervisor and programs."""
        self.office.end()
        self.rig.close()

    def restart(self, rest_s: float) -> None:
        """End all programs, let the arm rest, and start all programs again."""
        self.close()
        self.arm.rest(rest_s)
        self._open()

    def run(self, body: dict[str, Any]) -> Job:
        """Run one job to its end, and hang the requested weights; raises ProblemError if it is
        refused."""
        self.watched = Watched()
        self.arm.peak_mN = 0.0
        manager, steps = self.office.manager, self.office.steps
        name = manager.create(REQUEST.validate_python(body), predict=False)[0].id
        waited = 0
        for _ in range(LONGEST_TICKS):
            if manager.index.is_recorded(name):
                break
            steps.pass_()
            view = self._newest_view()
            if view is None or not view.playing:
                continue
            job = manager.active
            if job is None or job.status.waiting is None:
                waited = 0
                continue
            waited += 1
            if waited == HANDS_TICKS:
                progress = job.status.progress
                weight_mN = None if progress is None else progress.weight_mN
                self.arm.hang(weight_mN or 0.0)
                manager.perform(name, "continue", "person")
        else:
            raise TimeoutError(f"{body} still runs after {LONGEST_TICKS} ticks")
        if self.office.faults:
            raise self.office.faults[0]
        manager.context.write_queue.flush()
        return manager.index.job(name)

    def put_part(self, part: Part) -> None:
        """Put a part in place; an arm that remanence holds beyond that place is drawn back first.

        A person cannot put a part where the arm is.
        """
        self.arm.part = None
        rig = self.office.manager.context.rig
        low_V = conditioning_V(rig)
        if self.arm.x_um > part.contact_um and low_V is not None:
            back = {"low_V": low_V, "high_V": 0.0, "conditioning_cycles": STROKES, "to_V": 0.0}
            self.run(
                self.confirmed({"kind": "move", "rig": rig.rig.name, "autostart": True} | back)
            )
        self.arm.part = part

    def confirmed(self, body: dict[str, Any]) -> dict[str, Any]:
        """Return a request with the confirmation that it needs if nothing is in contact with the
        arm."""
        request = REQUEST.validate_python(body)
        doubted = self.office.manager.context.zero_doubt.blocking(request)
        return body | {"zero_confirmed": bool(doubted) and self.arm.force_mN == 0.0}

    def reset(self) -> None:
        """Clear the actuator's latch, as a person does after seeing its cause."""
        manager = self.office.manager
        self.office.steps.pass_(HANDS_TICKS)
        manager.context.health.refresh(force=True)
        if manager.context.health.latched() is not None:
            manager.latch.reset("person")

    def _newest_view(self) -> Telemetry | None:
        views = self.watched.views
        return next(reversed(views.values())) if views else None

    def bring_up(self, tries: int = 2) -> str:
        """Follow the checklist to its end; returns why it could not be completed, empty if it
        was."""
        manager = self.office.manager
        left = tries
        while True:
            listed = checklist(manager.context.model, manager.calibrations)
            step = next((one for one in listed.steps if one.calibration == listed.next), None)
            if step is None:
                return ""
            needs = [need.code for need in step.needs]
            self.arm.part = None
            if "part_removed" not in needs:
                self.put_part(self.drawn.planned_part())
            request = step.request
            if left < tries and step.calibration == "free_response":
                # The person has checked that no part is there.
                request = request | {"no_part": True}
            job = self.run(self.confirmed(request))
            self.arm.hang(0.0)
            if job.state != "succeeded":
                self.reset()
                left -= 1
                if left == 0:
                    outcome = (job.result or {}).get("outcome", "")
                    return f"{step.calibration}: {job.state}, {outcome}, {job.cause}"
                continue
            left = tries
            manager.calibrations.act(job.id, "accept")


@contextmanager
def laboratory(drawn: Drawn, data: Path) -> Generator[Laboratory]:
    """Open a laboratory and close it."""
    opened = Laboratory(drawn, data)
    try:
        yield opened
    finally:
        opened.close()


def bench_of(drawn: Drawn) -> Bench:
    """Return the arm behind the bytes of the simulated instruments."""
    rig, arm = drawn.rig, cast(Any, drawn.arm)
    assert rig.simulation is not None
    fitted: dict[str, Fitted] = {}
    for table, driver in (("sensor", rig.sensor.driver), ("output", rig.output.driver)):
        found = simulated_driver(driver)
        assert found is not None
        setting = Setting(
            rig, rig.simulation, arm, arm.measure_um, arm.put_out, lambda _table, one: one, {}
        )
        fitted |= found.fit(setting, frozenset({table}))
    return Bench(arm, fitted)
