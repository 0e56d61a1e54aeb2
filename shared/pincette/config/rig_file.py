"""The rig file: one frozen tree, unknown keys and impossible values refused."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pincette.config.bus import Bus
from pincette.config.instruments import Output, Sensor
from pincette.config.jobs import Grip, Track
from pincette.config.law import Law
from pincette.config.limits import Limits, Safety, monitor_limits, voltage_limits
from pincette.config.model import Model
from pincette.config.realtime import RealTime
from pincette.config.recorder import Recorder
from pincette.config.simulation import Simulation
from pincette.config.tables import Positive, Table
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette.service import composed_name, services_of
from pincette.topics import LOOP

ComposedName = Annotated[str, AfterValidator(composed_name)]


def _apart(programs: tuple[str, ...]) -> tuple[str, ...]:
    """Programs of which no two run the same service."""
    for service in LOOP:
        having = [name for name in programs if service in services_of(name)]
        if len(having) > 1:
            raise ValueError(f"{service} is in {having[0]!r} and in {having[1]!r}: wanted in one")
    return programs


class Rig(Table):
    """Name of the rig, its control period, its kind of time, and which services run together."""

    name: str = Field(pattern=r"^[a-z][a-z0-9-]{0,30}$")
    """In every key of the bus, in records, and at the supervisor."""
    period_s: float = Field(default=0.02, gt=0, le=1.0)
    """One sample, one step of the law, one command."""
    time: Literal["real", "lockstep"] = "real"
    """``real``: the sensor keeps a grid of this machine's clock. ``lockstep``: the simulated rig
    paces, and the same job gives the same bits."""
    composed: Annotated[tuple[ComposedName, ...], AfterValidator(_apart)] = Field(
        default=(), strict=False
    )
    """Programs that run several services of the loop in one process: ``"loop"`` all of them,
    ``"estimator+controller"`` those two. A service that is in none is a program by itself."""


class Part(Table):
    """The object to be gripped, as the plan assumes it."""

    name: str
    """In words, for people."""
    contact_um: float
    """Position of the driven arm at first touch."""
    contact_tolerance_um: Positive
    """How far the first touch may be from there, either way."""
    stiffness_mN_per_um: Positive
    """K_e: the part in series with the passive arm."""
    stiffness_tolerance: float = Field(default=0.3, gt=0, lt=1)
    """Share by which the stiffness may differ; the judgement of stability takes the worst."""


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
    """Of REST and the page."""
    names: tuple[HostName, ...] = Field(default=(), max_length=20, strict=False)
    """Names by which it is reached, beside its address; a request for another one is refused."""
    behind: Literal["nothing", "container"] = "nothing"
    """``container``: a promise that its port is published on the loopback of the host alone, so
    that it may listen on every address of its container without keys."""


JOINED = "rigs"
"""Folder of the rigs that have joined, below that of the rig they have joined."""
UNSHARED: Mapping[str, set[str] | bool] = {
    "rig": {"composed"},
    "bus": {"upstream", "served_at"},
    "sensor": {"serial_number"},
    "output": {"serial_number"},
    "calibration": True,
    "realtime": True,
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
    realtime: RealTime = RealTime()
    simulation: Simulation | None = None

    @property
    def lockstep(self) -> bool:
        """Whether the rig paces the loop."""
        return self.rig.time == "lockstep"

    @property
    def programs(self) -> tuple[str, ...]:
        """Programs of the loop, in the order of a tick."""
        return tuple(dict.fromkeys(map(self.program_of, LOOP)))

    def program_of(self, service: str) -> str:
        """The program that runs a service of the loop."""
        composed = self.rig.composed
        return next((name for name in composed if service in services_of(name)), service)

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

    def listening(self, address: str) -> "RigFile":
        """The same rig with a router that listens on another address than its programs use."""
        return self.model_copy(update={"bus": self.bus.model_copy(update={"listen": address})})

    @property
    def serial_numbers(self) -> dict[str, str]:
        """Of the instruments, by table; those that are known."""
        known = {"sensor": self.sensor.serial_number, "output": self.output.serial_number}
        return {table: number for table, number in known.items() if number}

    def digest(self) -> str:
        """What every program of a rig must agree on; how a rig is looked after is none of it."""
        text = self.model_dump_json(exclude=UNSHARED)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
