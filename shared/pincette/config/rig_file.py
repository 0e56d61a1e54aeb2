"""The rig file: one frozen tree, unknown keys and impossible values refused."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.config.law import Law
from pincette.config.model import Model
from pincette.config.recorder import Recorder
from pincette.config.simulation import Simulation
from pincette.config.tables import NotNegative, Place, Positive, Table, Url
from pincette.control.planning.paths import Shape

Options = dict[str, str | int | float | bool]
"""What only one driver understands; it checks them itself."""
SerialNumber = Annotated[str, Field(max_length=60)]
"""Of an instrument, as its plate has it; empty: not known."""


class Rig(Table):
    """Name of the rig, its control period and its kind of time."""

    name: str = Field(pattern=r"^[a-z][a-z0-9-]{0,30}$")
    period_s: float = Field(default=0.02, gt=0, le=1.0)
    time: Literal["real", "lockstep"] = "real"


class Bus(Table):
    """Where the programs listen: the router at ``port``, the others at the ports after it."""

    host: str = "127.0.0.1"
    port: int = Field(default=7447, ge=1024, le=65500)
    router: Place | None = None
    """HOST:PORT of another rig's router that this rig joins: it has no router of its own then, and
    is served by the supervisor at that one. None: its router is its own."""

    @property
    def router_at(self) -> tuple[str, int]:
        """Host and port of the router, whosever it is."""
        if self.router is None:
            return self.host, self.port
        host, _, port = self.router.rpartition(":")
        return host.strip("[]"), int(port)


class Sensor(Table):
    """The position sensor: driver, where it is, its range in µm."""

    driver: str
    url: Url
    serial_number: SerialNumber = ""
    minimum_um: float
    maximum_um: float
    offset_um: float = 0.0
    """Subtracted from the reading, so that the arm at rest is near zero."""
    direction: Literal[1, -1] = 1
    """+1 where closing the gripper raises the reading."""
    timeout_s: Positive = 0.1
    noise_um: NotNegative
    """r.m.s., as identified; enters the force uncertainty."""
    record: str | None = None
    """File that every byte to and from the instrument is written to."""
    options: Options = Field(default_factory=Options)


class Output(Table):
    """The voltage output that drives the amplifier."""

    driver: str
    url: Url
    serial_number: SerialNumber = ""
    timeout_s: Positive = 0.1
    record: str | None = None
    """File that every byte to and from the instrument is written to."""
    on_silence: Literal["safe", "holds", "unstated"] = "unstated"
    """What the hardware does by itself where its host falls silent: go to a safe value, or hold."""
    options: Options = Field(default_factory=Options)


class Limits(Table):
    """What the rig bears. The actuator enforces the voltage limits, the supervisor all."""

    voltage_min_V: float
    voltage_max_V: float
    slew_V_per_s: Positive
    sweep_V: Positive = 0.1
    """Amplitude of a swept sine; near the resonance the arm moves 1/(2ζ) times as far."""
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


class Track(Table):
    """Defaults of a track job; a request may replace each. What is not here is as in a grip."""

    shape: Shape = "sinusoid"
    force_mean_mN: Positive = 12.0
    force_pp_mN: Positive = 20.0
    frequency_hz: Positive = 0.5
    cycles: int = Field(default=5, ge=1, le=1000)
    levels_mN: tuple[Positive, ...] = Field(
        default=(5.0, 10.0, 15.0, 20.0), min_length=1, max_length=100, strict=False
    )
    dwell_s: Positive = 2.0
    rate_um_per_s: Positive = 60.0
    """Highest speed of x_r along a path; steps use it up."""
    acceleration_um_per_s2: Positive = 2000.0
    """Highest acceleration of x_r along a path; steps and corners use it up."""


class Calibrating(Table):
    """How long what a calibration has found holds."""

    valid_days: Positive | None = None
    """From the measurement on; None: without an end."""


class Supervisor(Table):
    """Where the supervisor listens."""

    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=1, le=65535)


JOINED = "rigs"
"""Folder of the rigs that have joined, below that of the rig they have joined."""
UNSHARED: Mapping[str, set[str] | bool] = {
    "sensor": {"serial_number"},
    "output": {"serial_number"},
    "calibration": True,
    "recorder": True,
}
"""What may differ between programs: nothing of the loop works with it."""


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
    track: Track = Track()
    calibration: Calibrating = Calibrating()
    supervisor: Supervisor = Supervisor()
    recorder: Recorder = Recorder()
    simulation: Simulation | None = None

    @property
    def lockstep(self) -> bool:
        """Whether the rig paces the loop."""
        return self.rig.time == "lockstep"

    @property
    def joins(self) -> bool:
        """Whether it joins the router of another rig, and is served by the supervisor there."""
        return self.bus.router is not None

    def home(self, data: Path) -> Path:
        """Where records and logs go: each rig that joins another's router has its own folder."""
        return data / JOINED / self.rig.name if self.joins else data

    @property
    def serial_numbers(self) -> dict[str, str]:
        """Of the instruments, by table; those that are known."""
        known = {"sensor": self.sensor.serial_number, "output": self.output.serial_number}
        return {table: number for table, number in known.items() if number}

    def digest(self) -> str:
        """What every program of a rig must agree on; how a rig is looked after is none of it."""
        text = self.model_dump_json(exclude=UNSHARED)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
