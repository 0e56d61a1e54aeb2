"""The rig file: one frozen tree, read from TOML, unknown keys and impossible values refused."""

import hashlib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pincette.control.hysteresis import HysteresisModel
from pincette.control.plant import ArmParameters, consistent_arm, printed_arm

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class ConfigError(ValueError):
    """A rig file that cannot be used; the text names file, place, value and what is wanted."""


class Table(BaseModel):
    """A table of the rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class Rig(Table):
    """Name of the rig, its control period and its kind of time."""

    name: str = Field(pattern=r"^[a-z][a-z0-9-]{0,30}$")
    period_s: float = Field(default=0.02, gt=0, le=1.0)
    time: Literal["real", "lockstep"] = "real"


class Bus(Table):
    """Where the programs listen: the router at ``port``, the others at the ports after it."""

    host: str = "127.0.0.1"
    port: int = Field(default=7447, ge=1024, le=65500)


class Sensor(Table):
    """The position sensor: driver, where it is, its range in µm."""

    driver: str
    url: str
    minimum_um: float
    maximum_um: float
    offset_um: float = 0.0
    """Subtracted from the reading, so that the arm at rest is near zero."""
    direction: Literal[1, -1] = 1
    """+1 where closing the gripper raises the reading."""
    timeout_s: Positive = 0.1
    noise_um: NotNegative
    """r.m.s., as identified; enters the force uncertainty."""
    options: dict[str, str | int | float | bool] = {}


class Output(Table):
    """The voltage output that drives the amplifier."""

    driver: str
    url: str
    timeout_s: Positive = 0.1
    options: dict[str, str | int | float | bool] = {}


class IdentifiedFreeResponse(Table):
    """The free response as ``pincette teach`` identified it; see ``control.hysteresis``."""

    thresholds_V: tuple[float, ...] = Field(strict=False)
    weights_um_per_V: tuple[float, ...] = Field(strict=False)
    creep_times_s: tuple[float, ...] = Field(default=(), strict=False)
    creep_fractions: tuple[float, ...] = Field(default=(), strict=False)
    residual_um: NotNegative
    """r.m.s. left of free motion that was not fitted; enters the force uncertainty."""

    @model_validator(mode="after")
    def _possible(self) -> "IdentifiedFreeResponse":
        self.hysteresis()
        return self

    def hysteresis(self) -> HysteresisModel:
        """Model of the table; raises ValueError where it is impossible."""
        return HysteresisModel(
            thresholds_V=self.thresholds_V,
            weights_um_per_V=self.weights_um_per_V,
            creep_times_s=self.creep_times_s,
            creep_fractions=self.creep_fractions,
        )


class Model(Table):
    """The arm as the controller and the estimator know it."""

    parameters: Literal["consistent", "printed"] = "consistent"
    natural_frequency_rad_per_s: Positive = 2437.8
    damping_ratio: Positive = 0.0260
    piezo_um_per_V: Positive = 19.0
    compliance_um_per_mN: Positive = 0.46
    hysteresis_fraction: NotNegative = 0.06
    """Error of the linear free response, as a share of the voltage travel since the zero."""
    creep_mN_per_decade: NotNegative = 0.3
    """Growth of the force uncertainty per decade of zero age."""
    free_response: IdentifiedFreeResponse | None = None
    """Without it the free response is a straight line."""

    def arm(self) -> ArmParameters:
        """m, b, k, d of the set that is named."""
        if self.parameters == "printed":
            return printed_arm()
        return consistent_arm(
            self.natural_frequency_rad_per_s,
            self.damping_ratio,
            self.piezo_um_per_V,
            self.compliance_um_per_mN,
        )


class Law(Table):
    """Gains of PBSMIC and of the generalized impedance (10), in mN and µm."""

    K_P: Positive = 1.0
    K_I: Positive = 1.0
    K_S: NotNegative = 0.0
    delta: Positive = 100.0
    M: Positive = 1e-3
    B: Positive = 8.9221
    K: Positive = 1.9901e4
    K_f: NotNegative = 5000.0


class Limits(Table):
    """What the rig bears. The actuator enforces the voltage limits, the supervisor all."""

    voltage_min_V: float
    voltage_max_V: float
    slew_V_per_s: Positive
    position_min_um: float
    position_max_um: float
    force_max_mN: Positive

    @model_validator(mode="after")
    def _ordered(self) -> "Limits":
        if self.voltage_min_V >= self.voltage_max_V:
            raise ValueError(
                f"voltage_min_V = {self.voltage_min_V} V is not below "
                f"voltage_max_V = {self.voltage_max_V} V"
            )
        if self.position_min_um >= self.position_max_um:
            raise ValueError(
                f"position_min_um = {self.position_min_um} µm is not below "
                f"position_max_um = {self.position_max_um} µm"
            )
        return self


class Safety(Table):
    """How the actuator fails safe."""

    command_age_periods: float = Field(default=2.5, ge=1.5, le=10)
    ramp_s: float = Field(default=0.035, ge=0.005, le=2.0)
    safe_V: float = 0.0
    freeze_s: float = Field(default=10.0, ge=0.0, le=600.0)
    """How long a held part is kept by a frozen voltage before the ramp releases it."""


class Part(Table):
    """The object to be gripped, as the plan assumes it."""

    name: str
    contact_um: float
    """Position of the driven arm at first touch."""
    contact_tolerance_um: Positive
    stiffness_mN_per_um: Positive
    """K_e: the part in series with the passive arm."""
    stiffness_tolerance: float = Field(default=0.3, gt=0, lt=1)


class Grip(Table):
    """Defaults of a grip job; a request may replace each."""

    force_mN: Positive = 20.0
    hold_s: Positive = 4.0
    load_s: Positive = 2.0
    approach_um_per_s: Positive = 20.0
    seek_um_per_s: Positive = 4.0
    contact_force_mN: Positive = 2.0
    zero_s: Positive = 0.4


class Hysteresis(Table):
    """Normalised Bouc-Wen shape: dh/dt = A du/dt - b|du/dt|h - g du/dt|h|, y = d u - h."""

    A_over_d: NotNegative
    b_times_U: NotNegative
    g_times_U: float
    full_drive_V: Positive


class Simulation(Table):
    """The simulated rig: what the plant is, which no other program may know."""

    seed: int = Field(default=1, ge=0)
    substep_s: Positive = 0.001
    natural_frequency_rad_per_s: Positive
    damping_ratio: Positive
    compliance_um_per_mN: Positive
    piezo_um_per_V: Positive
    hysteresis: Hysteresis
    creep_per_decade: NotNegative
    sensor_noise_um: NotNegative
    sensor_step_um: Positive
    output_step_V: Positive
    output_lag_s: NotNegative
    actuation_delay_s: NotNegative
    """Lockstep: from the sample to the arrival of the voltage."""
    bead: bool = True
    bead_contact_um: float
    environment_stiffness_mN_per_um: Positive
    baud: int = Field(default=115200, ge=1200)
    truth: bool = True


class Supervisor(Table):
    """Where the supervisor listens."""

    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=1, le=65535)


class RigFile(Table):
    """A whole rig file."""

    rig: Rig
    bus: Bus = Bus()
    sensor: Sensor
    output: Output
    model: Model = Model()
    law: Law = Law()
    limits: Limits
    safety: Safety = Safety()
    part: Part
    grip: Grip = Grip()
    supervisor: Supervisor = Supervisor()
    simulation: Simulation | None = None

    @property
    def lockstep(self) -> bool:
        """Whether the rig paces the loop."""
        return self.rig.time == "lockstep"

    def digest(self) -> str:
        """What every program of a rig must agree on."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]


def read_rig(path: Path) -> RigFile:
    """Read a rig file.

    Raises
    ------
    ConfigError
        Where the file is missing, is not TOML, or has an unknown key or an impossible value.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"rig file {path}: {error.strerror}") from error
    try:
        return parse_rig(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"rig file {path} is not TOML: {error}") from error
    except ConfigError as error:
        raise ConfigError(f"rig file {path}:\n{error}") from error


def parse_rig(tables: dict[str, Any]) -> RigFile:
    """Check the tables of a rig file; raises ConfigError with one line for each fault."""
    try:
        return RigFile.model_validate(tables)
    except ValidationError as error:
        lines = [
            f"  {'.'.join(str(part) for part in fault['loc'])} = {fault['input']!r}: {fault['msg']}"
            for fault in error.errors(include_url=False)
        ]
        raise ConfigError("\n".join(lines)) from error
