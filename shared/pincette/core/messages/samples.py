"""Published messages: samples of the loop, each with its number, and other messages."""

from pincette.control.planning.sweep import Sweep
from pincette.control.quantities import (
    Arms,
    Epoch,
    Hertz,
    Items,
    Micrometre,
    Millinewton,
    MillinewtonPerMicrometre,
    Second,
    Seq,
    Text,
    Volt,
    Whole,
)
from pincette.control.record import FrozenRecord
from pincette.core.faults import Acted, Cause, Fault, Mode, Outcome
from pincette.core.messages.arms import (
    ArmApplied,
    ArmCommand,
    ArmEstimate,
    ArmPosition,
    ArmTelemetry,
    ArmTruth,
)
from pincette.latency.histogram import Distribution


class Position(FrozenRecord, frozen=True):
    """Positions of all arm tips, measured by the sensor on its own sampling grid."""

    epoch: Epoch
    seq: Seq
    t_s: Second
    arms: Arms[ArmPosition]
    """Measurement of each driven arm, the first arm first."""

    @property
    def usable(self) -> bool:
        """Return whether every arm was measured."""
        return all(arm.valid for arm in self.arms)


class Burst(FrozenRecord, frozen=True):
    """Samples from the sensor's buffer up to sample ``seq``, one every 1/``rate_hz``."""

    epoch: Epoch
    seq: Seq
    rate_hz: Hertz
    x_um: Items[Micrometre]
    drive_V: Items[Volt]
    """Voltage at the amplifier's input, measured together with the position."""
    valid: bool = False


class Estimate(FrozenRecord, frozen=True):
    """Force and perturbation of each arm, computed from position k and the voltage applied at
    k-1.
    """

    epoch: Epoch
    seq: Seq
    applied_seq: Seq
    """Number of the sample whose voltages were used; -1 if none were."""
    tripped: bool
    degraded: bool
    """True if the voltage applied to an arm is missing."""
    arms: Arms[ArmEstimate]
    """Estimate of each driven arm, the first arm first; ``valid`` and ``fault`` refer to all
    arms.
    """
    valid: bool = False
    fault: Fault | None = None
    """Reason why the estimate is not valid."""


class Command(FrozenRecord, frozen=True):
    """Voltages that the controller requests, based on sample ``seq``."""

    epoch: Epoch
    seq: Seq
    owner: Whole
    arms: Arms[ArmCommand]
    """Command for each driven arm, the first arm first. The actuator refuses a command for another
    number of arms than the rig has."""
    part_held: bool
    """True if a part is held from now on: a fault then freezes the voltage; otherwise it ramps to
    the safe voltage.
    """
    zero: bool
    """True if the estimator must zero the force at this sample."""
    final: bool
    """True if this is the last command of this arming."""
    valid: bool = False
    fault: Fault | None = None
    """Reason why the command is not valid, which the controller cannot measure itself."""
    sweep: Sweep | None = None
    """Sweep to be played around the first arm's voltage; the commands that follow confirm that it
    may continue.
    """
    segment: Whole | None = None
    """Number of the program segment to which the voltage belongs; None if it belongs to none."""
    segment_tick: Whole = 0
    """Number of ticks since the beginning of the segment."""
    step_um: Micrometre | None = None
    """Step of the position that the part or the sensor may have caused; None if there was none, or
    while a load continues after it as after a slip.
    """


class Applied(FrozenRecord, frozen=True):
    """Output of the actuator in tick ``seq``.

    ``part_held, zero, final, segment, segment_tick, step_um`` are copied from the command.
    """

    epoch: Epoch
    seq: Seq
    arms: Arms[ArmApplied]
    """Output of each driven arm, the first arm first; mode, cause and latch apply to all arms."""
    state: Mode
    cause: Cause
    """Cause of the trip; empty if there is none."""
    part_held: bool
    zero: bool
    final: bool
    answered: bool
    """False if no command for this tick was accepted and the voltage was kept or ramped."""
    refused: Whole
    command_age_s: Second
    faults: Items[Fault] = ()
    """Faults that led to the cause: what was detected, why earlier commands were not valid, or why
    a freeze ended early.
    """
    segment: Whole | None = None
    segment_tick: Whole = 0
    slewing_s: Second | None = None
    """Time since the last change of the output, at most one period; the slew limit applies to this
    time. None in lockstep, in which it is always one period."""
    unconfirmed: bool = False
    """True if the output of an arm has not confirmed its ``voltage_V``, so that the actual voltage
    is unknown."""
    step_um: Micrometre | None = None

    def confirmed_V(self, arm: int = 0) -> float | None:
        """Return the voltage that the output of an arm has confirmed.

        Parameters
        ----------
        arm
            Index of the arm, from 0.

        Returns
        -------
        The voltage, in V; None while it is not confirmed, or for an arm that does not exist.
        """
        return None if self.unconfirmed or arm >= len(self.arms) else self.arms[arm].voltage_V


class Telemetry(FrozenRecord, frozen=True):
    """References and control quantities of the controller for sample ``seq``.

    Published while a program plays. Between jobs, the newest message belongs to the last sample of
    the last program, whose ``epoch`` has ended.
    """

    epoch: Epoch
    seq: Seq
    playing: bool
    phase: Text
    segment: Whole
    segment_tick: Whole
    arms: Arms[ArmTelemetry]
    """References of each driven arm, the first arm first."""
    force_r_mN: Millinewton
    sliding_um: Micrometre
    """Sliding variable s as a length; if the law defines s as a force, it is divided by K̄."""
    band_um: Micrometre
    """Half width of the band within which s stays or to which it returns."""
    perturbation_mN: Millinewton
    """Estimated perturbation p̂, with the force that the law used."""
    perturbation_error_mN: Millinewton
    """Error p̃ of the perturbation, with the force that the law used."""
    residual_um: Micrometre
    """Position minus its prediction (17)."""
    outcome: Outcome
    contact_x_um: Micrometre | None
    contact_stiffness_mN_per_um: MillinewtonPerMicrometre | None
    held: bool
    acted: Items[Acted]
    """Actions that took effect at this sample. ``let_go`` and ``retract`` are reported as ``stop``;
    if a lease has expired without a stop request, ``lease`` precedes it.
    """
    paused: bool = False
    """True if, from this sample on, the references are constant and the segment's time does not
    advance.
    """
    touch_x_um: Micrometre | None = None
    """Position where the arm contacted something during its motion in free space; None: no
    contact.
    """
    touch_mN: Millinewton | None = None
    """Force at the contact of ``touch_x_um`` when the arm turned back."""
    correction_um: Micrometre = 0.0
    """Correction learned from earlier cycles, which is added to x_r for the law."""
    slips: Whole = 0
    """Number of slips of the part while the references moved."""
    step_um: Micrometre | None = None
    """Step of the position that the voltage does not explain, positive towards the part; None if
    there was none.
    """
    step_x_um: Micrometre | None = None
    """Position just before the step."""
    step_mN: Millinewton | None = None
    """Estimated force just before the step, in mN. If the sensor has jumped, it is also the true
    force after the step."""
    step_after_mN: Millinewton | None = None
    """Estimated force just after the step, in mN; it is the true force if the part has slipped."""
    place_um: Micrometre | None = None
    """Place of the part between two arms, q = (x_1 - x_2)/2 at this sample; None on a rig with one
    arm.
    """
    place_r_um: Micrometre | None = None
    """Reference of the place."""


class GroundTruth(FrozenRecord, frozen=True):
    """True state of a simulated rig at the time when its output was written; only the recorder uses
    it.
    """

    seq: Seq
    """Number of writes to the output since the rig program started. It belongs to no epoch and does
    not correspond to the ``seq`` of other topics.
    """
    arms: Arms[ArmTruth]
    """State of each driven arm, the first arm first."""
    part_um: Micrometre | None = None
    """Position at which the first of two arms contacts the part; None if there is no part, or on a
    rig with one arm.
    """


class JobNotice(FrozenRecord, frozen=True):
    """State of a job in the supervisor, published whenever its state or its phase changes."""

    job: Text
    kind: Text
    epoch: Epoch
    """Epoch of its samples; 0 before it is armed."""
    state: Text
    phase: Text
    cause: Text
    held: bool
    at: Text
    """Time of the change, in UTC."""


class Place(FrozenRecord, frozen=True):
    """Place of the part, measured by a vision client; a job uses it if its request says so."""

    rig: Text
    """Name of the rig in whose coordinates the place is stated."""
    x_um: Micrometre
    """Position of the arm at first contact; with two arms, the place q = (x_1 - x_2)/2."""
    u_um: Micrometre
    """Expanded uncertainty (k = 2) of ``x_um``; greater than 0."""
    width_um: Micrometre | None
    """Width of the part, for two arms; None if it was not measured."""
    u_width_um: Micrometre | None
    """Expanded uncertainty (k = 2) of the width."""
    measured_at: Text
    """Time of the measurement, in ISO 8601 with its time zone."""
    source: Text
    """Name of the instrument, at most 80 characters."""


class Timing(FrozenRecord, frozen=True):
    """Timing of a program of the loop since the beginning of its epoch; in real time only."""

    epoch: Epoch
    seq: Seq
    """Number of the newest sample that the statistics include; -1 before the first."""
    service: Text
    missed: Whole
    """Number of samples and grid points that were skipped."""
    lateness: Distribution
    """Lateness of wake-ups relative to the program's own grid; if it has none, lateness of arriving
    samples relative to the grid of the earliest.
    """
    age: Distribution
    """Time from the arrival of the first message with a sample's number to the step that uses the
    sample.
    """
    execution: Distribution
    """Duration of a step until all outputs are published, including exchanges with instruments."""
