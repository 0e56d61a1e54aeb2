"""What Prometheus scrapes."""

from typing import Annotated

from fastapi import APIRouter, Header, Response
from prometheus_client.exposition import choose_encoder

from pincette.api.problem_models import responses
from pincette_supervisor.metrics.collector import RigCollector
from pincette_supervisor.rest.guard import OBSERVE
from pincette_supervisor.running.rigs import Rigs

PLAIN = "text/plain"
EXAMPLE = 'pincette_trips_total{cause="command_age",rig="demo"} 0.0\n'


def routes(rigs: Rigs) -> APIRouter:
    """``/metrics``, where Prometheus looks for it."""
    router = APIRouter(tags=["probes"])
    collector = RigCollector(rigs)

    @router.get(
        "/metrics",
        response_class=Response,
        responses={
            200: {
                "content": {PLAIN: {"schema": {"type": "string"}, "example": EXAMPLE}},
                "description": "Prometheus' text format, or OpenMetrics where it is asked for",
            },
            **responses(503),
        },
        dependencies=[OBSERVE],
    )
    def metrics(  # pyright: ignore[reportUnusedFunction]
        accept: Annotated[str, Header(include_in_schema=False)] = "",
    ) -> Response:
        """Metrics of all rigs for Prometheus; no program is asked for them."""
        try:
            encode, kind = choose_encoder(accept)
        except (TypeError, ValueError):  # a version that is none
            encode, kind = choose_encoder("")
        return Response(encode(collector), headers={"Content-Type": kind})

    return router
