"""What travels between programs: frozen data, units in the field names.

A sample keeps its number: everything derived from sample k carries ``seq`` k, and the ``epoch``
of the arming it belongs to. A message is invalid until somebody says that it is valid.
"""

from dataclasses import dataclass
from typing import NewType

from pincette.control.planning.program import Program
from pincette.control.planning.sweep import Sweep

Document = NewType("Document", str)
"""A text of many lines, as JSON; other texts are short."""

VOLTAGE_MAX, VOLTAGE_MIN, SLEW_UP, SLEW_DOWN = 1, 2, 4, 8
"""Bits of ``limits_active``."""


@dataclass(frozen=True, slots=True)
class Position:
    """One measurement of the arm's tip by the sensor, at its own grid point."""

    epoch: int
    seq: int
    t_s: float
    x_um: float
    valid: bool = False
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Burst:
    """What the sensor acquired from its own buffer up to sample ``seq``: one each 1/``rate_hz``."""

    epoch: int
    seq: int
    rate_hz: float
    x_um: tuple[float, ...]
    drive_V: tuple[float, ...]
    """At the amplifier's input, as measured beside the position."""
    valid: bool = False


@dataclass(frozen=True, slots=True)
class Estimate:
    """Contact force and lumped perturbation, from position k and the voltage applied at k-1."""

    epoch: int
    seq: int
    x_um: float
    force_mN: float
    force_uncertainty_mN: float
    perturbation_mN: float
    zero_age_s: float | None
    zero_refusal: str
    applied_V: float
    applied_seq: int
    limits_active: int
    tripped: bool
    degraded: bool
    valid: bool = False
    fault: str = ""
    """Why it is not valid."""


@dataclass(frozen=True, slots=True)
class Command:
    """The voltage the controller asks for, based on sample ``seq``."""

    epoch: int
    seq: int
    owner: int
    voltage_V: float
    part_held: bool
    """What a fault means from here on: freeze (held) or ramp to the safe voltage (free)."""
    zero: bool
    """The estimator shall re-zero at this seq."""
    final: bool
    """The last command of this arming."""
    valid: bool = False
    fault: str = ""
    """Why it is not valid: what the controller cannot see."""
    sweep: Sweep | None = None
    """Play this about ``voltage_V``; the commands after it say that it may go on."""


@dataclass(frozen=True, slots=True)
class Applied:
    """What the actuator did in tick ``seq``; ``part_held, zero, final`` echo the command."""

    epoch: int
    seq: int
    voltage_V: float
    state: str
    cause: str
    limits_active: int
    part_held: bool
    zero: bool
    final: bool
    answered: bool
    """False where no command for this tick was taken and the voltage was kept or ramped."""
    refused: int
    command_age_s: float


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The controller's own view of sample ``seq``: the references that hold for this sample."""

    epoch: int
    seq: int
    playing: bool
    phase: str
    segment: int
    segment_tick: int
    x_r_um: float
    x_d_um: float
    force_r_mN: float
    sliding_um: float
    """s; of DSMIFC, whose s is a force, s over K̄."""
    band_um: float
    """Half width of the band that s stays in, or comes back to."""
    perturbation_mN: float
    """p̂, with the force that the law was fed."""
    perturbation_error_mN: float
    """p̃, likewise."""
    residual_um: float
    """x minus what (17) predicted."""
    outcome: str
    contact_x_um: float | None
    contact_stiffness_mN_per_um: float | None
    held: bool
    acted: str
    """Actions that took effect at this seq."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What only a simulated rig knows; nothing but the record listens."""

    seq: int
    x_um: float
    force_mN: float
    voltage_V: float


@dataclass(frozen=True, slots=True)
class Arm:
    """Start a new epoch. Refused where the rig file's digest differs."""

    epoch: int
    owner: int
    digest: str
    calibration: Document = Document("")
    """The model in use as JSON, over that of the rig file; see ``config.calibration``."""
    capture_hz: float = 0.0
    """As in the program that is played."""


@dataclass(frozen=True, slots=True)
class Load:
    """Give the controller a program to play at the next arming."""

    program: Program


@dataclass(frozen=True, slots=True)
class Act:
    """Ask the controller to act at ``at_seq``, or at its next tick (None)."""

    action: str
    at_seq: int | None = None


@dataclass(frozen=True, slots=True)
class Trip:
    """Ask the actuator to go to its safe state and latch."""

    cause: str


@dataclass(frozen=True, slots=True)
class Reset:
    """Clear the actuator's latch; ``acknowledge`` must be true."""

    acknowledge: bool = False


@dataclass(frozen=True, slots=True)
class Order:
    """Operate a simulated rig: what a person at the bench does, or a fault that befalls it.

    Refused unless the rig file allows it.
    """

    target: str
    """``part``, ``weight``, ``arm``, ``sensor`` or ``output``."""
    what: str
    """What is done to it: ``remove``, ``off``, ``stuck`` …"""
    value: float | None = None
    after_s: float = 0.0
    """From now on, in the rig's own time."""
    for_s: float | None = None
    """How long a fault lasts; None: until ``heal``."""


@dataclass(frozen=True, slots=True)
class StatusRequest:
    """Ask any program how it is."""


@dataclass(frozen=True, slots=True)
class Status:
    """How a program is; ``instance`` differs for every start of it."""

    service: str
    version: str
    instance: int
    digest: str
    epoch: int
    steps: int
    missed: int
    refused: int
    detail: str
    calibration: str = ""
    """Digest of the model in use; empty: that of the rig file."""


@dataclass(frozen=True, slots=True)
class Done:
    """The question was taken; it acts at ``seq``."""

    seq: int


Message = (
    Position
    | Burst
    | Estimate
    | Command
    | Applied
    | Telemetry
    | Truth
    | Arm
    | Load
    | Act
    | Trip
    | Reset
    | Order
    | StatusRequest
    | Status
    | Done
)
Sample = Position | Burst | Estimate | Command | Applied | Telemetry
