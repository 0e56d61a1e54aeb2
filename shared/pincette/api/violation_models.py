"""A limit that a plan, or what is foretold of it, breaks."""

from pydantic import BaseModel

from pincette.api.job_models import example


class Violation(BaseModel):
    """A limit that is broken, where and when."""

    model_config = example(
        pointer="/force_mN",
        quantity="force",
        value=55.0,
        limit=40.0,
        unit="mN",
        at_s=8.85,
        message="force_mN = 55 mN is above the limit of 40 mN",
    )

    pointer: str
    """JSON pointer into the request; empty where no member of it can be named."""
    quantity: str
    value: float
    limit: float
    unit: str
    at_s: float
    message: str
