"""Rig as a node of MADSci, in an environment without pincette itself."""
# pyright: basic, reportMissingImports=false

from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

from madsci.common.types.action_types import (
    ActionCancelled,
    ActionFailed,
    ActionResult,
    ActionSucceeded,
)
from madsci.common.types.admin_command_types import AdminCommandResponse
from madsci.common.types.base_types import Error
from madsci.common.types.node_types import NodeStatus, RestNodeConfig
from madsci.node_module.helpers import action
from madsci.node_module.rest_node_module import RestNode
from pydantic import computed_field

from pincette.api.jobs import Progress
from pincette.client import (
    ClientError,
    JobHandle,
    RigHandle,
    RigStatus,
    Supervisor,
    require_feasible,
)
from pincette.client.status import NEWS_S, unknown_status

LABEL = "madsci"


class GripperConfig(RestNodeConfig):
    """Address of the supervisor; each field is an environment variable, as NODE_SUPERVISOR_URL."""

    supervisor_url: str = "http://127.0.0.1:8000"
    supervisor_key: str | None = None
    supervisor_authority: Path | None = None
    """Trusted certificate of a supervisor that uses TLS: its ``authority.crt``."""
    rig: str | None = None
    status_update_interval: float = 0.5
    """Interval between two readings of the status, in s. MADSci accepts or rejects actions
    according to the last one.
    """
    state_update_interval: float = 0.5
    enable_rate_limiting: bool = False
    """False, since MADSci would otherwise reject a safety stop after 100 requests in a minute."""


class GripperStatus(NodeStatus):
    """Status of the node; its description states why the rig is not ready."""

    _reasons: tuple[str, ...] = ()

    @computed_field
    @property
    def description(self) -> str:
        """Return why the node is not ready. MADSci's own text does not mention that the rig is
        stopped.
        """
        own = super().description
        if not (self.stopped or self.disconnected):
            return own
        return "; ".join([*(() if own == "Node is ready" else (own,)), *self._reasons])

    def update(self, rig: RigStatus) -> None:
        """Set the fields that follow from the state of the rig."""
        self._reasons = tuple(rig.reasons)
        self.disconnected = rig.state == "unknown"
        self.stopped = not (rig.ready or self.disconnected)


class Gripper(RestNode):
    """Node that grips and releases; a rejected request makes only its own action fail."""

    node_status: GripperStatus = GripperStatus(initializing=True)
    config: GripperConfig = GripperConfig()
    config_model = GripperConfig

    def startup_handler(self) -> None:
        """Prepare the client; the supervisor may start later."""
        config = self.config
        self._supervisor = Supervisor(
            config.supervisor_url,
            key=config.supervisor_key or None,
            operator=LABEL,
            authority=config.supervisor_authority,
        )
        self._actions: dict[str, JobHandle | None] = {}
        """Jobs of the running actions by their keys; None before an action has a job."""

    def status_handler(self) -> None:
        """Update whether the node is ready; MADSci calls this repeatedly."""
        self.node_status.update(self._rig_status())

    def state_handler(self) -> None:
        """Update the state of the rig; MADSci calls this repeatedly."""
        found = self._rig_status()
        self.node_status.update(found)
        newest = found.newest
        self.node_state = {
            "state": found.state,
            "age_s": found.age_s,
            "part": found.part,
            "ready": found.ready,
            "job": found.job,
            "reasons": found.reasons,
            "force_mN": None if newest is None else newest.force_mN,
            "second_force_mN": None if newest is None else newest.second_force_mN,
        }

    def get_status(self) -> NodeStatus:
        """Read and return the present status of the node instead of the stored one."""
        self._update_status()
        return self.node_status

    def get_state(self) -> dict[str, Any]:
        """Read and return the present state of the rig instead of the stored one."""
        self._update_state()
        return self.node_state

    @action
    def plan(self, force_mN: float) -> ActionResult:
        """Predict a grip; nothing moves."""
        try:
            found = require_feasible(self._rig().plan("grip", force_mN=force_mN))
        except ClientError as error:
            return failed(error)
        return ActionSucceeded(json_result={"duration_s": found.duration_s})

    @action
    def grip(self, force_mN: float) -> ActionResult:
        """Grip a part. The action ends when the part is held; it stays held until it is released.

        A part that this node holds is loaded or unloaded to the force without being released; a
        part that already has this force stays unchanged.
        """
        key = uuid4().hex
        with self._noted(key):
            try:
                rig, labels = self._rig(), {LABEL: self.node_info.node_name}
                own = (LABEL, self.node_info.node_name)
                job, now = rig.reach(force_mN, own=own, idempotency_key=key, labels=labels)
                if now is not None:
                    return gripped(job, now)
                self._actions[key] = job
                now = last(job.to_hold())
            except ClientError as error:
                return failed(error)
        return gripped(job, now)

    @action
    def release(self) -> ActionResult:
        """Release the held part, even if an earlier node gripped it."""
        key = uuid4().hex
        with self._noted(key):
            try:
                job = self._actions[key] = self._rig().let_go(key)
                last(job.to_release())
            except ClientError as error:
                return failed(error)
        return ActionSucceeded(json_result={"job": job.id})

    def cancel(self) -> AdminCommandResponse:
        """Stop a motion, even while it is being planned; a held part stays held."""

        def stop() -> None:
            for key, job in list(self._actions.items()):
                # Stop it by its key first: this also stops a request that has no job yet.
                if self._supervisor.stop(key) is None and job is not None:
                    job.stop()

        return done(stop)

    def safety_stop(self) -> AdminCommandResponse:
        """Stop at once and latch. There is no reset here: a person must inspect the rig first."""

        def stop() -> str:
            found = self._supervisor.patient(0.0).rig(self.config.rig).estop()
            return "" if found.acknowledged else found.detail or found.cause

        return done(stop)

    @contextmanager
    def _noted(self, key: str) -> Generator[None]:
        self._actions[key] = None
        try:
            yield
        finally:
            del self._actions[key]

    def _rig(self) -> RigHandle:
        return self._supervisor.rig(self.config.rig)

    def _rig_status(self) -> RigStatus:
        """Return the state of the rig; unknown if no reply comes within 1 s."""
        try:
            return self._supervisor.patient(0.0).within(NEWS_S).rig(self.config.rig).status()
        except ClientError as error:
            return unknown_status(str(error))


def gripped(job: JobHandle, now: Progress | None) -> ActionResult:
    """Return the result of a grip that holds its part, with the settled force if there is one."""
    held_mN = None if now is None else now.force_held_mN
    if held_mN is None and now is not None:
        held_mN = now.force_mN
    return ActionSucceeded(json_result={"job": job.id, "force_held_mN": held_mN})


def last(moments: Iterable[Progress]) -> Progress | None:
    """Follow a motion to its end, and return its last state."""
    found = None
    for now in moments:
        found = now
    return found


def failed(error: ClientError) -> ActionResult:
    """Return the result of an action that failed, with the codes of the error.

    The status of a stopped action is "cancelled". The error is returned and not raised, since an
    exception would make the node unusable.
    """
    kind = ActionCancelled if error.cancelled else ActionFailed
    return kind(errors=[error_of(error)], json_result=error.codes)


def done(command: Callable[[], str | None]) -> AdminCommandResponse:
    """Run an admin command and return its result; client errors are returned, not raised.
    ``command`` returns the text of an error, or None.
    """
    try:
        trouble = command()
    except ClientError as error:
        return AdminCommandResponse(success=False, errors=[error_of(error)])
    errors = [Error(message=trouble, error_type="not-confirmed")] if trouble else []
    return AdminCommandResponse(success=not trouble, errors=errors)


def error_of(error: ClientError) -> Error:
    """Return an error in the form of MADSci."""
    return Error(message=str(error), error_type=error.code)
