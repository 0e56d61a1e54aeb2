"""The REST application of the rigs of one supervisor.

``python -m pincette_supervisor.rest.api FILE`` writes its OpenAPI document.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from fastapi import FastAPI

from pincette import __version__
from pincette_supervisor import problems
from pincette_supervisor.access.access import Access
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.rest import (
    routes_access,
    routes_alarms,
    routes_artifacts,
    routes_calibrations,
    routes_catalog,
    routes_events,
    routes_job_list,
    routes_jobs,
    routes_learning,
    routes_page,
    routes_probes,
    routes_recipes,
    routes_rigs,
    routes_simulation,
    routes_trajectories,
)
from pincette_supervisor.rest.dependencies import cookie_name
from pincette_supervisor.rest.limits import RateLimit
from pincette_supervisor.rest.middleware import AuditLog, HeadAndOptions, OriginCheck
from pincette_supervisor.rest.openapi import BASE, complete
from pincette_supervisor.rest.request_target import NormalTarget

VERSIONED = (
    routes_rigs,
    routes_job_list,
    routes_jobs,
    routes_artifacts,
    routes_catalog,
    routes_calibrations,
    routes_learning,
    routes_recipes,
    routes_simulation,
    routes_trajectories,
    routes_events,
    routes_alarms,
    routes_access,
)


def create_app(rigs: Rigs, access: Access | None = None) -> FastAPI:
    """Build the application; there are no documentation pages, which load foreign scripts."""
    app = FastAPI(
        title="pincette supervisor",
        version=__version__,
        description="Plans, runs and records jobs of a piezoelectric microgripper. "
        "Units are in the names: µm, mN, V, s. Errors are problem documents (RFC 9457).",
        docs_url=None,
        redoc_url=None,
        openapi_url="/openapi.json",
        redirect_slashes=False,
    )
    app.state.rigs = rigs
    app.state.access = access = access or Access()
    problems.install_handlers(app)
    _add_middleware(app, access)
    for routes in VERSIONED:
        app.include_router(routes.router, prefix=BASE)
    for router in (routes_page.router, routes_probes.documents, routes_probes.router):
        app.include_router(router)
    generate: Callable[[], dict[str, Any]] = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            tree = generate()
            complete(tree)
            session = tree["components"]["securitySchemes"]["session"]
            session["name"] = cookie_name(access.authenticator.supervisor)
        return generate()

    app.openapi = openapi
    return app


def _add_middleware(app: FastAPI, access: Access) -> None:
    """Add what holds for all routes; the last added is outermost."""
    app.add_middleware(HeadAndOptions, routes=app.routes)
    if access.buckets is not None:
        app.add_middleware(
            RateLimit,
            authenticator=access.authenticator,
            buckets=access.buckets,
            clients_per_address=access.clients_per_address,
        )
    app.add_middleware(OriginCheck, names=access.names)
    app.add_middleware(
        AuditLog, authenticator=access.authenticator, audit_buffer=access.audit_buffer
    )
    app.add_middleware(NormalTarget)


def openapi_document() -> str:
    """Return the OpenAPI document as text; no route is called, so that no rig is needed."""
    tree = create_app(cast(Rigs, None)).openapi()
    return json.dumps(tree, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(openapi_document(), encoding="utf-8")
