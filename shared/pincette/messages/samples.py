"""What is published: samples of the loop, each with its number, and what is told beside them."""

from dataclasses import dataclass

from pincette.control.planning.sweep import Sweep
from pincette.latency.histogram import Distribution


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
    force_mN: float | None = None
    """The estimate it was computed from; None without a valid zero."""
    x_d_um: float | None = None
    """Where the law wants the arm at sample ``seq``; None where no law has steered it there."""


@dataclass(frozen=True, slots=True)
class Applied:
    """What the actuator did in tick ``seq``; ``part_held, zero, final`` echo the command."""

    epoch: int
    seq: int
    voltage_V: float
    state: str
    """latched, idle, armed, frozen or ramping."""
    cause: str
    """Of the trip: one of ``control.safety.causes.Cause``, a colon, and words."""
    limits_active: int
    """Bits: 1 voltage at its maximum, 2 at its minimum, 4 slew limited upwards, 8 downwards."""
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
    """Actions that took effect at this seq; ``let_go`` and ``retract`` are told as ``stop``, after
    ``lease`` where a lease has ended and nobody has asked.
    """
    paused: bool = False
    """From this sample on the references rest, and the segment's time stands still."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What only a simulated rig knows; nothing but the record listens."""

    seq: int
    x_um: float
    force_mN: float
    voltage_V: float


@dataclass(frozen=True, slots=True)
class JobNotice:
    """A job as the supervisor has it, told whenever its state or its phase changes."""

    job: str
    kind: str
    epoch: int
    """Of its samples; 0 before it is armed."""
    state: str
    phase: str
    cause: str
    held: bool
    at: str
    """UTC."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How punctual a program of the loop has been since its epoch began; in real time only."""

    epoch: int
    seq: int
    """The newest sample that is counted; -1 before the first."""
    service: str
    missed: int
    """Samples and points of the grid that were skipped."""
    lateness: Distribution
    """Of the wake-ups against the program's own grid; without one, of the samples' arrival against
    the grid of the earliest among them."""
    age: Distribution
    """From the first arrival of a sample's number to the step with what the program acts on."""
    execution: Distribution
    """Of the steps, from their begin until all was told; instruments included."""
