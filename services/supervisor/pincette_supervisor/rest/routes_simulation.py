"""Commands to a simulated rig: parts, weights and faults, as ``pincette rig`` sends them."""

from dataclasses import asdict

from fastapi import APIRouter

from pincette.api.problems import responses
from pincette.api.simulation import (
    SimulationCommand,
    SimulationOperation,
    SimulationOperationList,
)
from pincette.bus.protocol import BusError, RefusalError
from pincette.config.script import OPERATIONS, Operation, objection, operation_of
from pincette.core.messages import SimCommand
from pincette.core.topics import SIM_COMMAND
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.problems import ProblemError, unanswered
from pincette_supervisor.rest.dependencies import OBSERVE, OPERATE, Asking, Manager
from pincette_supervisor.rest.strict_route import StrictRoute

router = APIRouter(tags=["simulation"], route_class=StrictRoute)


@router.get(
    "/rigs/{rig}/simulation/commands",
    responses=responses(404, 409),
    dependencies=[OBSERVE],
)
def operations(manager: Manager) -> SimulationOperationList:
    """What can be done to this simulated rig, with units and bounds of the values."""
    _require_simulated(manager)
    return SimulationOperationList(
        operations=[
            _view(target, operation) for target, known in OPERATIONS.items() for operation in known
        ]
    )


@router.post(
    "/rigs/{rig}/simulation/commands",
    responses=responses(404, 409),
    dependencies=[OPERATE],
)
def command(manager: Manager, body: SimulationCommand, asker: Asking) -> SimulationCommand:
    """Operate the simulated rig, or let a fault befall it; answered once the rig has taken it."""
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
