"""REST applications of tests, which share what FastAPI derives from the routes.

FastAPI inspects a route when a request is first compared with it: 0.1 CPU s for all routes of an
application. Middleware, state and document belong to each application alone.
"""

from functools import cache
from typing import cast

from fastapi import FastAPI
from starlette.routing import BaseRoute, Route

from pincette_supervisor.access.access import Access
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.rest import api


@cache
def inspected_routes() -> list[BaseRoute]:
    """Return the routes whose inspection the applications share."""
    return api.create_app(cast(Rigs, None)).routes


def create_app(rigs: Rigs, access: Access | None = None) -> FastAPI:
    """Build an application as the supervisor does, with shared routes."""
    app = api.create_app(rigs, access)
    # The document's route is bound to its application; all others are in included routers.
    app.router.routes[:] = [
        own if isinstance(own, Route) else shared
        for own, shared in zip(app.router.routes, inspected_routes(), strict=True)
    ]
    return app
