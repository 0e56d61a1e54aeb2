"""The rig file: one frozen tree, unknown keys and impossible values refused."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from pincette.config.law import Law
from pincette.config.limits import Limits, Safety, monitor_limits, voltage_limits
from pincette.config.model import Model
from pincette.config.recorder import Recorder
from pincette.config.simulation import Simulation
from pincette.config.tables import NotNegative, Place, Positive, Table, Url
from pincette.control.planning.paths import Shape
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits

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
    pki: str | None = Field(default=None, exclude=True)
    """Folder of certificates, relative to the rig file. None: no link is encrypted or closed to
    anybody. Where the folder is concerns this machine alone: it is told to nobody, recorded
    nowhere, and no part of the digest."""
    identity: str = Field(default="operator", exclude=True)
    """Whose certificate the tools of this machine show, where there are certificates."""

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


HostName = Annotated[str, Field(pattern=r"^[A-Za-z0-9]([A-Za-z0-9.-]{0,252})$")]


class Supervisor(Table):
    """Where the supervisor listens, and how it is reached."""

    host: str = "127.0.0.1"
    """Beyond loopback it starts only where there are keys."""
    port: int = Field(default=8000, ge=1, le=65535)
    names: tuple[HostName, ...] = Field(default=(), max_length=20, strict=False)
    """Names by which it is reached, beside its address; a request for another one is refused."""
    behind: Literal["nothing", "container"] = "nothing"
    """``container``: a promise that its port is published on the loopback of the host alone, so
    that it may listen on every address of its container without keys."""


JOINED = "rigs"
"""Folder of the rigs that have joined, below that of the rig they have joined."""
UNSHARED: Mapping[str, set[str] | bool] = {
    "sensor": {"serial_number"},
    "output": {"serial_number"},
    "calibration": True,
    "recorder": True,
    "supervisor": {"names", "behind"},
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
    def voltage_limits(self) -> VoltageLimits:
        """What the actuator puts out at most, from one period to the next."""
        return voltage_limits(self.limits, self.rig.period_s)

    @property
    def monitors(self) -> MonitorLimits:
        """The hard limits that the actuator holds every sample against, and its mirror."""
        return monitor_limits(self.limits, self.safety, self.rig.period_s)

    @property
    def joins(self) -> bool:
        """Whether it joins the router of another rig, and is served by the supervisor there."""
        return self.bus.router is not None

    def home(self, data: Path) -> Path:
        """Where records and logs go: each rig that joins another's router has its own folder."""
        return data / JOINED / self.rig.name if self.joins else data

    def secured(self, pki: Path) -> "RigFile":
        """The same rig with a folder of certificates."""
        return self.model_copy(update={"bus": self.bus.model_copy(update={"pki": str(pki)})})

    @property
    def serial_numbers(self) -> dict[str, str]:
        """Of the instruments, by table; those that are known."""
        known = {"sensor": self.sensor.serial_number, "output": self.output.serial_number}
        return {table: number for table, number in known.items() if number}

    def digest(self) -> str:
        """What every program of a rig must agree on; how a rig is looked after is none of it."""
        text = self.model_dump_json(exclude=UNSHARED)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
