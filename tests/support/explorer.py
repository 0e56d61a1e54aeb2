"""Random actions on a rig and its supervisor, at any time."""

import json
from typing import Any, Literal, get_args

from hypothesis import strategies as st
from hypothesis.stateful import initialize, precondition, rule
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.api.states import ActionType
from pincette.core.faults import ActionCode
from pincette.core.messages import Action
from pincette_supervisor.jobs.lease import lease_end
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.plugin import kind_of
from tests.support.explored import Explored

BODY: TypeAdapter[JobRequest] = TypeAdapter(Body)
ACTIONS: tuple[ActionType, ...] = get_args(ActionType)
LEAVES: tuple[ActionType, ...] = ("stop", "stop", "abort", "resume")
"""Actions that may end a pause."""
PLACES = st.integers(0, 110)
"""Ticks of a grip, up to the middle of its hold."""
RESTING = ("stopping", "stopped", "hold")
"""Phases of a stop in which nothing moves."""
TRIPPED = ("frozen", "latched")
POLICIES = st.fixed_dictionaries(
    {
        "on_stop": st.sampled_from(("hold", "release", "retract")),
        "on_abort": st.sampled_from(("freeze", "ramp")),
        "autostart": st.sampled_from((True, True, True, False)),
        "queue": st.booleans(),
    }
)
KINDS: tuple[dict[str, Any], ...] = (
    {"kind": "grip"},
    {"kind": "grip", "until_released": True},
    {"kind": "track", "shape": "step", "levels_mN": [4.0, 8.0], "dwell_s": 0.2},
    {"kind": "move", "by_um": 2.0},
    {"kind": "move", "to_V": 0.1},
    {"kind": "hold"},
    {"kind": "hold", "hold_s": 0.3},
    {"kind": "release", "release_s": 0.3},
)
Ending = Literal["estop", "end", "kill", "kill soon"]
Happening = tuple[str, str, float | None, float | None]
DISTURBANCES: tuple[Happening | Ending, ...] = (
    "estop",
    "end",
    "kill",
    "kill soon",
    ("part", "lose", None, None),
    ("part", "place", None, None),
    ("sensor", "over_range", 1.0, 0.3),
    ("sensor", "off", None, 0.3),
    ("sensor", "stuck", None, 0.4),
    ("output", "off", None, 0.3),
    ("output", "stuck", None, 0.4),
)


class Explorer(Explored):
    """Random actions of a person, on a rig that may fail and a supervisor that may die."""

    @initialize(kind=st.sampled_from(KINDS[:3]), policies=POLICIES, ticks=PLACES)
    def begin_with_a_part(self, kind: dict[str, Any], policies: dict[str, Any], ticks: int) -> None:
        self.begin(kind, policies, ticks)

    @precondition(lambda self: self.state() is None)
    @rule(kind=st.sampled_from(KINDS), policies=POLICIES, ticks=PLACES)
    def begin(self, kind: dict[str, Any], policies: dict[str, Any], ticks: int) -> None:
        """Start a job and let it run to a random tick."""
        self.create(kind, {**policies, "autostart": True})
        self.tried(lambda: self.office.steps.pass_(ticks))

    @rule(kind=st.sampled_from(KINDS), policies=POLICIES)
    def ask_for_a_job(self, kind: dict[str, Any], policies: dict[str, Any]) -> None:
        self.create(kind, policies)

    def create(self, kind: dict[str, Any], policies: dict[str, Any]) -> None:
        if kind["kind"] in ("move", "release"):
            policies = {name: policies[name] for name in ("autostart", "queue")}
        request = BODY.validate_json(json.dumps({**kind, **policies}))
        self.tried(lambda: self.office.manager.create(request))

    @precondition(lambda self: bool(self.rows()))
    @rule(action=st.sampled_from(ACTIONS), which=st.sampled_from((0, 0, 0, 1, 2)))
    def act(self, action: ActionType, which: int) -> None:
        rows = self.rows()
        self.ask(rows[min(which, len(rows) - 1)], action)

    @precondition(lambda self: self.state() == "running")
    @rule()
    def pause(self) -> None:
        """Pause at a useful moment, which random actions alone would rarely do."""
        self.ask(self.rows()[0], "pause")
        for _ in range(60):
            if self.state() == "pausing":
                self.tried(self.office.steps.pass_)

    @precondition(lambda self: self.state() == "paused")
    @rule(action=st.sampled_from(LEAVES))
    def leave_the_pause(self, action: ActionType) -> None:
        if action == "stop":
            self.stop_from_the_pause()
        else:
            self.ask(self.rows()[0], action)

    def stop_from_the_pause(self) -> None:
        """Request a stop; only the motion that ``on_stop`` states may begin."""
        office, live = self.office, self.office.manager.active
        assert live is not None
        job, held, policy = live.id, live.status.held, kind_of(live.request).stop_of(live.request)
        before, line = self.rig.telemetry[-1], office.line
        requested, stated = len(line.asked), len(self.rig.telemetry)
        applied = len(self.rig.applied)
        self.ask(self.row(job), "stop")
        self.pass_until_it_ends(job)
        if self.office is not office:  # killed meanwhile
            return
        acts = [request for request in line.asked[requested:] if isinstance(request, Action)]
        stop = Action(ActionCode(lease_end(live.request)))
        assert acts in ([], [stop])
        if self.row(job).state != "stopped":  # a fault occurred before it, or during it
            return
        assert acts == [stop]
        later = [reported for reported in self.rig.telemetry[stated:] if reported.playing]
        moves = {"hold": [], "release": ["unload"], "retract": ["unload", "retreat"]}[policy]
        begun = [move for move in moves if held or move != "unload"]
        if any(action.type == "release" for action in self.row(job).actions):
            begun.append("unload")  # requested in the pause, it may have begun before the stop
        assert {reported.phase for reported in later if not reported.paused} <= {*RESTING, *begun}
        if not begun:
            references = {
                (reported.arms[0].x_r_um, reported.force_r_mN) for reported in (before, *later)
            }
            put_out = {echo.arms[0].voltage_V for echo in self.rig.applied[applied - 1 :]}
            # Without a law x_r is the arm's position, and the voltage itself stays.
            assert len(references) == 1 or len(put_out) == 1

    @rule(ticks=st.sampled_from((1, 2, 5, 20, 60)))
    def let_time_pass(self, ticks: int) -> None:
        self.tried(lambda: self.office.steps.pass_(ticks))

    @rule(which=st.sampled_from(DISTURBANCES), writes=st.integers(0, 6))
    def disturb(self, which: Happening | Ending, writes: int) -> None:
        """Cause a fault, an emergency stop, or the supervisor's end: at once or after some
        writes."""
        match which:
            case "estop":
                self.tried(lambda: self.office.manager.latch.estop("test"))
            case "end" | "kill":
                self.restart(in_order=which == "end")
            case "kill soon":
                self.office.store.writes_left = writes
            case _:
                self.rig.order(*which)

    @precondition(lambda self: self.rig.applied and self.rig.applied[-1].state in TRIPPED)
    @rule()
    def reset(self) -> None:
        self.tried(lambda: self.office.manager.latch.reset("test"))

    @precondition(lambda self: len(self.office.manager.queue) > 0)
    @rule(order=st.sampled_from(("resume", "resume", "clear")))
    def order_queue(self, order: Any) -> None:
        self.tried(lambda: self.office.manager.control_queue(order, "test"))
