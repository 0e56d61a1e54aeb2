"""What is published: samples of the loop, each with its number, and what is told beside them."""

from msgspec import UNSET, UnsetType

from pincette.control.planning.sweep import Sweep
from pincette.control.quantities import (
    Epoch,
    Hertz,
    Items,
    Micrometre,
    Millinewton,
    MillinewtonPerMicrometre,
    Number,
    Second,
    Seq,
    Text,
    Volt,
    Whole,
)
from pincette.control.record import FrozenRecord
from pincette.core.faults import Acted, Cause, Fault, Mode, Outcome
from pincette.core.messages.second import (
    SecondApplied,
    SecondCommand,
    SecondEstimate,
    SecondPosition,
    SecondTelemetry,
    SecondTruth,
)
from pincette.latency.histogram import Distribution


class Position(FrozenRecord, frozen=True):
    """One measurement of the arm's tip by the sensor, at its own grid point."""

    epoch: Epoch
    seq: Seq
    t_s: Second
    x_um: Micrometre
    valid: bool = False
    fault: Fault | None = None
    """Why it is no measurement."""
    second: SecondPosition | UnsetType = UNSET
    """Of the second arm; where there is one arm, the field is not sent."""

    @property
    def usable(self) -> bool:
        """Whether each arm there is was measured."""
        return self.valid and (self.second is UNSET or self.second.valid)


class Burst(FrozenRecord, frozen=True):
    """What the sensor acquired from its own buffer up to sample ``seq``: one each 1/``rate_hz``."""

    epoch: Epoch
    seq: Seq
    rate_hz: Hertz
    x_um: Items[Micrometre]
    drive_V: Items[Volt]
    """At the amplifier's input, as measured beside the position."""
    valid: bool = False


class Estimate(FrozenRecord, frozen=True):
    """Contact force and lumped perturbation, from position k and the voltage applied at k-1."""

    epoch: Epoch
    seq: Seq
    x_um: Micrometre
    force_mN: Millinewton
    force_uncertainty_mN: Millinewton
    perturbation_mN: Millinewton
    zero_age_s: Second | None
    zero_refusal: Fault | None
    """Why the force was not zeroed when that was asked for last."""
    applied_V: Volt
    applied_seq: Seq
    limits_active: Whole
    tripped: bool
    degraded: bool
    valid: bool = False
    fault: Fault | None = None
    """Why it is not valid."""
    touch_x_um: Micrometre | None = None
    """Where an arm that should be free has met something; None: nowhere."""
    touch_mN: Millinewton | None = None
    """Least force of that touch: by how far the closing arm lags since a kink in its way, which
    takes no zero, or the force less three uncertainties, below 0 where it is held from behind; by
    a zero that is not confirmed, the force itself where it is above its uncertainty."""
    stroke_change: Number | None = None
    """Change of the arm's stroke since its calibration, as a share, from the last way that began
    with conditioning strokes; None: not compared since the start."""
    stroke_limit: Number | None = None
    """Change up to which noise and repetition explain it."""
    zero_unconfirmed: bool = False
    """True where the zero may hide the force of a part that already pressed when it was taken: the
    estimator knows no zero from before its start, nobody has confirmed that the arm was free, and
    no part has been found at its planned place since."""
    second: SecondEstimate | UnsetType = UNSET
    """Of the second arm; ``valid`` and ``fault`` are of both."""


class Command(FrozenRecord, frozen=True):
    """The voltage the controller asks for, based on sample ``seq``."""

    epoch: Epoch
    seq: Seq
    owner: Whole
    voltage_V: Volt
    part_held: bool
    """What a fault means from here on: freeze (held) or ramp to the safe voltage (free)."""
    zero: bool
    """The estimator shall re-zero at this seq."""
    final: bool
    """The last command of this arming."""
    valid: bool = False
    fault: Fault | None = None
    """Why it is not valid: what the controller cannot see."""
    sweep: Sweep | None = None
    """Play this about ``voltage_V``; the commands after it say that it may go on."""
    force_mN: Millinewton | None = None
    """The estimate it was computed from; None without a valid zero."""
    x_d_um: Micrometre | None = None
    """Where the law wants the arm at sample ``seq``; None where no law has steered it there."""
    segment: Whole | None = None
    """Number of the program's segment that the voltage is of; None: of none."""
    segment_tick: Whole = 0
    """Ticks into it."""
    second: SecondCommand | UnsetType = UNSET
    """Of the second arm. A rig of two arms refuses a command without it, one of one arm with it."""


class Applied(FrozenRecord, frozen=True):
    """What the actuator did in tick ``seq``.

    ``part_held, zero, final, segment, segment_tick`` echo the command.
    """

    epoch: Epoch
    seq: Seq
    voltage_V: Volt
    state: Mode
    cause: Cause
    """Of the trip; empty where there is none."""
    limits_active: Whole
    """Bits: 1 voltage at its maximum, 2 at its minimum, 4 slew limited upwards, 8 downwards."""
    part_held: bool
    zero: bool
    final: bool
    answered: bool
    """False where no command for this tick was taken and the voltage was kept or ramped."""
    refused: Whole
    command_age_s: Second
    faults: Items[Fault] = ()
    """Behind the cause: what was found, why the commands before were not valid, why a freeze has
    ended early."""
    segment: Whole | None = None
    segment_tick: Whole = 0
    slewing_s: Second | None = None
    """Time since the output moved last, a period at most, that the slew limit gave the command
    taken; None in lockstep, where it is a period."""
    unconfirmed: bool = False
    """Whether the output has not confirmed ``voltage_V``: then nobody knows what is put out. Of two
    arms, whether either has not."""
    second: SecondApplied | UnsetType = UNSET
    """Of the second arm."""

    @property
    def confirmed_V(self) -> float | None:
        """Voltage that the output has confirmed; None while it has not confirmed ``voltage_V``."""
        return None if self.unconfirmed else self.voltage_V

    @property
    def confirmed_second_V(self) -> float | None:
        """Confirmed voltage of the second arm; None on a rig of one arm too."""
        return None if self.unconfirmed or self.second is UNSET else self.second.voltage_V


class Telemetry(FrozenRecord, frozen=True):
    """The controller's own view of sample ``seq``: the references that hold for this sample.

    It is published while a program plays, so between jobs the newest one is the last sample of the
    last program, whose ``epoch`` is over.
    """

    epoch: Epoch
    seq: Seq
    playing: bool
    phase: Text
    segment: Whole
    segment_tick: Whole
    x_r_um: Micrometre
    x_d_um: Micrometre
    force_r_mN: Millinewton
    sliding_um: Micrometre
    """s; where s is a force, s over K̄."""
    band_um: Micrometre
    """Half width of the band that s stays in, or comes back to."""
    perturbation_mN: Millinewton
    """p̂, with the force that the law was fed."""
    perturbation_error_mN: Millinewton
    """p̃, likewise."""
    residual_um: Micrometre
    """x minus what (17) predicted."""
    outcome: Outcome
    contact_x_um: Micrometre | None
    contact_stiffness_mN_per_um: MillinewtonPerMicrometre | None
    held: bool
    acted: Items[Acted]
    """Actions that took effect at this seq; ``let_go`` and ``retract`` are told as ``stop``, after
    ``lease`` where a lease has ended and nobody has asked.
    """
    paused: bool = False
    """From this sample on the references rest, and the segment's time stands still."""
    touch_x_um: Micrometre | None = None
    """Where the arm met something on its way through free space; None: nothing."""
    touch_mN: Millinewton | None = None
    """With which force, as it turned back."""
    correction_um: Micrometre = 0.0
    """What was learned of earlier cycles, added to x_r for the law."""
    slips: Whole = 0
    """Number of times that the part has given way under moving references."""
    step_um: Micrometre | None = None
    """Step of the position that the voltage does not explain, positive towards the part; None:
    none was found."""
    step_x_um: Micrometre | None = None
    """Position just before that step."""
    step_mN: Millinewton | None = None
    """Estimated force just before it; if the sensor has jumped, the force since."""
    step_after_mN: Millinewton | None = None
    """Estimated force just after it; if the part has slipped, the force since."""
    second: SecondTelemetry | UnsetType = UNSET
    """Of the second arm."""


class GroundTruth(FrozenRecord, frozen=True):
    """True state of a simulated rig when its output was written; only the recorder uses it."""

    seq: Seq
    """Number of writes to the output since the rig program started. It belongs to no epoch, so it
    does not join with the ``seq`` of other topics."""
    x_um: Micrometre
    force_mN: Millinewton
    voltage_V: Volt
    second: SecondTruth | UnsetType = UNSET
    """Of the second arm."""


class JobNotice(FrozenRecord, frozen=True):
    """A job as the supervisor has it, told whenever its state or its phase changes."""

    job: Text
    kind: Text
    epoch: Epoch
    """Of its samples; 0 before it is armed."""
    state: Text
    phase: Text
    cause: Text
    held: bool
    at: Text
    """UTC."""


class Timing(FrozenRecord, frozen=True):
    """How punctual a program of the loop has been since its epoch began; in real time only."""

    epoch: Epoch
    seq: Seq
    """The newest sample that is counted; -1 before the first."""
    service: Text
    missed: Whole
    """Samples and points of the grid that were skipped."""
    lateness: Distribution
    """Of the wake-ups against the program's own grid; without one, of the samples' arrival against
    the grid of the earliest among them."""
    age: Distribution
    """From the first arrival of a sample's number to the step with what the program acts on."""
    execution: Distribution
    """Of the steps, from their begin until all was told; instruments included."""
