"""The rig file: one immutable tree; unknown keys and impossible values are rejected."""

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
from pincette.control.arm.plant import OutputTiming
from pincette.control.arm.shaping import LAST, shaping_interval_s
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.parameters import ParameterSet
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette.core.service import canonical_name, member_services
from pincette.core.topics import LOOP, RIG_NAME

ComposedName = Annotated[str, AfterValidator(canonical_name)]


def _apart(programs: tuple[str, ...]) -> tuple[str, ...]:
    """Validate that no two programs run the same service."""
    for service in LOOP:
        having = [name for name in programs if service in member_services(name)]
        if len(having) > 1:
            raise ValueError(
                f"{service} is in {having[0]!r} and in {having[1]!r}: it must be in one"
            )
    return programs


class Rig(Table):
    """Name of the rig, its control period, its type of time, and the services that run together."""

    name: str = Field(pattern=f"^{RIG_NAME}$")
    """Name of the rig; it is used in every key of the bus, in records, and in the supervisor."""
    period_s: float = Field(default=0.02, gt=0, le=1.0)
    """Control period: one sample, one step of the law and one command are made in each."""
    time: Literal["real", "lockstep"] = "real"
    """Type of time. ``real``: the sensor samples on a grid of this machine's clock. ``lockstep``:
    the simulated rig sets the pace, and repeated jobs give bit-identical results.
    """
    composed: Annotated[tuple[ComposedName, ...], AfterValidator(_apart)] = Field(
        default=(), strict=False
    )
    """Programs that run several services of the loop in one process: ``"loop"`` runs all,
    ``"estimator+controller"`` runs these two. Every service not listed is a separate program.
    """


class Part(Table):
    """The part to be gripped, as assumed by plans."""

    name: str
    """Description for the operator."""
    contact_um: float
    """Position of the driven arm at first contact."""
    contact_tolerance_um: Positive
    """Largest deviation of the first contact from ``contact_um``, in either direction."""
    stiffness_mN_per_um: Positive
    """K_e: stiffness of the part in series with the passive arm."""
    stiffness_tolerance: float = Field(default=0.3, gt=0, lt=1)
    """Relative tolerance of the stiffness; the stability check uses the worst case."""


class Calibrating(Table):
    """Validity of calibration results."""

    valid_days: Positive | None = None
    """Time for which a result is valid after its measurement; None: unlimited."""
    valid_strokes: Annotated[int, Field(ge=1)] | None = None
    """Number of strokes since the last accepted calibration after which it is due; None:
    unlimited."""
    valid_contacts: Annotated[int, Field(ge=1)] | None = None
    """Number of contacts since the last accepted calibration after which it is due; None:
    unlimited."""
    valid_hours: Positive | None = None
    """Time with the loop armed since the last accepted calibration after which it is due; None:
    unlimited."""


ROUNDING = 1e-6
"""Tolerance, in periods, of a quotient of two decimal numbers."""
JOINED = "rigs"
"""Folder for rigs that use another rig's router, inside that rig's folder."""
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
"""Values that may differ between programs, since no program of the loop uses them."""


class RigFile(Table):
    """A complete rig file."""

    rig: Rig
    bus: Bus = Bus()
    sensor: Sensor
    output: Output
    second: Second | None = None
    """Second driven arm; None: one driven and one passive arm."""
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

    @model_validator(mode="after")
    def _shaping_fits(self) -> Self:
        interval_s, period_s = self.shaping_s, self.rig.period_s
        if self.second is not None and (interval_s or self.second.output.shaping):
            raise ValueError(
                "[output] shaping = true on a rig of two arms: their outputs do not share a "
                "clock; omit shaping, and fit an RC of 3.3 ms before each amplifier"
            )
        if interval_s is None:
            if self.output.shaping_interval_s is not None:
                raise ValueError(
                    "[output] shaping_interval_s is given without shaping = true: add that, "
                    "or omit the interval"
                )
            return self
        observer = self.model.force_observer
        if observer != "quasi_static":
            raise ValueError(
                f'[output] shaping = true with model.force_observer = "{observer}", which '
                'assumes unshaped steps: choose "quasi_static", or omit shaping'
            )
        delay_s = self.model.output(period_s).delay_s
        if delay_s + LAST * interval_s >= period_s:
            raise ValueError(
                "[output] shaping = true: the last part of a step is written "
                f"{1000.0 * (delay_s + LAST * interval_s):.2f} ms after its sample, must be "
                f"below the period of {1000.0 * period_s:g} ms: choose a longer period, or "
                "omit shaping"
            )
        return self

    @property
    def arms(self) -> tuple["RigFile", ...]:
        """Return a one-arm rig for each arm; for a rig with one arm, return the rig itself."""
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
        """Return whether the simulated rig sets the pace of the loop."""
        return self.rig.time == "lockstep"

    @property
    def programs(self) -> tuple[str, ...]:
        """Return the programs of the loop, in the order of processing a sample."""
        return tuple(dict.fromkeys(map(self.program_of, LOOP)))

    def program_of(self, service: str) -> str:
        """Return the program that runs a service of the loop."""
        composed = self.rig.composed
        return next((name for name in composed if service in member_services(name)), service)

    @property
    def voltage_limits(self) -> VoltageLimits:
        """Return the limits of the voltage and of its change in one period."""
        limits = self.limits
        return VoltageLimits(
            min_V=limits.voltage_min_V,
            max_V=limits.voltage_max_V,
            slew_V=limits.slew_V_per_s * self.rig.period_s,
            sweep_V=limits.sweep_V,
            step_V=self.output.step_V,
        )

    @property
    def shaping_s(self) -> float | None:
        """Return the time between two parts of a voltage step; None: steps have one part."""
        if not self.output.shaping:
            return None
        if (given_s := self.output.shaping_interval_s) is not None:
            return given_s
        omega_n = self.model.natural_frequency_rad_per_s
        return shaping_interval_s(omega_n, self.stiffness_ratio)

    @property
    def stiffness_ratio(self) -> float:
        """Return s_p·K_e of the part."""
        return self.model.compliance_um_per_mN * self.part.stiffness_mN_per_um

    @property
    def output_timing(self) -> OutputTiming:
        """Return the delay and lag with which a voltage acts on the arm.

        For a step in parts, they refer to the middle part.
        """
        timing = self.model.output(self.rig.period_s)
        shaping_s = self.shaping_s
        return timing if shaping_s is None else timing._replace(delay_s=timing.delay_s + shaping_s)

    @property
    def law_set(self) -> ParameterSet:
        """Return the parameter set of a law for which none is chosen: that of the rig file, or of
        the model.
        """
        return self.law.set or default_set(identified=self.model.free_response is not None)

    @property
    def law_settings(self) -> LawSettings:
        """Return the law, with all its gains, for jobs that do not choose one."""
        return self.law.settings(self.law_set)

    @property
    def monitors(self) -> MonitorLimits:
        """Return the hard limits with which actuator and controller check every sample."""
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
        """Return whether the rig uses another rig's router, so that the supervisor there serves
        it.
        """
        return self.bus.router is not None

    def home(self, data: Path) -> Path:
        """Return the folder of records and logs.

        Each rig that uses another rig's router has a separate folder.
        """
        return data / JOINED / self.rig.name if self.joins else data

    def simulated_arm(self, data: Path) -> Path:
        """Return the file that stores the state of the simulated arm while its program does not
        run.
        """
        return self.home(data) / "simulated-arm.json"

    def secured(self, pki: Path) -> "RigFile":
        """Return the same rig with a folder of certificates."""
        return self.model_copy(update={"bus": self.bus.model_copy(update={"pki": str(pki)})})

    def listening(self, address: str) -> "RigFile":
        """Return the same rig, with a router that listens at another address than the rig's
        programs.
        """
        return self.model_copy(update={"bus": self.bus.model_copy(update={"listen": address})})

    @property
    def serial_numbers(self) -> dict[str, str]:
        """Return the known serial numbers of the instruments, by table."""
        known = {"sensor": self.sensor.serial_number, "output": self.output.serial_number}
        if self.second is not None:
            known["second.sensor"] = self.second.sensor.serial_number
            known["second.output"] = self.second.output.serial_number
        return {table: number for table, number in known.items() if number}

    def digest(self) -> str:
        """Return the digest on which all programs of a rig must agree.

        It does not cover settings of maintenance.
        """
        text = self.model_dump_json(exclude=UNSHARED)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
