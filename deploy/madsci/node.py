"""A rig as a node of MADSci: ``python node.py``, in an environment of its own."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from uuid import uuid4

from madsci.common.types.action_types import ActionFailed, ActionResult, ActionSucceeded
from madsci.common.types.admin_command_types import AdminCommandResponse
from madsci.common.types.base_types import Error
from madsci.common.types.node_types import RestNodeConfig
from madsci.node_module.helpers import action
from madsci.node_module.rest_node_module import RestNode

from pincette.api.jobs import Progress
from pincette.client import (
    ClientError,
    JobHandle,
    ProblemError,
    RigHandle,
    RigLatchedEndError,
    Supervisor,
    require_feasible,
)

LABEL = "madsci"


class GripperConfig(RestNodeConfig):
    """Where the supervisor is; each is an environment variable, such as NODE_SUPERVISOR_URL."""

    supervisor_url: str = "http://127.0.0.1:8000"
    supervisor_key: str | None = None
    supervisor_authority: Path | None = None
    """Certificate that is believed where the supervisor speaks TLS: its ``authority.crt``."""
    rig: str | None = None
    enable_rate_limiting: bool = False
    """As shipped, MADSci would refuse a safety stop after 100 requests of a minute."""


class Gripper(RestNode):
    """Grips and lets go; a refusal fails the action, and the node takes the next one."""

    config: GripperConfig = GripperConfig()
    config_model = GripperConfig

    def startup_handler(self) -> None:
        """Prepare the client; the supervisor may come later."""
        config = self.config
        self._supervisor = Supervisor(
            config.supervisor_url,
            key=config.supervisor_key or None,
            operator=LABEL,
            authority=config.supervisor_authority,
        )
        self._keys: set[str] = set()

    def state_handler(self) -> None:
        """How the rig is, again and again."""
        try:
            state = self._rig().state()
        except ClientError as error:
            self.node_state = {"state": "unreachable", "reasons": [str(error)]}
            return
        newest = state.newest
        self.node_state = {
            "state": state.latch.state,
            "part": state.part,
            "job": state.active_job,
            "reasons": [] if state.can_start else state.reasons,
            "force_mN": None if newest is None else newest.force_mN,
            "second_force_mN": None if newest is None else newest.second_force_mN,
        }

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
        """Grip; ends when the part is held, and it stays held until release."""
        key = uuid4().hex
        self._keys.add(key)
        try:
            rig, labels = self._rig(), {LABEL: self.node_info.node_name}
            wanted: dict[str, Any] = {"force_mN": force_mN, "until_released": True}
            job = rig.start("grip", idempotency_key=key, labels=labels, **wanted)
            now = last(job.to_hold())
        except ClientError as error:
            return failed(error)
        finally:
            self._keys.discard(key)
        held_mN = None if now is None else now.force_held_mN
        return ActionSucceeded(json_result={"job": job.id, "force_held_mN": held_mN})

    @action
    def release(self) -> ActionResult:
        """Let go of what is held, also of what an earlier node has gripped."""
        try:
            job: JobHandle = self._rig().let_go()
            last(job.to_release())
        except ClientError as error:
            return failed(error)
        return ActionSucceeded(json_result={"job": job.id})

    def cancel(self) -> AdminCommandResponse:
        """Bring a motion to rest, also one that is being planned; a held part stays held."""

        def stop() -> None:
            rig = self._rig()
            for key in list(self._keys):
                rig.stop(key)

        return done(stop)

    def safety_stop(self) -> AdminCommandResponse:
        """Stop at once and latch. There is no reset here: a person must look first."""

        def stop() -> str:
            found = self._supervisor.patient(0.0).rig(self.config.rig).estop()
            return "" if found.acknowledged else found.detail or found.cause

        return done(stop)

    def _rig(self) -> RigHandle:
        return self._supervisor.rig(self.config.rig)


def last(moments: Iterable[Progress]) -> Progress | None:
    """Follow a motion to its end."""
    found = None
    for now in moments:
        found = now
    return found


def failed(error: ClientError) -> ActionFailed:
    """The action fails with the problem's code; to raise it would put the node out of use."""
    return ActionFailed(errors=[error_of(error)])


def done(command: Callable[[], str | None]) -> AdminCommandResponse:
    """What comes of an admin command, which must not raise either; a text says why it failed."""
    try:
        trouble = command()
    except ClientError as error:
        return AdminCommandResponse(success=False, errors=[error_of(error)])
    errors = [Error(message=trouble, error_type="not-confirmed")] if trouble else []
    return AdminCommandResponse(success=not trouble, errors=errors)


def error_of(error: ClientError) -> Error:
    """An error in words of MADSci."""
    code = error.code if isinstance(error, ProblemError) else ""
    if isinstance(error, RigLatchedEndError):
        code = "rig-latched"
    return Error(message=str(error), error_type=code or type(error).__name__)


if __name__ == "__main__":
    Gripper().start_node()
