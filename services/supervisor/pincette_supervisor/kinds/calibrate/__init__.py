"""``calibrate``: find quantities of the rig; each calibration is registered on its own."""

from pincette.api.calibrations import CalibrationPlan, CalibrationResult
from pincette.api.job_kinds import JobKind, ResultField, Variant, registered
from pincette.core import plugins
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest

KIND = JobKind(
    name="calibrate",
    label="Calibrate",
    summary="Calibrate one thing of the rig; what is found is used once it is accepted.",
    request=CalibrationRequest,
    plan=CalibrationPlan,
    result=CalibrationResult,
    functions="pincette_supervisor.kinds.calibrate.functions:FUNCTIONS",
    figures=(
        ResultField(name="calibration", label="calibration"),
        ResultField(name="statement", label="finding"),
    ),
    variant_field="calibration",
    variants=registered(plugins.CALIBRATIONS, Variant),
    waits=True,
    proposes=True,
    picture="calibration.png",
    arms=(1, 2),
    on_stop="retract",
    # A calibration lasts for minutes, and a machine that stalls must not end it.
    lease_factor=3.0,
    needs_every_sample=True,
    place=60,
)
