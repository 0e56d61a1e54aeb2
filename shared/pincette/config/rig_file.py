"""The rig file: one frozen tree, unknown keys and impossible values refused."""

import hashlib
from collections.abc import Mapping
from math import ceil
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pincette.config.instruments import Output, Sensor
from pincette.config.laws import Law, default_set
from pincette.config.limits import Limits, Safety
from pincette.config.model import Model
from pincette.config.programs import Bus, Foxglove, RealTime, Recorder, Sila, Supervisor
from pincette.config.simulation import Simulation
from pincette.config.tables import Positive, Table
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.parameters import ParameterSet
from pincette.control.planning.paths import Shape
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


class QuickGrip(Table):
    """Speeds of a quick grip, at most: its force, the period and the slew limit may ask for less.

    A request may replace the first three.
    """

    approach_um_per_s: Positive = 120.0
    """Peak speed of the free arm on its way to the part and back."""
    seek_um_per_s: Positive = 40.0
    """Speed with which the part is touched, and the load begins."""
    load_um_per_s: Positive = 40.0
    """Peak speed while the part is loaded and unloaded."""
    zero_s: Positive = 0.3
    """Time at rest in which the force estimate is set to zero."""


class Grip(Table):
    """Defaults of a grip job; a request may replace each.

    The three speeds are those of a gentle grip, and of other jobs.
    """

    profile: Literal["quick", "gentle"] | None = None
    """``quick``: the load begins at the touch without a stop, and the contact line is followed as
    it is identified; ``gentle``: the arm stops at the touch, and the line is identified over the
    load. None: quick where the free response is identified and the force is large enough."""
    force_mN: Positive = 20.0
    """Force that is held, compressive."""
    hold_s: Positive = 4.0
    """How long it is held."""
    load_s: Positive = 2.0
    """Time from the touch to the force; unloading takes as long."""
    approach_um_per_s: Positive = 20.0
    """Speed until just before the contact."""
    seek_um_per_s: Positive = 4.0
    """Speed from there until the part is touched."""
    contact_force_mN: Positive = 2.0
    """Estimated force that counts as touch."""
    zero_s: Positive = 0.4
    """Time at rest before the arm moves, in which the force estimate is set to zero."""
    quick: QuickGrip = QuickGrip()
    """Of a quick grip."""


class Track(Table):
    """Defaults of a track job; a request may replace each. Other values are those of a grip."""

    shape: Shape = "sinusoid"
    """Of the path."""
    force_mean_mN: Positive = 12.0
    """Middle of a sinusoid or triangle."""
    force_pp_mN: Positive = 20.0
    """Its height, peak to peak."""
    frequency_hz: Positive = 0.5
    """Of a sinusoid or triangle."""
    cycles: int = Field(default=5, ge=1, le=1000)
    """At full amplitude; one more before and one after blend in and out."""
    levels_mN: tuple[Positive, ...] = Field(
        default=(5.0, 10.0, 15.0, 20.0), min_length=1, max_length=100, strict=False
    )
    """Of steps, in their order."""
    dwell_s: Positive = 2.0
    """At each level."""
    rate_um_per_s: Positive = 60.0
    """Highest speed of x_r along a path; steps reach it."""
    acceleration_um_per_s2: Positive = 2000.0
    """Highest acceleration of x_r along a path; steps and corners reach it."""


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
        return {table: number for table, number in known.items() if number}

    def digest(self) -> str:
        """What every program of a rig must agree on; how a rig is looked after is none of it."""
        text = self.model_dump_json(exclude=UNSHARED)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
