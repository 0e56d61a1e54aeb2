"""Requests whose numbers would take days are refused before a motion is computed."""

from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.config import RigFile
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job

VALIDATE: Any = TypeAdapter(Body).validate_python


@pytest.mark.parametrize(
    ("request_", "phase"),
    [
        ({"kind": "grip", "seek_um_per_s": 0.1, "contact_force_mN": 1e6}, "contact"),
        ({"kind": "move", "to_um": 1e9}, "move"),
        ({"kind": "move", "by_V": 1e9}, "move"),
        ({"kind": "calibrate", "calibration": "free_response", "rate_V_per_s": 1e-9}, "teach"),
        ({"kind": "calibrate", "calibration": "contact_stiffness", "load_s": 3600.0}, "press"),
    ],
)
def test_a_plan_of_days_is_refused(
    rig_file: RigFile, request_: dict[str, object], phase: str
) -> None:
    with pytest.raises(ValueError, match=rf"it takes .* s, limit 10800 s; {phase} takes"):
        plan_job(VALIDATE(request_), rig_file)
