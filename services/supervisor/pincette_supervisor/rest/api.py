"""The REST application of the rigs of one supervisor."""

from collections.abc import Callable
from typing import Any

from fastapi import FastAPI

from pincette import __version__
from pincette.api.calibration_models import CalibrationResult
from pincette.api.problem_models import Problem
from pincette.api.result_models import GripResult, MotionResult, TrackResult
from pincette_supervisor import problems
from pincette_supervisor.access.access import Access
from pincette_supervisor.rest import (
    routes_access,
    routes_alarms,
    routes_calibrations,
    routes_documents,
    routes_events,
    routes_jobs,
    routes_live,
    routes_metrics,
    routes_page,
    routes_probes,
    routes_recipes,
    routes_rigs,
    routes_trajectories,
)
from pincette_supervisor.rest.answers import complete_answers
from pincette_supervisor.rest.audited import Audited
from pincette_supervisor.rest.bodies import complete_bodies
from pincette_supervisor.rest.boundary import Boundary
from pincette_supervisor.rest.bounded_bodies import BoundedBodies
from pincette_supervisor.rest.limits import Limited
from pincette_supervisor.running.rigs import Rigs

BASE = "/api/v1"
MODELS = (Problem, GripResult, TrackResult, MotionResult, CalibrationResult)
"""Models the OpenAPI document shows although no route names them."""


def create_app(rigs: Rigs, access: Access | None = None) -> FastAPI:
    """Build the application; pages that load scripts from elsewhere are left out."""
    access = access or Access()
    app = FastAPI(
        title="pincette supervisor",
        version=__version__,
        description="Plans, runs and records jobs of a piezoelectric microgripper. "
        "Units are in the names: µm, mN, V, s. Errors are problem documents (RFC 9457).",
        docs_url=None,
        redoc_url=None,
        openapi_url="/openapi.json",
    )
    app.state.gate = access.gate
    problems.install(app)
    _surround(app, access)
    app.include_router(routes_rigs.routes(rigs), prefix=BASE)
    app.include_router(routes_jobs.routes(rigs), prefix=BASE)
    app.include_router(routes_calibrations.routes(rigs), prefix=BASE)
    app.include_router(routes_recipes.routes(rigs), prefix=BASE)
    app.include_router(routes_trajectories.routes(rigs), prefix=BASE)
    app.include_router(routes_live.routes(rigs), prefix=BASE)
    app.include_router(routes_events.routes(rigs), prefix=BASE)
    app.include_router(routes_alarms.routes(rigs), prefix=BASE)
    app.include_router(routes_access.routes(rigs, access.trail), prefix=BASE)
    app.include_router(routes_page.routes(rigs))
    app.include_router(routes_documents.routes())
    app.include_router(routes_probes.routes(rigs))
    app.include_router(routes_metrics.routes(rigs))
    _version(app, rigs)
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
    complete_answers(document)


def _surround(app: FastAPI, access: Access) -> None:
    """Put around the routes what holds for all of them; what is added last is outermost."""
    app.add_middleware(BoundedBodies)
    if access.buckets is not None:
        app.add_middleware(Limited, gate=access.gate, buckets=access.buckets)
    app.add_middleware(Boundary, names=access.names)
    app.add_middleware(Audited, gate=access.gate, trail=access.trail)


def _version(app: FastAPI, rigs: Rigs) -> None:
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
