"""Calls about rigs: their state, their model, their queue, and the emergency stop."""

from typing import Any, Literal

from pydantic import BaseModel

from pincette.api.event_models import EventList
from pincette.api.proposal_models import ModelView, Proposal, ProposalList
from pincette.api.rig_models import Rig, RigList, Stopped, StoppedList
from pincette.api.timing_models import LoopTiming
from pincette.client.call import Call, model


def rigs() -> Call[RigList]:
    """Every rig of the supervisor."""
    return Call("GET", "/rigs", model(RigList), repeatable=True)


def rig(name: str) -> Call[Rig]:
    """One rig."""
    return Call("GET", f"/rigs/{name}", model(Rig), repeatable=True)


def estop(name: str) -> Call[Stopped]:
    """Stop at once; asked twice, it stops once."""
    return Call("POST", f"/rigs/{name}/estop", model(Stopped), repeatable=True)


def estop_all() -> Call[StoppedList]:
    """Stop every rig at once; asked twice, it stops once."""
    return Call("POST", "/estop", model(StoppedList), repeatable=True)


def reset(name: str) -> Call[Stopped]:
    """Clear the latch."""
    return Call("POST", f"/rigs/{name}/reset", model(Stopped), body={"acknowledge": True})


def queue_action(name: str, action: Literal["resume", "clear"]) -> Call[Rig]:
    """Let a halted queue go on, or empty it."""
    body = {"type": action}
    return Call("POST", f"/rigs/{name}/queue/actions", model(Rig), body=body)


def timing(name: str) -> Call[LoopTiming]:
    """How punctual the programs of a rig's loop are."""
    return Call("GET", f"/rigs/{name}/timing", model(LoopTiming), repeatable=True)


def newest_event(name: str | None) -> Call[int]:
    """Number of the newest event, of a rig or of all, from which on a stream is without a gap."""
    query: dict[str, str | float] = {"format": "json", "limit": 1}
    read = model(EventList)
    path = events_of(name)
    return Call("GET", path, lambda response: read(response).newest, query, repeatable=True)


def events_of(name: str | None) -> str:
    """Where the events of a rig are told, or of every one."""
    return "/events" if name is None else f"/rigs/{name}/events"


def model_in_use(name: str) -> Call[ModelView]:
    """The model in use, and the versions there are."""
    return Call("GET", f"/rigs/{name}/model", model(ModelView), repeatable=True)


def use_model(name: str, version: int) -> Call[ModelView]:
    """Go over to a version of the model."""
    body = {"type": "use", "version": version}
    return Call("POST", f"/rigs/{name}/model/actions", model(ModelView), body=body, repeatable=True)


def proposals(limit: int) -> Call[ProposalList]:
    """What calibrations propose, the newest first."""
    query: dict[str, str | float] = {"limit": limit}
    return Call("GET", "/calibrations", model(ProposalList), query, repeatable=True)


def proposal(calibration: str) -> Call[Proposal]:
    """One proposal."""
    return Call("GET", f"/calibrations/{calibration}", model(Proposal), repeatable=True)


def decide(calibration: str, decision: Literal["accept", "discard"]) -> Call[Proposal]:
    """Accept a proposal, or discard it."""
    path = f"/calibrations/{calibration}/actions"
    return Call("POST", path, model(Proposal), body={"type": decision})


def body_of(request: str | BaseModel, fields: dict[str, Any]) -> dict[str, Any]:
    """Body of a request: a model of ``pincette.api``, or a kind with its fields."""
    if isinstance(request, str):
        return {"kind": request, **fields}
    return {**request.model_dump(mode="json", exclude_unset=True), **fields}
