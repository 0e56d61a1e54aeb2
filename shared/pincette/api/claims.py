"""A client's claim on a rig over REST."""

from typing import Annotated

from pydantic import Field

from pincette.api import Model, example


class Claim(Model):
    """A client's claim on a rig: others begin nothing there until it ends; everybody may stop."""

    model_config = example(
        by="cell-7",
        note="night run",
        since="2026-03-01T12:00:00.000Z",
        expires_at="2026-03-01T12:01:00.000Z",
        left_s=41.5,
    )

    by: str
    """Who holds it, as ``by`` of a job."""
    note: str
    since: str
    expires_at: str
    left_s: float
    """Until it ends by itself."""


class ClaimRequest(Model):
    """For how long a rig is claimed, and what for; sent again it is a longer lease."""

    model_config = example(lease_s=60.0, note="night run")

    lease_s: Annotated[float, Field(ge=1.0, le=3600.0)] = 60.0
    """After which it ends unless it is renewed."""
    note: str = Field(default="", max_length=200)
