"""The REST application of the rigs of one supervisor."""

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI
from fastapi.responses import JSONResponse

from pincette import __version__
from pincette.api.calibration_models import CalibrationResult
from pincette.api.problem_models import Problem
from pincette.api.result_models import GripResult, MotionResult, TrackResult
from pincette_supervisor import problems
from pincette_supervisor.rest import (
    routes_calibrations,
    routes_documents,
    routes_events,
    routes_jobs,
    routes_live,
    routes_page,
    routes_recipes,
    routes_rigs,
    routes_trajectories,
)
from pincette_supervisor.rest.bodies import complete_bodies
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.rigs import Rigs

BASE = "/api/v1"
MODELS = (Problem, GripResult, TrackResult, MotionResult, CalibrationResult)
"""Models the OpenAPI document shows although no route names them."""


def create_app(rigs: Rigs) -> FastAPI:
    """Build the application; pages that load scripts from elsewhere are left out."""
    app = FastAPI(
        title="pincette supervisor",
        version=__version__,
        description="Plans, runs and records jobs of a piezoelectric microgripper. "
        "Units are in the names: µm, mN, V, s. Errors are problem documents (RFC 9457).",
        docs_url=None,
        redoc_url=None,
        openapi_url="/openapi.json",
    )
    problems.install(app)
    app.include_router(routes_rigs.routes(rigs), prefix=BASE)
    app.include_router(routes_jobs.routes(rigs), prefix=BASE)
    app.include_router(routes_calibrations.routes(rigs), prefix=BASE)
    app.include_router(routes_recipes.routes(rigs), prefix=BASE)
    app.include_router(routes_trajectories.routes(rigs), prefix=BASE)
    app.include_router(routes_live.routes(rigs), prefix=BASE)
    app.include_router(routes_events.routes(rigs), prefix=BASE)
    app.include_router(routes_page.routes(rigs))
    app.include_router(routes_documents.routes())
    _probes(app, rigs)
    plain: Callable[[], dict[str, Any]] = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            _complete(plain())
        return plain()

    app.openapi = openapi
    return app


def _complete(document: dict[str, Any]) -> None:
    """Add models that no route names, and leave out FastAPI's own form of an error."""
    schemas = document["components"]["schemas"]
    for model in MODELS:
        tree = model.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas.update(tree.pop("$defs", {}))
        schemas[model.__name__] = tree
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)
    for operations in document["paths"].values():
        for operation in operations.values():
            if "HTTPValidationError" in str(operation["responses"].get("422")):
                del operation["responses"]["422"]
    complete_bodies(document)


def _probes(app: FastAPI, rigs: Rigs) -> None:
    """Three probes that ask three questions: alive, able to serve, and which version."""

    @app.get("/livez", tags=["probes"])
    async def livez() -> dict[str, str]:  # pyright: ignore[reportUnusedFunction]
        """Whether the event loop turns."""
        return {"status": "alive"}

    @app.get("/readyz", tags=["probes"], responses={503: {"description": "with the reasons"}})
    def readyz() -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        """Whether a rig is whole: all its programs answer and agree on the rig file.

        Of several rigs one is enough, so that one that is down takes the others from nobody; the
        reasons name it.
        """
        reasons = rigs.of_all(_troubles)
        said = [reason for one in reasons for reason in one]
        said += [f"{rig}: {why}" for rig, why in rigs.unusable.items()]
        whole = not all(reasons)
        return JSONResponse(
            {"status": "ready" if whole else "not ready", "reasons": said},
            status_code=200 if whole else 503,
        )

    @app.get("/version", tags=["probes"])
    async def version() -> dict[str, str | dict[str, str]]:  # pyright: ignore[reportUnusedFunction]
        """The program's version, its own rig, and the digest of the rig file of each it serves."""
        own = rigs.own
        return {
            "version": __version__,
            "rig": own.name,
            "rig_file_digest": own.site.digest,
            "rigs": {one.name: one.site.digest for one in rigs.all()},
        }


def _troubles(conductor: Conductor) -> list[str]:
    """Why a rig is not whole; every reason names the rig."""
    health = conductor.site.health
    health.refresh()
    return [f"{conductor.name}: {name}: {why}" for name, why in health.troubles().items()]
