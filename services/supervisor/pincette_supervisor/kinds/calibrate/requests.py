"""The installed calibrations: the request and form of each, and the module of its functions."""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from pincette.api import WHOLE, Model, example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette.api.requests import Duration, NotNegative, Positive, Speed
from pincette.config.laws import law_definition
from pincette.control.calibration.visible_mode import shows_mode
from pincette.control.planning.calibration_programs import (
    LEAST_CAPTURE_HZ,
    NOISE_S,
    SWEEP_FROM_HZ,
    SWEEP_S,
    SWEEP_TO_HZ,
)
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate import CalibrationRequest

if TYPE_CHECKING:
    from pincette.config import RigFile


WEIGHTS_MAX = 20


class WeighedStep(Model):
    """Readings under one weight."""

    model_config = example(x_um=-2.31, scatter_um=0.004, at_s=-41.5)

    x_um: float
    scatter_um: NotNegative
    """Standard uncertainty of the mean position."""
    at_s: float
    """Time of the reading since the job began, in s; negative for a reading of an earlier job."""


class ComplianceRequest(CalibrationRequest, frozen=True):
    """Hang known weights at the tip when the job requests them, in ascending and then descending
    order.

    No part in the gripper.
    """

    model_config = example(
        kind="calibrate", calibration="compliance", autostart=True, weights_mN=[0.0, 5.0, 10.0]
    )

    calibration: Literal["compliance"]
    weights_mN: list[NotNegative] | None = Field(default=None, min_length=2, max_length=WEIGHTS_MAX)
    """Weights in ascending order from 0. They pull in the direction in which a part presses,
    against the closing of the gripper (default: three round weights within the limits of the
    rig)."""
    weight_uncertainty: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard uncertainty of the weights, common to all of them."""
    taken: list[WeighedStep] = Field(default_factory=list[WeighedStep], max_length=2 * WEIGHTS_MAX)
    """Readings that an earlier job has taken before a stall tripped it; this job takes the
    remaining ones.
    """


COMPLIANCE = Variant(
    name="compliance",
    label="compliance, with weights",
    summary=(
        "Measure the compliance of the arm with known weights, hung as the job requests; "
        "remove the part first."
    ),
    request=ComplianceRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="weights_mN", label="Weights, from 0", placeholder="as the limits allow"),
        FieldSpec(
            name="weight_uncertainty", label="Relative uncertainty of the weights", advanced=True
        ),
    ),
    functions="pincette_supervisor.kinds.calibrate.compliance:FUNCTIONS",
    place=20,
)


LEVELS_MAX = 12


class ContactStiffnessRequest(CalibrationRequest, frozen=True):
    """Press the part by a sinusoid of voltage at several levels, as in Fig. 8 of the paper."""

    model_config = example(
        kind="calibrate", calibration="contact_stiffness", autostart=True, levels_V=[0.3, 1.0, 1.5]
    )

    calibration: Literal["contact_stiffness"]
    levels_V: list[Positive] | None = Field(default=None, min_length=3, max_length=LEVELS_MAX)
    """Levels of the sinusoid, peak to peak (default: those of the paper, scaled down to the
    limits of the rig)."""
    load_s: Duration | None = None
    """Duration of the press up to the mean voltage, and of the unload."""
    approach_um_per_s: Speed | None = None
    """Speed of the free arm on its way to the part."""
    seek_um_per_s: Speed | None = None
    """Speed near the part, until the contact is found."""
    contact_force_mN: Positive | None = None
    """Force that counts as a contact."""


CONTACT_STIFFNESS = Variant(
    name="contact_stiffness",
    label="contact stiffness",
    summary=(
        "Measure stiffness and position of the contact with the part by pressing it at "
        "several levels."
    ),
    request=ContactStiffnessRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="levels_V", label="Levels, peak to peak", placeholder="as the limits allow"),
        FieldSpec(name="load_s", label="Press over", advanced=True),
        FieldSpec(name="contact_force_mN", label="Contact from", advanced=True),
    ),
    functions="pincette_supervisor.kinds.calibrate.contact_stiffness:FUNCTIONS",
    place=50,
)


class FreeResponseRequest(CalibrationRequest, frozen=True):
    """Move the free arm by voltage alone, to find gain, loop, creep and the model of both.

    There must be no part in the gripper. Defaults follow from the rig file's limits and its nominal
    gain.
    """

    model_config = example(kind="calibrate", calibration="free_response", autostart=True)

    calibration: Literal["free_response"]
    low_V: float | None = None
    """Lowest voltage of the motion that is fitted, below ``high_V``; with ``high_V`` it includes
    the voltages that a grip needs."""
    high_V: float | None = None
    """Highest voltage of the motion that is fitted."""
    least_V: float | None = None
    """Lower limit of all voltages of the motion, including the cycles of 2 V. If the arm has
    exceeded a position limit, the next attempt sets this limit and ``most_V``.
    """
    most_V: float | None = None
    """Upper limit of all voltages of the motion; see ``least_V``."""
    rate_V_per_s: Positive | None = None
    """Peak rate of the fastest moves."""
    no_part: bool = False
    """True if a person has verified that no part is in the gripper. A kink at one position, as a
    part in the way would cause, then gives a warning instead of an error, since some free arms show
    one. An obstacle as hard as a part still ends the motion as ``contact``, at twice the contact
    force.
    """

    @model_validator(mode="after")
    def _ordered(self) -> "FreeResponseRequest":
        if self.low_V is not None and self.high_V is not None and self.low_V >= self.high_V:
            raise ValueError(f"low_V = {self.low_V} V is not below high_V = {self.high_V} V")
        return self


FREE_RESPONSE = Variant(
    name="free_response",
    label="free response",
    summary=(
        "Identify gain, hysteresis and creep of the free arm, and their model; remove the "
        "part first."
    ),
    request=FreeResponseRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="no_part", label="I have checked that no part is in the gripper"),
        FieldSpec(name="low_V", label="Lowest voltage"),
        FieldSpec(name="high_V", label="Highest voltage"),
        FieldSpec(name="rate_V_per_s", label="Rate at most", advanced=True),
    ),
    functions="pincette_supervisor.kinds.calibrate.free_response:FUNCTIONS",
    place=30,
)


Frequency = Annotated[float, Field(ge=0.1, le=5000)]


class FrequencyResponseRequest(CalibrationRequest, frozen=True):
    """Sweep a sine through the resonance, with buffered acquisition. No part in the gripper."""

    model_config = example(
        kind="calibrate", calibration="frequency_response", autostart=True, to_hz=800.0
    )

    calibration: Literal["frequency_response"]
    from_hz: Frequency = SWEEP_FROM_HZ
    """Lowest frequency, below ``to_hz``."""
    to_hz: Frequency = SWEEP_TO_HZ
    """Highest frequency."""
    duration_s: Annotated[float, Field(ge=1, le=120)] = SWEEP_S
    """Duration of the measurement."""
    amplitude_V: Positive | None = None
    """Amplitude of the sine (default: the largest that limits and resonance permit)."""
    capture_hz: Annotated[float, Field(ge=LEAST_CAPTURE_HZ, le=100_000)] = LEAST_CAPTURE_HZ
    """Sample rate of the sweep's output and of its acquisition."""

    @model_validator(mode="after")
    def _ascending(self) -> "FrequencyResponseRequest":
        if self.from_hz >= self.to_hz:
            raise ValueError(f"from_hz = {self.from_hz} Hz is not below to_hz = {self.to_hz} Hz")
        return self


FREQUENCY_RESPONSE = Variant(
    name="frequency_response",
    label="frequency response",
    summary="Measure natural frequency and damping of the arm by a sweep; remove the part first.",
    request=FrequencyResponseRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="duration_s", label="For"),
        FieldSpec(name="from_hz", label="From"),
        FieldSpec(name="to_hz", label="To"),
        FieldSpec(
            name="amplitude_V",
            label="Amplitude",
            placeholder="as limits and resonance allow",
            advanced=True,
        ),
        FieldSpec(name="capture_hz", label="Acquired at", advanced=True),
    ),
    functions="pincette_supervisor.kinds.calibrate.frequency_response:FUNCTIONS",
    place=40,
)


class GainCheckRequest(CalibrationRequest, frozen=True):
    """Compare the stroke of the arm with its calibration, in a few seconds. No part in the gripper.

    Accept the result if amplifier or piezo have caused a change of the stroke. If the sensor is the
    cause, correct the sensor's scale instead.
    """

    model_config = example(kind="calibrate", calibration="gain_check", autostart=True)

    calibration: Literal["gain_check"]


GAIN_CHECK = Variant(
    name="gain_check",
    label="gain check",
    summary="Compare the stroke of the arm with its calibration; remove the part first.",
    request=GainCheckRequest,
    form=(fields.ZERO_CONFIRMED,),
    functions="pincette_supervisor.kinds.calibrate.gain_check:FUNCTIONS",
    place=35,
)


class NoiseRequest(CalibrationRequest, frozen=True):
    """Hold the voltage and read the sensor, to find its noise, resolution and drift."""

    model_config = example(kind="calibrate", calibration="noise", autostart=True)

    calibration: Literal["noise"]
    duration_s: Annotated[float, Field(ge=2, le=600)] = NOISE_S
    """Duration of the measurement."""


NOISE = Variant(
    name="noise",
    label="noise of the sensor",
    summary="Measure noise, resolution and drift of the sensor with the arm at rest.",
    request=NoiseRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="duration_s", label="For"),
    ),
    functions="pincette_supervisor.kinds.calibrate.noise:FUNCTIONS",
    place=10,
)


class OutputTimingRequest(CalibrationRequest, frozen=True):
    """Excite the mode by bursts at the loop's period, to find output delay, lag and mode."""

    model_config = example(kind="calibrate", calibration="output_timing", autostart=True)

    calibration: Literal["output_timing"]
    amplitude_V: Positive | None = None
    """Amplitude of the bursts (default: the largest that the limits of position, slew and sweeps
    permit)."""


OUTPUT_TIMING = Variant(
    name="output_timing",
    label="delay and lag of the output",
    summary=(
        "Measure when a voltage acts on the arm, and the arm's mode, at a short period; "
        "remove the part first."
    ),
    request=OutputTimingRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(
            name="amplitude_V", label="Amplitude", placeholder="as limits allow", advanced=True
        ),
    ),
    functions="pincette_supervisor.kinds.calibrate.output_timing:FUNCTIONS",
    place=45,
)


def bursts_are_needed(rig: "RigFile") -> bool:
    """Return whether bursts are needed: the law looks ahead, and the sampling resolves the mode.

    The mode then determines how far ahead the law looks.
    """
    looks_ahead = law_definition(rig.law.scheme).previews
    return looks_ahead and shows_mode(rig.model.natural_frequency_rad_per_s, rig.rig.period_s)


RUNS = 2


class ResidualRequest(CalibrationRequest, frozen=True):
    """Replay the voltages of a recorded job without the part, and store the errors of the model.

    The table applies to jobs of the same motion: the same request, part and free response.
    """

    model_config = example(
        kind="calibrate",
        calibration="residual",
        autostart=True,
        of_job="20260301-120000-1f0c",
    )

    calibration: Literal["residual"]
    of_job: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,60}$")] | None = None
    """Job whose voltages are replayed, a grip or a track (default: the newest that succeeded)."""
    runs: Annotated[int, Field(ge=2, le=10), WHOLE] = RUNS
    """Number of runs; their difference gives the error of the stored values."""
    confirm: bool = True
    """Wait for a person to remove the part before the first run, and again after the last run."""

    @property
    def plays(self) -> str:
        """Return the job whose recorded motion is replayed; empty: the newest."""
        return self.of_job or ""


RESIDUAL = Variant(
    name="residual",
    label="residual of a motion",
    summary="Measure the error of the model along a recorded job, played again without the part.",
    request=ResidualRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="of_job", label="Of job", placeholder="the newest grip or track"),
        FieldSpec(name="runs", label="Runs"),
        FieldSpec(name="confirm", label="Wait for a person to remove the part and to put it back"),
    ),
    functions="pincette_supervisor.kinds.calibrate.residual:FUNCTIONS",
    place=60,
)
