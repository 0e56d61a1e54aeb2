"""The rig file: one frozen tree, unknown keys and impossible values refused."""

import hashlib
from collections.abc import Mapping
from math import ceil
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from pincette.config.instruments import Output, Sensor
from pincette.config.jobs import Grip, Track
from pincette.config.laws import Law, default_set
from pincette.config.limits import Limits, Safety
from pincette.config.model import Model
from pincette.config.programs import Bus, Foxglove, RealTime, Recorder, Sila, Supervisor
from pincette.config.second import Second, check_arms
from pincette.config.simulation import Simulation
from pincette.config.tables import Positive, Table
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.parameters import ParameterSet
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette.core.service import canonical_name, member_services
from pincette.core.topics import LOOP

ComposedName = Annotated[str, AfterValidator(canonical_name)]


def _apart(programs: tuple[str, ...]) -> tuple[str, ...]:
    """Programs of which no two run the same service."""
    for service in LOOP:
        having = [name for name in programs if service in member_services(name)]
        if len(having) > 1:
            raise ValueError(f"{service} is in {having[0]!r} and in {having[1]!r}: wanted in one")
    return programs


class Rig(Table):
    """Name of the rig, its control period, its kind of time, and which services run together."""

    name: str = Field(pattern=r"^[a-z][a-z0-9-]{0,30}$")
    """Appears in every key of the bus, in records, and at the supervisor."""
    period_s: float = Field(default=0.02, gt=0, le=1.0)
    """One sample, one step of the law, one command."""
    time: Literal["real", "lockstep"] = "real"
    """``real``: the sensor samples on a grid of this machine's clock. ``lockstep``: the simulated
    rig sets the pace, and the same job gives bit-identical results."""
    composed: Annotated[tuple[ComposedName, ...], AfterValidator(_apart)] = Field(
        default=(), strict=False
    )
    """Programs that run several services of the loop in one process: ``"loop"`` all of them,
    ``"estimator+controller"`` those two. A service that is in none of them is its own program."""


class Part(Table):
    """The object to be gripped, as the plan assumes it."""

    name: str
    """Description for the operator."""
    contact_um: float
    """Position of the driven arm at first touch."""
    contact_tolerance_um: Positive
    """How far the first touch may be from there, either way."""
    stiffness_mN_per_um: Positive
    """K_e: the part in series with the passive arm."""
    stiffness_tolerance: float = Field(default=0.3, gt=0, lt=1)
    """Relative tolerance of the stiffness; the stability check uses the worst case."""


class Calibrating(Table):
    """How long the result of a calibration is valid."""

    valid_days: Positive | None = None
    """From the measurement on; None: without limit."""


ROUNDING = 1e-6
"""Periods by which a quotient of two decimal numbers may be off."""
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
    "sila": True,
    "foxglove": True,
    "supervisor": {"names", "behind", "keys", "webhooks", "mail"},
}
"""What may differ between programs: nothing of the loop works with it."""


class RigFile(Table):
    """A whole rig file."""

    rig: Rig
    bus: Bus = Bus()
    sensor: Sensor
    output: Output
    second: Second | None = None
    """A second driven arm; without it the rig has one, and a passive arm."""
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
    sila: Sila = Sila()
    foxglove: Foxglove = Foxglove()
    realtime: RealTime = RealTime()
    simulation: Simulation | None = None

    @model_validator(mode="after")
    def _arms_fit(self) -> Self:
        check_arms(self.sensor, self.output, self.second, self.simulation)
        return self

    @property
    def arms(self) -> tuple["RigFile", ...]:
        """The rig as one of a single arm, for each arm; of a rig of one arm itself."""
        second = self.second
        if second is None:
            return (self,)
        simulations = (None, None) if self.simulation is None else self.simulation.arms
        first = self.model_copy(update={"second": None, "simulation": simulations[0]})
        update = {
            "sensor": second.sensor,
            "output": second.output,
            "model": second.model,
            "limits": second.limits,
            "part": self.part.model_copy(update={"contact_um": second.contact_um}),
            "simulation": simulations[1],
        }
        return first, first.model_copy(update=update)

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
        return next((name for name in composed if service in member_services(name)), service)

    @property
    def voltage_limits(self) -> VoltageLimits:
        """What the actuator puts out at most, from one period to the next."""
        limits = self.limits
        return VoltageLimits(
            min_V=limits.voltage_min_V,
            max_V=limits.voltage_max_V,
            slew_V=limits.slew_V_per_s * self.rig.period_s,
            sweep_V=limits.sweep_V,
            step_V=self.output.step_V,
        )

    @property
    def law_set(self) -> ParameterSet:
        """The set of a law that names none: the rig file's, or what the model in use allows."""
        return self.law.set or default_set(identified=self.model.free_response is not None)

    @property
    def law_settings(self) -> LawSettings:
        """The law of jobs that choose none, with all its gains."""
        return self.law.settings(self.law_set)

    @property
    def monitors(self) -> MonitorLimits:
        """The hard limits that the actuator holds every sample against, and the controller too."""
        limits, safety, period_s = self.limits, self.safety, self.rig.period_s
        margin_um = safety.position_margin * (limits.position_max_um - limits.position_min_um)
        return MonitorLimits(
            period_s=period_s,
            force_mN=safety.force_factor * limits.force_max_mN,
            force_samples=safety.force_samples,
            following_um=safety.following_um,
            following_s=safety.following_s,
            following_samples=ceil(safety.following_for_s / period_s - ROUNDING),
            position_min_um=limits.position_min_um - margin_um,
            position_max_um=limits.position_max_um + margin_um,
            position_samples=safety.position_samples,
            fastest_um_per_s=limits.slew_V_per_s * abs(self.model.piezo_um_per_V),
        )

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
        if self.second is not None:
            known["second.sensor"] = self.second.sensor.serial_number
            known["second.output"] = self.second.output.serial_number
        return {table: number for table, number in known.items() if number}

    def digest(self) -> str:
        """What every program of a rig must agree on; how a rig is looked after is none of it."""
        text = self.model_dump_json(exclude=UNSHARED)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
