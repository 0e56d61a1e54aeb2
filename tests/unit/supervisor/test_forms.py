"""Forms as the page gets them, made of the requests' schemas."""

import pytest

from pincette.api.job_kinds import FieldSpec
from pincette.api.kinds import complete
from pincette_supervisor.kinds.calibrate.requests import ResidualRequest
from pincette_supervisor.kinds.grip import GripJobRequest


@pytest.mark.parametrize(
    ("request_type", "name", "ticked"),
    [(ResidualRequest, "confirm", True), (GripJobRequest, "until_released", False)],
)
def test_a_checkbox_is_ticked_if_its_member_is_true_by_default(
    request_type: type[ResidualRequest | GripJobRequest], name: str, ticked: bool
) -> None:
    field = complete(FieldSpec(name=name, label=""), request_type.model_json_schema())
    assert (field.widget, field.ticked) == ("check", ticked)
