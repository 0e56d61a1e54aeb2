"""Rigs over REST: state, emergency stop, reset, queue, model, live samples, simulation."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import asdict
from time import time
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query
from fastapi.sse import EventSourceResponse

from pincette.api.access import Claim, ClaimRequest
from pincette.api.checklist import Checklist
from pincette.api.history import History
from pincette.api.live import LiveBatch, LiveList, LoopTiming
from pincette.api.models import ModelAction, ModelView
from pincette.api.places import PlaceList
from pincette.api.problems import responses
from pincette.api.rigs import QueueRequest, ResetRequest, Rig, RigList, Stopped, StoppedList
from pincette.api.simulation import SimulationCommand, SimulationOperation, SimulationOperationList
from pincette.bus.protocol import BusError, RefusalError
from pincette.config.script import OPERATIONS, Operation, objection, operation_of
from pincette.core.faults import Cause
from pincette.core.messages import SimCommand
from pincette.core.topics import SIM_COMMAND
from pincette_supervisor.fleet.rig_view import rig_view
from pincette_supervisor.jobs.bring_up import checklist, model_view
from pincette_supervisor.jobs.bring_up import use_model as change_model
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.refusals import require_job
from pincette_supervisor.journal.events import TooManyListenersError
from pincette_supervisor.problems import ProblemError, not_found, unanswered
from pincette_supervisor.rest.dependencies import (
    ADMIN,
    CLAIM_TOKEN,
    LARGEST,
    OBSERVE,
    OPERATE,
    AccessState,
    AllRigs,
    AnyCaller,
    Asking,
    Journal,
    Manager,
    Note,
    Operator,
    Permitted,
    Sender,
    SupervisorId,
)
from pincette_supervisor.rest.routes_jobs import ACTION_THREADS
from pincette_supervisor.rest.strict_route import StrictRoute
from pincette_supervisor.rigs.health import loop_timing
from pincette_supervisor.rigs.latch import unconfirmed
from pincette_supervisor.rigs.live import LISTENERS_MAX, LiveCursor
from pincette_supervisor.rigs.standing import standing

LIVE_INTERVAL_S = 1.0 / 15.0
"""Interval between two live events, in s."""
KEEP_ALIVE_S = 1.0
"""Longest interval between two live events, in s, so that a listener knows that the connection
works."""

router = APIRouter(tags=["rigs"], route_class=StrictRoute)


@router.post("/estop")
async def estop_all(rigs: AllRigs, by: Sender, supervisor: SupervisorId) -> StoppedList:
    """Stop every rig at once; see the stop of one rig. 503 if a rig has not confirmed.

    Rigs that are not served are stopped too. A liveliness token alone is
    not a rig: it is ignored if no program on the bus accepts the stop of its actuator.
    """
    managers = rigs.all()
    stops = [asyncio.ensure_future(manager.latch.stopped(by)) for manager in managers]
    others = asyncio.ensure_future(rigs.stop_unserved())
    answers = await asyncio.gather(*stops, return_exceptions=True)
    unserved = await others
    named = list(zip([one.name for one in managers], answers, strict=True))
    stopped = [answer for _, answer in named if isinstance(answer, Stopped)]
    silent = {name: str(answer) for name, answer in named if not isinstance(answer, Stopped)}
    stopped += [_stopped(rig) for rig in sorted(unserved.confirmed)]
    stopped = [_signed(answer, supervisor) for answer in stopped]
    silent |= {
        rig: f"{rig}: {why}" for rig, why in unserved.missed.items() if rig not in unserved.absent
    }
    if silent:
        raise ProblemError(
            503,
            "estop-unconfirmed",
            "Not every rig has confirmed the emergency stop",
            "; ".join(silent.values()),
            stopped=[answer.rig for answer in stopped],
            unconfirmed=list(silent),
            reasons=list(silent.values()),
        )
    return StoppedList(rigs=stopped, supervisor=supervisor)


def _signed(stopped: Stopped, supervisor: str) -> Stopped:
    return stopped.model_copy(update={"supervisor": supervisor})


def _stopped(rig: str) -> Stopped:
    return Stopped(rig=rig, cause=Cause.ESTOP.value, acknowledged=True, detail="")


@router.get("/rigs", dependencies=[OBSERVE])
def every_rig(rigs: AllRigs) -> RigList:
    """Return the rigs that this supervisor serves, its own first."""
    return RigList(rigs=rigs.map(rig_view))


@router.get("/rigs/{rig}", responses=responses(404), dependencies=[OBSERVE])
def rig_state(manager: Manager) -> Rig:
    """Return one rig: programs, interlocks, limits, latch, and whether a job can start."""
    return rig_view(manager)


@router.post("/rigs/{rig}/estop", responses=responses(404))
async def estop(rig: str, rigs: AllRigs, by: Sender, supervisor: SupervisorId) -> Stopped:
    """Stop at once: freeze a held part, ramp a free arm, latch.

    Needs no key and no body; never rejected.

    Every spelling of the path is accepted: repeated or trailing slashes and upper case too.
    """
    if rigs.find(rig) is not None or rig not in rigs.unusable:
        return _signed(await rigs.get(rig).latch.stopped(by), supervisor)
    unserved = await rigs.stop_unserved(rig)
    if rig not in unserved.confirmed:
        raise unconfirmed(unserved.missed.get(rig, "its programs have stopped"))
    return _signed(_stopped(rig), supervisor)


@router.post("/rigs/{rig}/reset", responses=responses(404, 409), dependencies=[OPERATE])
async def reset(
    manager: Manager, _body: ResetRequest, asker: Asking, supervisor: SupervisorId
) -> Stopped:
    """Clear the latch after a person has seen the cause; a held part stays held."""

    def perform() -> Stopped:
        manager.claims.require(asker.claim)
        return manager.latch.reset(asker.by)

    loop = asyncio.get_running_loop()
    return _signed(await loop.run_in_executor(ACTION_THREADS, perform), supervisor)


@router.put("/rigs/{rig}/claim", responses=responses(404, 409), dependencies=[OPERATE])
def claim(
    manager: Manager,
    body: ClaimRequest,
    by: Operator,
    note: Note,
    x_claim: Annotated[
        str,
        Header(
            description="a secret of at least 16 characters chosen by the caller; sending it again "
            "renews the claim; other requests that send it may use the claimed rig",
            pattern=CLAIM_TOKEN,
        ),
    ],
) -> Claim:
    """Claim the rig, or renew the claim: others cannot start anything on it, but anyone can stop
    it.
    """
    note(f"{body.lease_s:g} s {body.note}".strip())
    return manager.claims.take(x_claim, by=by, note=body.note, lease_s=body.lease_s)


@router.delete("/rigs/{rig}/claim", responses=responses(404, 409), dependencies=[OPERATE])
def give_back(
    manager: Manager,
    asker: Asking,
    force: Annotated[bool, Query(description="break the claim of another client")] = False,
) -> Rig:
    """End the caller's claim, or with ``force`` that of another caller; an event states who ended
    it.
    """
    asker.note("broken" if force else "returned")
    manager.claims.give_back(asker.claim, by=asker.by, force=force)
    return rig_view(manager)


@router.post(
    "/rigs/{rig}/queue/actions",
    responses=responses(404, 409),
    dependencies=[OPERATE],
)
def order_queue(manager: Manager, body: QueueRequest, asker: Asking) -> Rig:
    """Resume a halted queue, stop all waiting jobs, or move one of them."""
    asker.note(body.type if body.job is None else f"{body.type} {body.job} to {body.position}")
    if body.type != "clear":
        manager.claims.require(asker.claim)
    manager.control_queue(body.type, asker.by, (body.job or "", body.position))
    return rig_view(manager)


@router.get("/rigs/{rig}/places", responses=responses(404), dependencies=[OBSERVE])
def places(manager: Manager) -> PlaceList:
    """Return the newest place of each vision client, and the mean error of its places over jobs."""
    return manager.places.view()


@router.get("/rigs/{rig}/timing", responses=responses(404), dependencies=[OBSERVE])
def timing(manager: Manager) -> LoopTiming:
    """Return the timing of the programs of the loop since they were armed."""
    return loop_timing(manager.context.bus)


@router.get("/rigs/{rig}/model", responses=responses(404), dependencies=[OBSERVE])
def model(manager: Manager) -> ModelView:
    """Return the model in use: every quantity that can be calibrated, and the existing versions."""
    return model_view(manager.context.model)


@router.get("/rigs/{rig}/checklist", responses=responses(404), dependencies=[OBSERVE])
def calibration_checklist(manager: Manager) -> Checklist:
    """Return the calibrations in their order: what each needs and has found, and which is next."""
    return checklist(manager.context.model, manager.calibrations)


@router.post(
    "/rigs/{rig}/model/actions",
    responses=responses(404, 409),
    dependencies=[ADMIN],
)
def use_model(manager: Manager, body: ModelAction, asker: Asking) -> ModelView:
    """Use an earlier version of the model, or with 0 the rig file alone."""
    asker.note(f"{body.type} {body.version}")
    manager.claims.require(asker.claim)
    with manager.free():
        return change_model(manager.context.model, body.version)


@router.get("/rigs/{rig}/history", responses=responses(404), dependencies=[OBSERVE])
def history(
    manager: Manager,
    store: Journal,
    hours: Annotated[float, Query(gt=0.0, le=168.0, description="how far back")] = 1.0,
    to_s: Annotated[
        float | None,
        Query(ge=0.0, le=4e9, description="end of the window, in seconds since 1970; default: now"),
    ] = None,
    points: Annotated[int, Query(ge=10, le=2000, description="most stretches of time")] = 600,
    job: Annotated[
        str | None,
        Query(
            max_length=80,
            description=(
                "read the record of this job alone, from its start, with times from its start"
            ),
        ),
    ] = None,
) -> History:
    """Return curves of the rig over some hours, from the records of its jobs; empty between
    jobs.
    """
    if job is not None:
        row = require_job(store, job)
        if row.rig != manager.name:
            raise not_found("job", job)
        return manager.context.history.read_job(row, points)
    until_s = time() if to_s is None else to_s
    return manager.context.history.read(store, until_s - 3600.0 * hours, until_s, points)


@router.get("/rigs/{rig}/samples", responses=responses(404), dependencies=[OBSERVE])
async def newest_samples(
    manager: Manager,
    after: Annotated[
        int | None,
        Query(ge=0, le=LARGEST, description="`next` of the last reply; default: the last minute"),
    ] = None,
) -> LiveList:
    """Return samples in batches, as in the stream, for a client that holds no connection."""
    cursor = manager.context.live.since(after)
    state = standing(manager.context)
    batches = [
        batch.model_copy(update={"standing": state}) for batch in cursor.batches(KEEP_ALIVE_S)
    ]
    return LiveList(batches=batches, next=cursor.place)


async def _live_cursor(
    manager: Manager, caller: AnyCaller, access: AccessState
) -> AsyncIterator[LiveCursor]:
    """Yield a listener's cursor, opened before the response begins and released at its end."""
    live, clients = manager.context.live, access.clients_per_address if caller.name is None else 1
    try:
        cursor = live.open(caller.client, clients * LISTENERS_MAX)
    except TooManyListenersError as error:
        raise ProblemError(
            503, "too-many-listeners", "Too many listeners", f"{error}; close another page"
        ) from error
    try:
        yield cursor
    finally:
        live.leave(caller.client)


@router.get(
    "/rigs/{rig}/live",
    response_class=EventSourceResponse,
    responses=responses(404),
    dependencies=[OBSERVE],
)
async def samples(
    manager: Manager,
    cursor: Annotated[LiveCursor, Depends(_live_cursor)],
    permitted: Permitted,
) -> AsyncIterator[LiveBatch]:
    """Stream samples in batches, up to 15 events per second.

    The first ones bring the last minute.
    """
    while not manager.closed and permitted():
        for batch in cursor.batches(KEEP_ALIVE_S):
            yield batch.model_copy(update={"standing": standing(manager.context)})
        await asyncio.sleep(LIVE_INTERVAL_S)


simulation_router = APIRouter(tags=["simulation"], route_class=StrictRoute)


@simulation_router.get(
    "/rigs/{rig}/simulation/commands",
    responses=responses(404, 409),
    dependencies=[OBSERVE],
)
def operations(manager: Manager) -> SimulationOperationList:
    """Return the operations of this simulated rig, with units and bounds of their values."""
    _require_simulated(manager)
    return SimulationOperationList(
        operations=[
            _view(target, operation) for target, known in OPERATIONS.items() for operation in known
        ]
    )


@simulation_router.post(
    "/rigs/{rig}/simulation/commands",
    responses=responses(404, 409),
    dependencies=[OPERATE],
)
def command(manager: Manager, body: SimulationCommand, asker: Asking) -> SimulationCommand:
    """Operate the simulated rig, or inject a fault; responds once the rig has applied it."""
    asker.note(f"{body.target} {body.what}")
    manager.claims.require(asker.claim)
    _require_simulated(manager)
    wanted = SimCommand(body.target, body.what, body.value, body.after_s, body.for_s)
    if trouble := objection(wanted):
        raise _impossible(wanted, trouble)
    try:
        manager.context.bus.call(SIM_COMMAND, wanted)
    except RefusalError as error:
        raise ProblemError(
            409, "simulation-refused", "The simulated rig has no such command", str(error)
        ) from error
    except BusError as error:
        raise unanswered(error) from error
    return body


def _impossible(wanted: SimCommand, trouble: str) -> ProblemError:
    found = operation_of(wanted.target, wanted.what)
    return ProblemError(
        422,
        "simulation-impossible",
        "The simulated rig cannot do this",
        trouble,
        value=wanted.value,
        **({} if found is None else _view(wanted.target, found).model_dump()),
    )


def _view(target: str, operation: Operation) -> SimulationOperation:
    return SimulationOperation(target=target, **asdict(operation))


def _require_simulated(manager: JobManager) -> None:
    rig = manager.context.rig
    if rig.simulation is None:
        raise ProblemError(
            409,
            "rig-is-real",
            "This rig is not simulated",
            f"rig {rig.rig.name!r} is real: make the change at its bench",
        )
