"""A part is gripped and then released on a simulated rig in one process, in virtual time."""

from dataclasses import dataclass

import numpy as np

from pincette.api.results import ClosedLoopResult, ReleaseVerdict
from pincette.config import RigFile
from pincette.core.faults import ActionCode
from pincette.core.messages import (
    Action,
    Applied,
    GroundTruth,
    Message,
    Position,
    Reset,
    Sample,
    Telemetry,
)
from pincette.core.topics import ACTION, RESET, TOPICS, Topic
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import ReleaseJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned, Present
from pincette_supervisor.results.archive import Record, Take, gather
from tests.support.rigs import Tree, demo_rig

STRATEGIES = ("retreat", "fast", "dither", "wait")
KEPT_TICKS, PAUSED_TICKS = 100, 40


@dataclass(frozen=True, slots=True)
class Released:
    """Outcome of a release."""

    record: Record
    messages: list[Message]
    free: bool
    """True if the part pulls on no arm at the end, by the simulation."""

    @property
    def stated(self) -> ReleaseVerdict | None:
        """Stated verdict; None if there is none, as after a trip."""
        found = getattr(self.record.result, "release", None)
        assert found is None or isinstance(found, ReleaseVerdict)
        return found

    @property
    def verdict(self) -> ReleaseVerdict:
        assert self.stated is not None
        return self.stated

    @property
    def result(self) -> ClosedLoopResult:
        assert isinstance(self.record.result, ClosedLoopResult)
        return self.record.result

    @property
    def pull_off_mN(self) -> float:
        """Largest true pull on the first arm."""
        truths = [one for one in self.messages if isinstance(one, GroundTruth)]
        return -min(one.arms[0].force_mN for one in truths)


class Bench:
    """A rig on which a part is gripped, kept and released."""

    def __init__(self, rig: RigFile) -> None:
        self.rig, self.loop, self.epoch = rig, ComposedLoop(rig), 0
        self.heard: list[Message] = []
        self.newest: dict[type[Message], Message] = {}
        self.requests: dict[tuple[str, int], str] = {}
        """Actions to request once, by phase and its tick; a pause is resumed after some ticks."""
        self.paused = 0
        for topic in TOPICS:
            self.loop.bus.subscribe(topic, self._hear)
        self.loop.bus.call(RESET, Reset(acknowledge=True))

    def _hear(self, _topic: Topic, message: Message) -> None:
        self.heard.append(message)
        self.newest[type(message)] = message
        if not (isinstance(message, Telemetry) and message.playing):
            return
        self.paused = self.paused + 1 if message.paused else 0
        action = self.requests.pop((message.phase, message.segment_tick), "")
        if self.paused == PAUSED_TICKS:
            action = "resume"
        if action:
            self.loop.bus.call(ACTION, Action(ActionCode(action)))

    def grip(self, force_mN: float, hold_s: float | None = None) -> Released:
        """Grip; without ``hold_s`` the part is kept."""
        kept = hold_s is None
        if kept:
            self.requests["hold", KEPT_TICKS] = "keep"
        request = GripJobRequest(kind="grip", force_mN=force_mN, hold_s=hold_s, until_released=kept)
        return self._played(plan_job(request, self.rig, None))

    def release(self, **wishes: object) -> Released:
        """Release the kept part."""
        request = ReleaseJobRequest.model_validate({"kind": "release", **wishes})
        applied, position = self.newest[Applied], self.newest[Position]
        assert isinstance(applied, Applied)
        assert isinstance(position, Position)
        present = Present(
            applied.arms[0].voltage_V,
            position.arms[0].x_um,
            applied.part_held,
            second_V=applied.arms[-1].voltage_V,
            second_um=position.arms[-1].x_um,
        )
        planned = plan_job(request, self.rig, present)
        assert planned.plan.violations == []
        return self._played(planned)

    def _played(self, planned: Planned) -> Released:
        self.heard.clear()
        self.epoch += 1
        arm(self.loop.bus, planned.program, epoch=self.epoch, digest=self.rig.digest())
        while self.loop.bus.pump():
            pass
        samples = [one for one in self.heard if not isinstance(one, Sample) or one.seq >= 0]
        row = JobRow("job", planned.plan.kind, self.rig.rig.name, "running", {}, {}, "")
        record = gather(self.rig, row, planned, Take(self.epoch, samples))
        truth = self.newest[GroundTruth]
        assert isinstance(truth, GroundTruth)
        return Released(record, samples, all(one.force_mN == 0.0 for one in truth.arms))


def adhesive_rig(part: Tree | None = None, simulation: Tree | None = None) -> RigFile:
    """Return the demo rig with a part that sticks to the arm."""
    return demo_rig({"simulation": {**(simulation or {}), "part": part or {}}}, time="lockstep")


def random_part(seed: int) -> tuple[RigFile, float, list[str]]:
    """Draw a rig with a part that clings, a force of the grip and strategies, from the seed alone.

    sensor noise, µm r.m.s.        0.015     0.05      instruments
    contact, µm beside the plan    -2        2         assumed
    stiffness, of the plan         0.8       1.2       random_rigs
    adhesion w, J/m²               0.05      0.1       instruments
    roughness                      0         1         assumed
    liquid, pL, of every second    0.01      10        condensed from humid air, or a small drop
    ageing, per decade             0         0.3       Bocquet 1998: a log of time
    bond, mN, of every second      0         100       from none to more than any pull
    """
    chance = np.random.default_rng((0x53, seed))

    def draw(low: float, high: float) -> float:
        return float(chance.uniform(low, high))

    def magnitude(low: float, high: float) -> float:
        return float(np.exp(draw(np.log(low), np.log(high))))

    noise_um = draw(0.015, 0.05)
    part: Tree = {
        "adhesion_J_per_m2": draw(0.05, 0.1),
        "roughness": draw(0.0, 1.0),
        "ageing_per_decade": draw(0.0, 0.3),
    }
    if chance.random() < 0.5:
        part |= {"liquid_um3": magnitude(10.0, 10_000.0), "wetting": draw(0.5, 1.0)}
    if chance.random() < 0.5:
        bond_mN = draw(0.0, 100.0)
        part |= {"bond_mN": bond_mN, "bond_scale_mN": 0.1 * bond_mN}
    simulation: Tree = {
        "seed": seed,
        "sensor_noise_um": noise_um,
        "bead_contact_um": 30.0 + draw(-2.0, 2.0),
        "environment_stiffness_mN_per_um": 2.17 * draw(0.8, 1.2),
        "part": part,
    }
    rig = demo_rig({"sensor": {"noise_um": noise_um}, "simulation": simulation}, time="lockstep")
    order = [str(each) for each in chance.permutation(STRATEGIES)]
    return rig, draw(8.0, 20.0), order[: 1 + int(chance.integers(len(STRATEGIES)))]
