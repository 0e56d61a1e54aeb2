"""What is asked of a program, and what it answers."""

from dataclasses import dataclass
from typing import NewType

from pincette.control.planning.program import Program

Document = NewType("Document", str)
"""A text of many lines, as JSON; other texts are short."""


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

    action: str
    at_seq: int | None = None
    reason: str = ""
    """Why a program asks it of itself, as ``lease: …``; empty where somebody has asked."""


@dataclass(frozen=True, slots=True)
class Lease:
    """Let the program of an epoch play on for ``length_s`` from here; asked again, it runs anew.

    Where it ends, nobody has been heard of for so long, and the controller stops by itself.
    """

    epoch: int
    length_s: float
    then: str = "stop"
    """How: ``stop``, ``let_go`` or ``retract``; see ``Act``."""


@dataclass(frozen=True, slots=True)
class Trip:
    """Ask the actuator to go to its safe state and latch."""

    cause: str
    let_go: bool = False
    """Ramp to the safe voltage at once, even where a part is held or frozen."""


@dataclass(frozen=True, slots=True)
class Reset:
    """Clear the actuator's latch; ``acknowledge`` must be true.

    A part that is held stays held: its voltage is kept, and the next arming begins with it.
    """

    acknowledge: bool = False


@dataclass(frozen=True, slots=True)
class Asked:
    """A question that a program of the loop has taken, with all that a replay needs of it.

    One of ``arm`` to ``reset`` is there. A program that was loaded is told with the arming.
    """

    epoch: int
    """That holds since."""
    seq: int
    """The newest sample that the program had stepped with; -1 before the first."""
    service: str
    topic: str
    """Topic of that sample."""
    arm: Arm | None = None
    load: Load | None = None
    act: Act | None = None
    trip: Trip | None = None
    reset: Reset | None = None
    carried: Document = Document("")
    """What the program brings into the epoch from those before, as JSON."""


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
class Record:
    """Keep every sample of an epoch that is about to be armed, in the folder of a job."""

    job: str
    epoch: int
    about: Document
    """Whose the record is, as JSON: names and texts; see ``results.archive.about``."""


@dataclass(frozen=True, slots=True)
class Finish:
    """Close the record of an epoch, whose last sample is ``last_seq``."""

    job: str
    epoch: int
    last_seq: int


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a record has."""

    job: str
    messages: int
    dropped: int
    """Messages that found no room, or did not come."""
    complete: bool
    detail: str
    """Why it is not complete."""


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
class TimingRequest:
    """Ask a program of the loop how punctual it is. Refused in lockstep, which keeps no clock."""


@dataclass(frozen=True, slots=True)
class RigFileRequest:
    """Ask a program of the loop which rig file it works with."""


@dataclass(frozen=True, slots=True)
class RigFileTold:
    """The rig file that a program works with, whole."""

    text: Document
    """As JSON."""
    digest: str


@dataclass(frozen=True, slots=True)
class Done:
    """The question was taken; it acts at ``seq``."""

    seq: int
