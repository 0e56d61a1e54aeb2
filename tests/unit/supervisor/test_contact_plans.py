"""Statements of a plan of a job that meets a part, before it starts."""

import pytest

from pincette.config import RigFile
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.kinds.calibrate.requests import ContactStiffnessRequest
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import FaultyRequestError


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_a_plan_warns_that_no_free_response_has_been_identified(
    rig_file: RigFile, kind: str
) -> None:
    request = REQUEST.validate_python({"kind": kind})
    assert plan_job(request, rig_file).plan.model_dump()["warnings"] == []
    bare = rig_file.model_copy(
        update={"model": rig_file.model.model_copy(update={"free_response": None})}
    )
    (warning,) = plan_job(request, bare).plan.model_dump()["warnings"]
    # 6 % of 30 µm over 0.46 µm/mN
    assert "may be 3.9 mN" in warning
    assert "calibrate free_response first" in warning


def test_a_part_is_not_pressed_by_voltage_if_the_force_is_unknown(
    rig_file: RigFile,
) -> None:
    bare = rig_file.model_copy(
        update={"model": rig_file.model.model_copy(update={"free_response": None})}
    )
    request = ContactStiffnessRequest(kind="calibrate", calibration="contact_stiffness")
    with pytest.raises(FaultyRequestError, match="calibrate free_response first") as refusal:
        plan_job(request, bare)
    assert refusal.value.pointer == "/calibration"
