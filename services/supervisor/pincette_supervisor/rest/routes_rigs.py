"""Rigs over REST, and the emergency stop."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

from fastapi import APIRouter, Request

from pincette.api.problem_models import responses
from pincette.api.proposal_models import ModelAction, ModelView
from pincette.api.rig_models import QueueRequest, ResetRequest, Rig, RigList, Stopped
from pincette_supervisor import problems
from pincette_supervisor.model.model_view import model_view
from pincette_supervisor.rest.headers import Who, sender
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.view import rig_view


def routes(conductor: Conductor, estop_pool: ThreadPoolExecutor) -> APIRouter:
    """Everything under ``/rigs``; the emergency stop has threads of its own."""
    router = APIRouter(prefix="/rigs", tags=["rigs"])

    def require(rig: str) -> None:
        name = conductor.site.rig.rig.name
        if rig != name:
            raise problems.not_found("rig", rig, [name])

    @router.get("")
    def rigs() -> RigList:  # pyright: ignore[reportUnusedFunction]
        """The rigs this supervisor serves."""
        return RigList(rigs=[rig_view(conductor)])

    @router.get("/{rig}", responses=responses(404))
    def rig_state(rig: str) -> Rig:  # pyright: ignore[reportUnusedFunction]
        """One rig: programs, interlocks, limits, latch, and whether a job can start."""
        require(rig)
        return rig_view(conductor)

    @router.post("/{rig}/estop", responses=responses(404, 503))
    async def estop(rig: str, request: Request) -> Stopped:  # pyright: ignore[reportUnusedFunction]
        """Stop at once: freeze a held part, ramp a free arm, latch. Always accepted; no body."""
        require(rig)
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(estop_pool, conductor.latch.estop, sender(request))

    @router.post("/{rig}/reset", responses=responses(404, 409, 422, 503))
    def reset(  # pyright: ignore[reportUnusedFunction]
        rig: str, _body: ResetRequest, who: Who
    ) -> Stopped:
        """Clear the latch, once a person has seen the cause; a held part stays held."""
        require(rig)
        return conductor.latch.reset(who)

    @router.post("/{rig}/queue/actions", responses=responses(404, 409, 422, 503))
    def order_queue(  # pyright: ignore[reportUnusedFunction]
        rig: str, body: QueueRequest, who: Who
    ) -> Rig:
        """Let a halted queue go on, or stop all jobs that wait."""
        require(rig)
        conductor.order_queue(body.type, who)
        return rig_view(conductor)

    @router.get("/{rig}/model", responses=responses(404))
    def model(rig: str) -> ModelView:  # pyright: ignore[reportUnusedFunction]
        """The model in use: every quantity that can be calibrated, and the versions there are."""
        require(rig)
        return model_view(conductor.site.model)

    @router.post("/{rig}/model/actions", responses=responses(404, 409, 422))
    def use_model(  # pyright: ignore[reportUnusedFunction]
        rig: str, body: ModelAction
    ) -> ModelView:
        """Go back to a version of the model, or with 0 to the rig file alone."""
        require(rig)
        return conductor.use_model(body.version)

    return router
