"""What goes on without being asked: the state of the rig, its samples, and commands of the past."""

import asyncio
import logging
import time
from typing import Any
from uuid import UUID

from sila2.server import MetadataDict, SilaServer
from sila2.server.observables.observable_command_manager import ObservableCommandManager

from pincette.client import AsyncJobHandle, ClientError
from pincette_sila.callers import Callers
from pincette_sila.controllers import Pausing
from pincette_sila.features import command
from pincette_sila.gripper import FOLLOWERS, Gripper
from pincette_sila.motion import LABEL, Sample, known
from pincette_sila.second_arm import SecondArm

log = logging.getLogger("pincette.sila")
LOOK_S = 0.5
SAMPLE_S = 1.0 / 15.0
"""Between two samples that are told, at least."""
RETRY_S = 1.0
REMEMBERED = 20
"""Jobs that are looked through for commands of an earlier server."""
UNREACHABLE, UNKNOWN_PART = "unreachable", "unknown"


async def watch_rig(
    server: SilaServer, gripper: Gripper, callers: Callers, pausing: Pausing
) -> None:
    """Tell how the rig is whenever that changes, and resume commands once it answers."""
    told: tuple[str, list[str], str] | None = None
    resumed = False
    while True:
        try:
            rig = await callers.rig().state()
            now = (str(rig.latch.state), [] if rig.can_start else list(rig.reasons), str(rig.part))
            if not resumed:
                await resume(server, gripper, callers)
                resumed = True
            pausing.tell(
                [
                    str(execution)
                    for execution, job in list(gripper.jobs.items())
                    if (await job.refresh()).state == "paused"
                ]
            )
        except ClientError as error:
            now = (UNREACHABLE, [str(error)], UNKNOWN_PART)
        if now != told:
            if told is None or (now[0] == UNREACHABLE) != (told[0] == UNREACHABLE):
                words = now[1][0] if now[0] == UNREACHABLE else f"it answers, the rig is {now[0]}"
                log.info("supervisor: %s", words)
            gripper.tell(*now)
            told = now
        await asyncio.sleep(LOOK_S)


async def watch_samples(gripper: Gripper, callers: Callers, second: SecondArm | None) -> None:
    """Tell the newest whole sample of a motion, some times a second, and of a second arm too."""
    told_at_s = 0.0
    while True:
        try:
            async for one in callers.rig().live():
                if one.x_um is None or one.force_mN is None or one.voltage_V is None:
                    continue
                if time.monotonic() - told_at_s < SAMPLE_S:
                    continue
                told_at_s = time.monotonic()
                uncertainty_mN = known(one.force_uncertainty_mN)
                row = (one.x_um, one.force_mN, uncertainty_mN, one.voltage_V, one.phase == "hold")
                gripper.tell_sample(Sample(one.phase, *row))
                if second is not None:
                    second.tell(one)
        except ClientError:
            await asyncio.sleep(RETRY_S)


async def resume(server: SilaServer, gripper: Gripper, callers: Callers) -> None:
    """Make the commands of an earlier server known again, by the labels of their jobs."""
    found: dict[UUID, tuple[str, AsyncJobHandle]] = {}
    for job in await callers.rig().jobs(REMEMBERED):
        name, _, text = job.job.labels.get(LABEL, "").partition(" ")
        try:
            found.setdefault(UUID(text), (name, job))  # the newest of those that it has begun
        except ValueError:
            continue
    for execution, (name, job) in reversed(found.items()):
        if name in FOLLOWERS and execution not in gripper.managers()[name]:
            _resume(server, gripper, name, execution, job)


def _resume(
    server: SilaServer, gripper: Gripper, name: str, execution: UUID, job: AsyncJobHandle
) -> None:
    node = command(name)

    def follow(instance: Any) -> Any:
        # The instance was given an execution UUID of its own; the client knows the earlier one.
        found = gripper.resume(name, instance, job, execution)
        return node.responses.to_message(found)

    manager = ObservableCommandManager(server, node, follow, MetadataDict(server), None)
    manager.command_execution_uuid = execution
    gripper.managers()[name][execution] = manager
    log.info("command %s %s goes on with job %s", name, execution, job.id)
