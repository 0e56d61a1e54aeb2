"""Where x_1 may come from beside the identified operator: a straight line, a recorded loop."""

from pincette.config import RigFile
from pincette.control.response.free_response import FreeResponse, FreeSample, nominal_response
from pincette.control.response.recorded_response import recorded_response
from pincette.control.response.recording import record_free_response
from pincette.runtime.teaching import free_motion


def other_sources(rig: RigFile) -> dict[str, FreeResponse]:
    """Both, from the same teaching motion as the operator."""
    voltage_V, x_um = free_motion(rig)
    recording = record_free_response(voltage_V, x_um)
    d_p = rig.model.piezo_um_per_V
    return {
        "a straight line": nominal_response(d_p, FreeSample(0.0, 0.0)),
        "recorded branches": recorded_response(recording.branches, d_p, recording.residual_um),
    }
