"""Requests to programs, and their replies."""

from pincette.control.planning.program import Program
from pincette.control.quantities import (
    Document,
    Epoch,
    Hertz,
    Items,
    LongText,
    Number,
    Second,
    Seq,
    Text,
    Whole,
)
from pincette.control.record import FrozenRecord
from pincette.control.voltage_range import VoltageRange
from pincette.core.faults import ActionCode, Cause, Fault, LeaseEnd, Mode, Predecessor


class Arm(FrozenRecord, frozen=True):
    """Request to start a new epoch. Refused if the digest of the rig file differs."""

    epoch: Epoch
    owner: Whole
    digest: Text
    calibration: LongText = Document("")
    """The model in use as JSON, which replaces that of the rig file; see ``config.calibration``."""
    capture_hz: Hertz = 0.0
    """Rate of buffered acquisition, as stated in the program that is played."""
    zero_confirmed: bool = False
    """True if a person has confirmed that nothing touches the arm; zeros of earlier epochs are then
    discarded.
    """
    voltages: Items[VoltageRange] = ()
    """Range of voltages planned for each arm, the first arm first; for an omitted arm the limits of
    the rig apply.
    """
    zero_kept: bool = False
    """True if the force of a part that is still held keeps the zero of the previous epoch."""


class Load(FrozenRecord, frozen=True):
    """Request that gives the controller a program to play at the next arming."""

    program: Program


class Action(FrozenRecord, frozen=True):
    """Request an action of the controller at ``at_seq``, or at its next tick (None)."""

    action: ActionCode
    at_seq: Seq | None = None
    reason: Fault | None = None
    """Reason of an action that the controller itself requests; None if another program requests
    it.
    """


class Lease(FrozenRecord, frozen=True):
    """Request that lets the program of an epoch continue for ``length_s`` from now.

    A repeated request restarts the time. If the time expires without a new request, the controller
    stops.
    """

    epoch: Epoch
    length_s: Second
    then: LeaseEnd = LeaseEnd.STOP


class Idle(FrozenRecord, frozen=True):
    """Request that the sensor sample at a low rate until the next arming, since no program
    plays.
    """

    epoch: Epoch
    """Epoch that has ended; the sensor refuses the request in any other epoch."""


class Trip(FrozenRecord, frozen=True):
    """Request that the actuator go to its safe state and latch."""

    cause: Cause
    release_now: bool = False
    """True to ramp to the safe voltage at once, even if a part is held or the voltage is frozen."""
    words: Text = ""
    """Reason as text for people."""


class Reset(FrozenRecord, frozen=True):
    """Clear the actuator's latch; ``acknowledge`` is True if a person has seen its cause.

    Without ``acknowledge``, only the latch after a start is cleared, and only if no earlier
    actuator program has died. A held part stays held: its voltage is kept, and the next arming
    begins with it.
    """

    acknowledge: bool = False


class RequestLog(FrozenRecord, frozen=True):
    """A request that a program of the loop has accepted, with all data that a replay needs.

    Exactly one of the fields ``arm`` to ``reset`` is present. A loaded program is included in the
    arming.
    """

    epoch: Epoch
    """Epoch in which the request takes effect."""
    seq: Seq
    """Number of the newest sample that the program had processed; -1 before the first."""
    service: Text
    topic: Text
    """Topic of the sample whose number is ``seq``."""
    arm: Arm | None = None
    load: Load | None = None
    action: Action | None = None
    trip: Trip | None = None
    reset: Reset | None = None
    state_snapshot: LongText = Document("")
    """State that the program keeps from earlier epochs, as JSON."""


class SimCommand(FrozenRecord, frozen=True):
    """Command to a simulated rig: an action of a person at the rig, or a fault.

    Refused unless the rig file permits it.
    """

    target: Text
    """``part``, ``weight``, ``arm``, ``sensor`` or ``output``; with two arms also ``second_sensor``
    and ``second_output``."""
    what: Text
    """Action on the target: ``remove``, ``off``, ``stuck`` …"""
    value: Number | None = None
    after_s: Second = 0.0
    """Delay from now, in the rig's own time."""
    for_s: Second | None = None
    """Duration of a fault; None: until ``heal``."""


class Record(FrozenRecord, frozen=True):
    """Request to record every sample of an epoch that is about to be armed, in the folder of a
    job.
    """

    job: Text
    epoch: Epoch
    about: LongText
    """JSON object (names to strings) that describes the owner of the record; see
    ``results.archive.about``.
    """


class Finish(FrozenRecord, frozen=True):
    """Request to close the record of an epoch. ``last_seq`` is its last sample; None if unknown.

    The recorder first accepts messages until no more arrive.
    """

    job: Text
    epoch: Epoch
    last_seq: Seq | None


class Recorded(FrozenRecord, frozen=True):
    """Content of a record."""

    job: Text
    messages: Whole
    dropped: Whole
    """Number of messages that did not arrive, or that did not fit into the recorder's queue."""
    complete: bool
    detail: Text
    """Reason, as text, why the record is incomplete."""


class StatusRequest(FrozenRecord, frozen=True):
    """Request for the status of any program."""


class InstrumentCounts(FrozenRecord, frozen=True):
    """Numbers of failed exchanges with a program's instruments since the program started."""

    late: Whole = 0
    """Number of replies that arrived after the timeout and were discarded."""
    lost: Whole = 0
    """Number of replies that never arrived."""
    unexpected: Whole = 0
    """Number of replies without a request, for example replies that the line repeated."""
    reopened: Whole = 0
    """Number of times that a lost or silent port was reopened."""
    retried: Whole = 0
    """Number of repeated attempts to open an instrument."""


class ExchangeTimes(FrozenRecord, frozen=True):
    """Durations of the newest successful exchanges with one instrument."""

    count: Whole
    """Number of exchanges, at most 40."""
    minimum_s: Second
    median_s: Second
    worst_s: Second
    held_s: Second = 0.0
    """Time for which a device server buffers a reply before it forwards it as a whole; 0 if none
    was detected.
    """
    line_baud: Whole = 0
    """Estimated baud rate of the serial line behind a device server if it is lower than stated in
    the rig file; otherwise 0.
    """


class Status(FrozenRecord, frozen=True):
    """Status of a program; ``instance`` is different after every start."""

    service: Text
    version: Text
    instance: Whole
    digest: Text
    epoch: Epoch
    steps: Whole
    missed: Whole
    refused: Whole
    calibration: Text = ""
    """Digest of the model in use; empty for that of the rig file."""
    mode: Mode | None = None
    """Mode of the actuator."""
    cause: Cause = Cause.NONE
    """Cause of the actuator's trip."""
    faults: Items[Fault] = ()
    """Faults that led to the cause; see ``Applied``."""
    findings: Items[Fault] = ()
    """Other findings about the program, the most serious first."""
    predecessor: Predecessor | None = None
    """How the previous actuator program ended."""
    replaces: Whole | None = None
    """Instance of the previous program; None if it is unknown."""
    instrument: InstrumentCounts | None = None
    """Failed exchanges with the program's instruments; None if it has none."""
    exchanges: Items[ExchangeTimes] = ()
    """Durations of sensor readings, or of exchanges with the output, for each arm; empty in
    lockstep.
    """


class TimingRequest(FrozenRecord, frozen=True):
    """Request for the timing of a program of the loop. Refused in lockstep, which has no clock."""


class RigFileRequest(FrozenRecord, frozen=True):
    """Request for the rig file of a program of the loop."""


class RigFileReply(FrozenRecord, frozen=True):
    """The complete rig file of a program."""

    text: LongText
    """The rig file as JSON."""
    digest: Text


class Ack(FrozenRecord, frozen=True):
    """The request was accepted; it takes effect at ``seq``."""

    seq: Seq
