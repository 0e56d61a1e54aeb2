"""What is asked of a program, and what it answers."""

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
    """Start a new epoch. Refused where the rig file's digest differs."""

    epoch: Epoch
    owner: Whole
    digest: Text
    calibration: LongText = Document("")
    """The model in use as JSON, over that of the rig file; see ``config.calibration``."""
    capture_hz: Hertz = 0.0
    """As in the program that is played."""
    zero_confirmed: bool = False
    """A person has said that nothing touches the arm: zeros of earlier epochs are given up."""
    voltage: VoltageRange | None = None
    """Voltages that the plan has stated; None: the limits of the rig."""
    second_voltage: VoltageRange | None = None
    """Voltages of the second arm likewise."""
    zero_kept: bool = False
    """Whether the force of a part that is still held keeps the zero of the epoch before."""


class Load(FrozenRecord, frozen=True):
    """Give the controller a program to play at the next arming."""

    program: Program


class Action(FrozenRecord, frozen=True):
    """Ask the controller to act at ``at_seq``, or at its next tick (None).

    ``stop``     a held part stays held; without one the arm comes to rest and the program ends.
    ``let_go``   a stop that unloads a held part and ends where the arm is then.
    ``retract``  a stop that unloads a held part and plays the retreat; without a part, at once.
    ``pause``    at the next safe point the references rest, and the segment's time stands still.
    ``resume``   go on where the pause began, or give up a pause that has not begun.
    ``release``  go on with the unload and what follows it.
    ``continue`` leave a segment that waits for a person.
    ``keep``     end with the part held, at the voltage that is applied.
    """

    action: ActionCode
    at_seq: Seq | None = None
    reason: Fault | None = None
    """Why the controller asks it of itself; None where somebody has asked."""


class Lease(FrozenRecord, frozen=True):
    """Let the program of an epoch play on for ``length_s`` from here; asked again, it runs anew.

    Where it ends, nobody has been heard of for so long, and the controller stops by itself.
    """

    epoch: Epoch
    length_s: Second
    then: LeaseEnd = LeaseEnd.STOP


class Idle(FrozenRecord, frozen=True):
    """Let the sensor sample slowly until the next arming, since nothing plays."""

    epoch: Epoch
    """Epoch that is over; the sensor refuses the request in any other one."""


class Trip(FrozenRecord, frozen=True):
    """Ask the actuator to go to its safe state and latch."""

    cause: Cause
    release_now: bool = False
    """Ramp to the safe voltage at once, even where a part is held or frozen."""
    words: Text = ""
    """Why, for people."""


class Reset(FrozenRecord, frozen=True):
    """Clear the actuator's latch; ``acknowledge``: a person has seen its cause.

    Without, only the latch of a boot is cleared, and only where no actuator before has died.
    A part that is held stays held: its voltage is kept, and the next arming begins with it.
    """

    acknowledge: bool = False


class RequestLog(FrozenRecord, frozen=True):
    """A question that a program of the loop has taken, with all that a replay needs of it.

    One of ``arm`` to ``reset`` is there. A program that was loaded is told with the arming.
    """

    epoch: Epoch
    """That holds since."""
    seq: Seq
    """The newest sample that the program had stepped with; -1 before the first."""
    service: Text
    topic: Text
    """Topic of that sample."""
    arm: Arm | None = None
    load: Load | None = None
    action: Action | None = None
    trip: Trip | None = None
    reset: Reset | None = None
    state_snapshot: LongText = Document("")
    """What the program brings into the epoch from those before, as JSON."""


class SimCommand(FrozenRecord, frozen=True):
    """Operate a simulated rig: what a person at the bench does, or a fault that befalls it.

    Refused unless the rig file allows it.
    """

    target: Text
    """``part``, ``weight``, ``arm``, ``sensor`` or ``output``; with two arms also ``second_sensor``
    and ``second_output``."""
    what: Text
    """What is done to it: ``remove``, ``off``, ``stuck`` …"""
    value: Number | None = None
    after_s: Second = 0.0
    """From now on, in the rig's own time."""
    for_s: Second | None = None
    """How long a fault lasts; None: until ``heal``."""


class Record(FrozenRecord, frozen=True):
    """Keep every sample of an epoch that is about to be armed, in the folder of a job."""

    job: Text
    epoch: Epoch
    about: LongText
    """Whose the record is, as JSON: names and texts; see ``results.archive.about``."""


class Finish(FrozenRecord, frozen=True):
    """Close the record of an epoch, whose last sample is ``last_seq``; None where nobody knows it.

    The recorder then takes what comes until nothing comes any more.
    """

    job: Text
    epoch: Epoch
    last_seq: Seq | None


class Recorded(FrozenRecord, frozen=True):
    """What a record has."""

    job: Text
    messages: Whole
    dropped: Whole
    """Messages that found no room, or did not come."""
    complete: bool
    detail: Text
    """Why it is not complete, for people."""


class StatusRequest(FrozenRecord, frozen=True):
    """Ask any program how it is."""


class InstrumentCounts(FrozenRecord, frozen=True):
    """Exchanges with a program's instruments that went wrong, since the program started."""

    late: Whole = 0
    """Answers that came after their timeout; each was dropped."""
    lost: Whole = 0
    """Answers that never came."""
    unexpected: Whole = 0
    """Answers more than there were requests, as where a line repeats them."""
    reopened: Whole = 0
    """Times that a lost or silent port was opened again."""
    retried: Whole = 0
    """Times that opening an instrument failed and was tried again."""


class ExchangeTimes(FrozenRecord, frozen=True):
    """Durations of the newest exchanges with one instrument that succeeded, as measured."""

    count: Whole
    """Number of exchanges, at most 40."""
    minimum_s: Second
    median_s: Second
    worst_s: Second
    held_s: Second = 0.0
    """Time for which a device server holds answers back before it forwards them whole; 0 where
    none was found."""
    line_baud: Whole = 0
    """Estimated rate of the serial line behind a device server where it is slower than the rig file
    states; 0 where it is not."""


class Status(FrozenRecord, frozen=True):
    """How a program is; ``instance`` differs for every start of it."""

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
    """Of the actuator."""
    cause: Cause = Cause.NONE
    """Why the actuator has tripped."""
    faults: Items[Fault] = ()
    """Behind the cause; see ``Applied``."""
    findings: Items[Fault] = ()
    """What else is to be told of it, the gravest first."""
    predecessor: Predecessor | None = None
    """Of the actuator: how the one before it has ended."""
    replaces: Whole | None = None
    """Instance of that one, where it is known."""
    instrument: InstrumentCounts | None = None
    """Of a program that has an instrument."""
    exchanges: Items[ExchangeTimes] = ()
    """Durations of readings, or of exchanges with the output, for each arm; empty in lockstep."""


class TimingRequest(FrozenRecord, frozen=True):
    """Ask a program of the loop how punctual it is. Refused in lockstep, which keeps no clock."""


class RigFileRequest(FrozenRecord, frozen=True):
    """Ask a program of the loop which rig file it works with."""


class RigFileReply(FrozenRecord, frozen=True):
    """The rig file that a program works with, whole."""

    text: LongText
    """As JSON."""
    digest: Text


class Ack(FrozenRecord, frozen=True):
    """The question was taken; it acts at ``seq``."""

    seq: Seq
