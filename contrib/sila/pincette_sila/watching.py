"""Background tasks: read the state of the rig and its samples, and restore the commands of an
earlier server.
"""

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
from pincette_sila.gripper import MOVING, Gripper
from pincette_sila.motion import LABEL, Sample, known
from pincette_sila.second_arm import SecondArm

log = logging.getLogger("pincette.sila")
LOOK_S = 0.25
"""Pause between two readings of the rig, in s."""
PUBLISH_S = 0.05
"""Interval at which the age of the newest reading is checked, in s."""
SAMPLE_S = 1.0 / 15.0
"""Least time between two published samples, in s."""
RETRY_S = 1.0
REMEMBERED = 20
"""Number of newest jobs that are searched for commands of an earlier server."""


async def watch_rig(
    server: SilaServer, gripper: Gripper, callers: Callers, pausing: Pausing
) -> None:
    """Publish the state of the rig when it changes, and restore commands once the rig replies."""
    reading = asyncio.create_task(_read(server, gripper, callers, pausing))
    try:
        while not reading.done():
            gripper.publish()
            await asyncio.sleep(PUBLISH_S)
        reading.result()
    finally:
        reading.cancel()


async def _read(server: SilaServer, gripper: Gripper, callers: Callers, pausing: Pausing) -> None:
    """Read the state of the rig and its paused commands repeatedly."""
    while True:
        status = await gripper.watch.read()
        try:
            if gripper.unresumed is not None and status.state != "unknown":
                await resume(server, gripper, callers)
                gripper.unresumed = None
            jobs = list(gripper.jobs.items())
            states = [(str(one), (await job.patient(0.0).refresh()).state) for one, job in jobs]
            pausing.tell([execution for execution, state in states if state == "paused"])
        except ClientError as error:
            log.debug("supervisor: %s", error)  # the next reading shows it
            if gripper.unresumed is not None:
                gripper.unresumed = str(error)
        await asyncio.sleep(LOOK_S)


async def watch_samples(gripper: Gripper, callers: Callers, second: SecondArm | None) -> None:
    """Publish the newest complete sample of a motion, several times a second, for each arm."""
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
    """Restore the commands of an earlier server from the labels of their jobs."""
    found: dict[UUID, tuple[str, AsyncJobHandle]] = {}
    for job in await callers.rig().jobs(REMEMBERED):
        name, _, text = job.job.labels.get(LABEL, "").partition(" ")
        try:
            found.setdefault(UUID(text), (name, job))  # the newest job of a command comes first
        except ValueError:
            continue
    for execution, (name, job) in reversed(found.items()):
        if name in MOVING and execution not in gripper.managers()[name]:
            _resume(server, gripper, name, execution, job)


def _resume(
    server: SilaServer, gripper: Gripper, name: str, execution: UUID, job: AsyncJobHandle
) -> None:
    node = command(name)

    def follow(instance: Any) -> Any:
        # The restored command got a new execution UUID, but the client knows the earlier one.
        found = gripper.resume(name, instance, job, execution)
        return node.responses.to_message(found)

    manager = ObservableCommandManager(server, node, follow, MetadataDict(server), None)
    manager.command_execution_uuid = execution
    gripper.managers()[name][execution] = manager
    log.info("command %s %s continues with job %s", name, execution, job.id)
