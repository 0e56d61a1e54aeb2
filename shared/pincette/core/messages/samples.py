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
    """Measurement of each arm's tip by the sensor, at its own grid point."""

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
    """Samples from the sensor's own buffer up to sample ``seq``, one each 1/``rate_hz``."""

    epoch: Epoch
    seq: Seq
    rate_hz: Hertz
    x_um: Items[Micrometre]
    drive_V: Items[Volt]
    """Voltage at the amplifier's input, measured together with the position."""
    valid: bool = False


class Estimate(FrozenRecord, frozen=True):
    """Force and perturbation of each arm, from position k and the voltage applied at k-1."""

    epoch: Epoch
    seq: Seq
    applied_seq: Seq
    """Number of the sample whose voltages were used; -1 if there were none."""
    tripped: bool
    degraded: bool
    """True if the voltage applied to an arm is missing."""
    arms: Arms[ArmEstimate]
    """Estimate of each driven arm, the first arm first; ``valid`` and ``fault`` are of all."""
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
    """True if a part is held from here on: a fault then freezes the voltage, and otherwise ramps it
    to the safe voltage."""
    zero: bool
    """True if the estimator must zero the force again at this seq."""
    final: bool
    """True if this is the last command of this arming."""
    valid: bool = False
    fault: Fault | None = None
    """Reason why the command is not valid, which the controller cannot measure itself."""
    sweep: Sweep | None = None
    """Sweep to play around the first arm's voltage; the following commands confirm that it may
    continue."""
    segment: Whole | None = None
    """Number of the program's segment to which the voltage belongs; None: to none."""
    segment_tick: Whole = 0
    """Number of ticks since the beginning of the segment."""


class Applied(FrozenRecord, frozen=True):
    """Output of the actuator in tick ``seq``.

    ``part_held, zero, final, segment, segment_tick`` are copied from the command.
    """

    epoch: Epoch
    seq: Seq
    arms: Arms[ArmApplied]
    """Output of each driven arm, the first arm first; mode, cause and latch are those of all."""
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
    """Faults behind the cause: what was found, why earlier commands were not valid, why a freeze
    ended early."""
    segment: Whole | None = None
    segment_tick: Whole = 0
    slewing_s: Second | None = None
    """Time since the last change of the output, at most a period, for which the slew limit was
    computed; None in lockstep, where it is a period."""
    unconfirmed: bool = False
    """True if the output of an arm has not confirmed its ``voltage_V``, so that the actual voltage
    is unknown."""

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
    """The controller's view of sample ``seq``: the references that hold for this sample.

    It is published while a program plays, so between jobs the newest one is the last sample of the
    last program, whose ``epoch`` is over.
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
    """Sliding variable s; if s is a force, s over K̄."""
    band_um: Micrometre
    """Half width of the band in which s stays or to which it returns."""
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
    """Actions that took effect at this seq. ``let_go`` and ``retract`` are reported as ``stop``,
    after ``lease`` if a lease has ended without any request for the stop."""
    paused: bool = False
    """From this sample on the references rest, and the segment's time does not advance."""
    touch_x_um: Micrometre | None = None
    """Position where the arm met something during its motion in free space; None: nothing."""
    touch_mN: Millinewton | None = None
    """Force of that touch when the arm turned back."""
    correction_um: Micrometre = 0.0
    """Learned correction from earlier cycles, added to x_r for the law."""
    slips: Whole = 0
    """Number of times that the part has given way under moving references."""
    step_um: Micrometre | None = None
    """Step of the position that the voltage does not explain, positive towards the part; None:
    none was found."""
    step_x_um: Micrometre | None = None
    """Position just before the step."""
    step_mN: Millinewton | None = None
    """Estimated force just before the step; if the sensor has jumped, the force since."""
    step_after_mN: Millinewton | None = None
    """Estimated force just after the step; if the part has slipped, the force since."""
    place_um: Micrometre | None = None
    """Place of the part between two arms, q = (x_1 - x_2)/2 of the sample; None on a rig of one
    arm."""
    place_r_um: Micrometre | None = None
    """Reference of the place."""


class GroundTruth(FrozenRecord, frozen=True):
    """True state of a simulated rig when its output was written; only the recorder uses it."""

    seq: Seq
    """Number of writes to the output since the rig program started. It belongs to no epoch, so it
    does not join with the ``seq`` of other topics."""
    arms: Arms[ArmTruth]
    """State of each driven arm, the first arm first."""
    part_um: Micrometre | None = None
    """Position where the first of two arms touches the part; None if there is no part, and on a rig
    of one arm."""


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
    """Place of the part as a vision client measures it; a job uses it if its request states so."""

    rig: Text
    """Name of the rig whose coordinates these are."""
    x_um: Micrometre
    """Position of the arm at first touch; with two arms the place q = (x_1 - x_2)/2."""
    u_um: Micrometre
    """Expanded uncertainty (k = 2) of ``x_um``; above 0."""
    width_um: Micrometre | None
    """Width of the part, for two arms; None if it was not measured."""
    u_width_um: Micrometre | None
    """Expanded uncertainty (k = 2) of the width."""
    measured_at: Text
    """Time of the measurement, in ISO 8601 with its time zone."""
    source: Text
    """Name of the instrument, at most 80 characters."""


class Timing(FrozenRecord, frozen=True):
    """Timing of a program of the loop since its epoch began; in real time only."""

    epoch: Epoch
    seq: Seq
    """Number of the newest sample that is counted; -1 before the first."""
    service: Text
    missed: Whole
    """Number of samples and grid points that were skipped."""
    lateness: Distribution
    """Lateness of wake-ups against the program's own grid; if it has none, of the samples' arrival
    against the grid of the earliest."""
    age: Distribution
    """Time from the first arrival of a sample's number to the step with the message that the
    program acts on."""
    execution: Distribution
    """Duration of steps until all outputs were published, instruments included."""
