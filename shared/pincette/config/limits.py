"""What a rig bears, how it fails safe, and the limits that the safety module makes of both."""

from math import ceil

from pydantic import Field, model_validator

from pincette.config.tables import NotNegative, Positive, Table
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits

ROUNDING = 1e-6
"""Periods by which a quotient of two decimal numbers may be off."""


class Limits(Table):
    """What the rig bears. The actuator enforces the voltage limits, the supervisor all."""

    voltage_min_V: float
    """At the amplifier's input."""
    voltage_max_V: float
    """At the amplifier's input."""
    slew_V_per_s: Positive
    """Highest change of the voltage, whoever asks for it."""
    sweep_V: Positive = 0.1
    """Amplitude of a swept sine; near the resonance the arm moves 1/(2ζ) times as far."""
    position_min_um: float
    """Lowest position that a job may plan or come to."""
    position_max_um: float
    """Highest position that a job may plan or come to."""
    force_max_mN: Positive
    """Highest force that a job may plan or come to."""

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
    """Age at which a command is too old; without a newer one by then the actuator trips."""
    ramp_s: float = Field(default=0.035, ge=0.005, le=2.0)
    """From the voltage at a trip to the safe one, where the arm is free."""
    safe_V: float = 0.0
    """At which the arm is free and at rest."""
    freeze_s: float = Field(default=10.0, ge=0.0, le=600.0)
    """How long a held part is kept by a frozen voltage before the ramp releases it."""
    force_factor: float = Field(default=1.25, ge=1.05, le=3.0)
    """Of ``limits.force_max_mN``, at which the controller's own guard ends a program gently: the
    estimated force above which the actuator lets go, whoever commands."""
    force_samples: int = Field(default=3, ge=1, le=50)
    """Samples in a row above it: time for the guard to have brought the force down."""
    following_um: Positive = 3.0
    """How far the arm may be from where the law wants it while that rests, and"""
    following_s: NotNegative = 0.05
    """how much further for each µm/s at which it moves."""
    following_for_s: float = Field(default=0.12, gt=0.0, le=2.0)
    """How long without a break beyond it. A part lost at ``force_max_mN`` lets the arm jump by
    s_p·F, which the slew limit makes up for in s_p·F/(d_p·slew): with the demo's numbers 0.1 s."""
    position_margin: float = Field(default=0.1, ge=0.0, le=1.0)
    """Share of the range of ``limits.position_*`` by which a measured position may lie outside."""
    position_samples: int = Field(default=3, ge=1, le=50)
    """Samples in a row outside that."""
    lease_s: float = Field(default=10.0, ge=0.0, le=600.0)
    """In real time a program that hears nothing of the supervisor for so long is stopped, as its
    job says; 0: it plays to its end. The default outlasts a slow disk, not a supervisor that died.
    """


def voltage_limits(limits: Limits, period_s: float) -> VoltageLimits:
    """What may be put out; V, and V from one period to the next."""
    return VoltageLimits(
        min_V=limits.voltage_min_V,
        max_V=limits.voltage_max_V,
        slew_V=limits.slew_V_per_s * period_s,
        sweep_V=limits.sweep_V,
    )


def monitor_limits(limits: Limits, safety: Safety, period_s: float) -> MonitorLimits:
    """The hard limits: those of the rig, with the room that the gentle reactions need."""
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
    )
