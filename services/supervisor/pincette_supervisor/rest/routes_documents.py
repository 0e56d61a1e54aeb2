"""What the rig says of itself to programs, beside the OpenAPI document."""

from typing import Any

from fastapi import APIRouter, Response

from pincette.asyncapi.document import document


def routes() -> APIRouter:
    """Documents at the root of the server."""
    router = APIRouter(tags=["documents"])

    @router.get("/asyncapi.json", response_model=dict[str, Any])
    def asyncapi() -> Response:  # pyright: ignore[reportUnusedFunction]
        """Every key and message of the bus, as an AsyncAPI document."""
        return Response(document(), media_type="application/json")

    return router
