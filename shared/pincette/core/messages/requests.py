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
    """Start a new epoch. Refused if the rig file's digest differs."""

    epoch: Epoch
    owner: Whole
    digest: Text
    calibration: LongText = Document("")
    """The model in use as JSON, which overrides that of the rig file; see ``config.calibration``.
    """
    capture_hz: Hertz = 0.0
    """Rate of buffered acquisition, as in the program that is played."""
    zero_confirmed: bool = False
    """True if a person has stated that nothing touches the arm: zeros of earlier epochs are
    dropped."""
    voltages: Items[VoltageRange] = ()
    """Range of voltages that the plan states for each arm, the first arm first; the limits of the
    rig hold for an arm that is left out."""
    zero_kept: bool = False
    """True if the force of a part that is still held keeps the zero of the previous epoch."""


class Load(FrozenRecord, frozen=True):
    """Give the controller a program to play at the next arming."""

    program: Program


class Action(FrozenRecord, frozen=True):
    """Request an action of the controller at ``at_seq``, or at its next tick (None).

    ``stop``     a held part stays held; without one the arm comes to rest and the program ends.
    ``let_go``   a stop that unloads a held part and ends where the arm is then.
    ``retract``  a stop that unloads a held part and plays the retreat; without a part, at once.
    ``pause``    at the next safe point the references rest, and the segment's time stops.
    ``resume``   continue where the pause began, or cancel a pause that has not begun.
    ``release``  continue with the unload and the segments after it.
    ``continue`` end a segment that waits for a person.
    ``keep``     end with the part held, at the voltage that is applied.
    """

    action: ActionCode
    at_seq: Seq | None = None
    reason: Fault | None = None
    """Reason why the controller itself requests the action; None if another program requests it."""


class Lease(FrozenRecord, frozen=True):
    """Let the program of an epoch continue for ``length_s`` from now.

    A repeated request restarts the time. When the time ends without one, the controller stops.
    """

    epoch: Epoch
    length_s: Second
    then: LeaseEnd = LeaseEnd.STOP


class Idle(FrozenRecord, frozen=True):
    """Let the sensor sample at a low rate until the next arming, since nothing plays."""

    epoch: Epoch
    """Epoch that is over; the sensor refuses the request in any other one."""


class Trip(FrozenRecord, frozen=True):
    """Request that the actuator go to its safe state and latch."""

    cause: Cause
    release_now: bool = False
    """Ramp to the safe voltage at once, even if a part is held or frozen."""
    words: Text = ""
    """Reason, for people."""


class Reset(FrozenRecord, frozen=True):
    """Clear the actuator's latch; ``acknowledge``: a person has seen its cause.

    Without ``acknowledge``, only the latch after a start is cleared, and only if no earlier
    actuator program has died. A held part stays held: its voltage is kept, and the next arming
    begins with it.
    """

    acknowledge: bool = False


class RequestLog(FrozenRecord, frozen=True):
    """A request that a program of the loop has accepted, with all that a replay needs.

    One of ``arm`` to ``reset`` is present. A loaded program is included in the arming.
    """

    epoch: Epoch
    """Epoch in which the request takes effect."""
    seq: Seq
    """Number of the newest sample that the program had processed; -1 before the first."""
    service: Text
    topic: Text
    """Topic of that sample."""
    arm: Arm | None = None
    load: Load | None = None
    action: Action | None = None
    trip: Trip | None = None
    reset: Reset | None = None
    state_snapshot: LongText = Document("")
    """State that the program carries into the epoch from earlier ones, as JSON."""


class SimCommand(FrozenRecord, frozen=True):
    """Operate a simulated rig: an action of a person at the rig, or a fault.

    Refused unless the rig file allows it.
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
    """Keep every sample of an epoch that is about to be armed, in the folder of a job."""

    job: Text
    epoch: Epoch
    about: LongText
    """JSON object with the texts that describe the owner of the record; see
    ``results.archive.about``."""


class Finish(FrozenRecord, frozen=True):
    """Close the record of an epoch, whose last sample is ``last_seq``; None if it is not known.

    The recorder then accepts messages until no more arrive.
    """

    job: Text
    epoch: Epoch
    last_seq: Seq | None


class Recorded(FrozenRecord, frozen=True):
    """Content of a record."""

    job: Text
    messages: Whole
    dropped: Whole
    """Number of messages that did not fit or did not arrive."""
    complete: bool
    detail: Text
    """Reason why the record is not complete, as text."""


class StatusRequest(FrozenRecord, frozen=True):
    """Request for the status of any program."""


class InstrumentCounts(FrozenRecord, frozen=True):
    """Numbers of failed exchanges with a program's instruments since the program started."""

    late: Whole = 0
    """Number of replies that arrived after their timeout and were dropped."""
    lost: Whole = 0
    """Number of replies that never arrived."""
    unexpected: Whole = 0
    """Number of replies without a request, such as those that a line repeats."""
    reopened: Whole = 0
    """Number of times that a lost or silent port was reopened."""
    retried: Whole = 0
    """Number of times that opening an instrument failed and was repeated."""


class ExchangeTimes(FrozenRecord, frozen=True):
    """Durations of the newest exchanges with one instrument that succeeded, as measured."""

    count: Whole
    """Number of exchanges, at most 40."""
    minimum_s: Second
    median_s: Second
    worst_s: Second
    held_s: Second = 0.0
    """Time for which a device server holds replies back before it forwards them whole; 0 if none
    was found."""
    line_baud: Whole = 0
    """Estimated rate of the serial line behind a device server if it is slower than the rig file
    states; 0 if it is not."""


class Status(FrozenRecord, frozen=True):
    """Status of a program; ``instance`` differs for every start of it."""

    service: Text
    version: Text
    instance: Whole
    digest: Text
    epoch: Epoch
    steps: Whole
    missed: Whole
    refused: Whole
    calibration: Text = ""
    """Digest of the model in use; empty: that of the rig file."""
    mode: Mode | None = None
    """Mode of the actuator."""
    cause: Cause = Cause.NONE
    """Cause of the actuator's trip."""
    faults: Items[Fault] = ()
    """Faults behind the cause; see ``Applied``."""
    findings: Items[Fault] = ()
    """Other findings about the program, the most serious first."""
    predecessor: Predecessor | None = None
    """End of the previous actuator program."""
    replaces: Whole | None = None
    """Instance of the previous program, if it is known."""
    instrument: InstrumentCounts | None = None
    """Failed exchanges with its instruments; None if it has none."""
    exchanges: Items[ExchangeTimes] = ()
    """Durations of readings, or of exchanges with the output, for each arm; empty in lockstep."""


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
