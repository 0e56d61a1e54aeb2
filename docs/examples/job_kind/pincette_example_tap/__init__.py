"""``tap``: contact the part lightly, and report its position and stiffness."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, JobKind, number
from pincette.api.plans import Plan
from pincette.api.requests import ContactJobRequest
from pincette.api.results import JobResult


class TapRequest(ContactJobRequest, frozen=True):
    """Contact the part with a small force, and release it at once."""

    model_config = example(kind="tap", autostart=True, force_mN=8.0)

    kind: Literal["tap"]
    force_mN: Annotated[float, Field(ge=5, le=20)] = 8.0
    """Contact force in mN; a smaller force does not reveal the stiffness."""


class TapResult(JobResult):
    """Position and stiffness of the part; null if no part was found."""

    contact_x_um: float | None
    contact_x_error_um: float | None
    contact_stiffness_mN_per_um: float | None
    contact_stiffness_error_mN_per_um: float | None


KIND = JobKind(
    name="tap",
    label="Tap the part",
    summary="Touch the part lightly; report its position and stiffness.",
    request=TapRequest,
    plan=Plan,
    result=TapResult,
    functions="pincette_example_tap.functions:FUNCTIONS",
    form=(FieldSpec(name="force_mN", label="Touch with"),),
    figures=(
        number("contact_x_um", "part at", uncertainty="contact_x_error_um", main=True),
        number(
            "contact_stiffness_mN_per_um",
            "stiffness",
            digits=3,
            uncertainty="contact_stiffness_error_mN_per_um",
        ),
    ),
    predicted=True,
)
