"""Grips of a simulated rig whose part slips, or whose sensor jumps, in one process."""

from dataclasses import dataclass

from pydantic import TypeAdapter

from pincette.config import RigFile
from pincette.core.messages import Applied, Command, Estimate, GroundTruth, Message, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned
from tests.support.rigs import Tree, demo_rig

REQUEST = TypeAdapter(Body)


@dataclass(frozen=True, slots=True)
class Played:
    """Outcome of a job."""

    planned: Planned
    rig: RigFile
    messages: list[Message]

    @property
    def views(self) -> list[Telemetry]:
        return [one for one in self.messages if isinstance(one, Telemetry)]

    @property
    def estimates(self) -> dict[int, Estimate]:
        return {one.seq: one for one in self.messages if isinstance(one, Estimate)}

    @property
    def commands(self) -> dict[int, Command]:
        return {one.seq: one for one in self.messages if isinstance(one, Command)}

    @property
    def applied(self) -> list[Applied]:
        return [one for one in self.messages if isinstance(one, Applied)]

    @property
    def truths(self) -> dict[int, GroundTruth]:
        return {one.seq: one for one in self.messages if isinstance(one, GroundTruth)}

    @property
    def outcome(self) -> str:
        return str(self.views[-1].outcome)

    @property
    def phases(self) -> list[str]:
        return list(dict.fromkeys(view.phase for view in self.views))

    @property
    def peak_mN(self) -> float:
        return max(one.arms[0].force_mN for one in self.truths.values())


def played(simulation: Tree | None = None, changes: Tree | None = None, **wishes: object) -> Played:
    """Play a grip, or another kind of job, on the demo rig."""
    tree: Tree = {**(changes or {}), "simulation": simulation or {}}
    rig = demo_rig(tree, time="lockstep")
    grip = {"kind": "grip", "force_mN": 20.0, "hold_s": 1.0}
    request = REQUEST.validate_python(wishes if "kind" in wishes else {**grip, **wishes})
    planned = plan_job(request, rig)
    assert planned.plan.violations == []
    program = planned.program
    messages = ComposedLoop(rig).play(program)
    return Played(planned, rig, messages)
