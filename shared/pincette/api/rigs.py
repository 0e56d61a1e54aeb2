"""A rig over REST: its programs, checks, limits and latch."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import WHOLE, Model, example
from pincette.api.access import Claim
from pincette.api.checks import Check, FaultView
from pincette.api.rig_states import Certainty, MotionState, PartState, RigState

RigAction = Literal["start_job", "estop", "reset", "resume_queue", "clear_queue"]


class InstrumentCounts(Model):
    """Numbers of failed exchanges with a program's instruments since the program started."""

    model_config = example(late=3, lost=1, unexpected=0, reopened=0, retried=0)

    late: int
    """Number of replies that arrived after the timeout and were discarded."""
    lost: int
    """Number of replies that never arrived."""
    unexpected: int
    """Number of replies without a request, for example replies that the line repeated."""
    reopened: int
    """Number of times that a lost or silent port was reopened."""
    retried: int
    """Number of repeated attempts to open an instrument or read back its voltage."""


class ExchangeTimes(Model):
    """Durations of the newest successful exchanges with an instrument."""

    model_config = example(count=40, minimum_s=0.0018, median_s=0.0019, worst_s=0.0024)

    count: int
    """Number of exchanges, at most 40."""
    minimum_s: float
    median_s: float
    worst_s: float
    held_s: float = 0.0
    """Time for which a device server buffers a reply before it forwards it as a whole; 0 if none
    was detected.
    """
    line_baud: int = 0
    """Estimated baud rate of the serial line behind a device server if it is lower than stated in
    the rig file; otherwise 0.
    """


class Program(Model):
    """Known state of a program of the rig."""

    model_config = example(
        name="estimator",
        alive=True,
        version="0.1.0",
        age_s=0.011,
        epoch=81985529216486895,
        missed=0,
        refused=0,
        detail="",
        trouble="",
    )

    name: str
    alive: bool
    """True if the program's liveliness token is visible."""
    version: str | None
    age_s: float | None
    """Time since the program's newest sample."""
    epoch: int | None
    missed: int | None
    """Number of samples that the program has skipped since its start."""
    refused: int | None
    """Number of messages that the program has refused since its start."""
    instrument: InstrumentCounts | None = None
    """Failed exchanges with the program's instruments; null if it has none, or has not reported its
    status.
    """
    exchanges: list[ExchangeTimes] = Field(default_factory=list["ExchangeTimes"])
    """Durations of sensor readings, or of exchanges with the output, for each arm; empty in
    lockstep.
    """
    detail: str
    """State of the program as text for people."""
    faults: list[FaultView] = Field(default_factory=list["FaultView"])
    """Faults in ``detail`` as codes and numbers, for programs."""
    trouble: str
    """Reason why the program is not reliable; empty if it is."""


class Latch(Model):
    """The actuator's latch."""

    model_config = example(
        state="latched",
        cause="estop",
        faults=[],
        words="estop: an emergency stop was requested",
        clear="POST /api/v1/rigs/demo/reset",
    )

    state: RigState
    """State of the actuator, as in ``standing``; see the table of rig states."""
    cause: str
    """Code of the cause; empty if there is none."""
    faults: list[FaultView] = Field(default_factory=list["FaultView"])
    """Faults that were found, with their numbers."""
    words: str = ""
    """Cause as text for people, with the name of the silent program."""
    clear: str
    """Action that clears the latch; empty if there is nothing to clear."""


STANDING = {
    "state": "armed",
    "state_certainty": "known",
    "state_age_s": 0.011,
    "part": "held",
    "part_certainty": "known",
    "part_age_s": 0.011,
}


class Standing(Model):
    """State of the actuator and the part, and how certain it is."""

    model_config = example(**STANDING)

    state: RigState
    """State of the actuator; see the table of rig states."""
    state_certainty: Certainty
    state_age_s: float | None
    """Time since the last message of the actuator; null if there was none."""
    part: PartState
    """State of the part: held, not held or unknown. It is also unknown if the output's own watchdog
    may have released the part.
    """
    part_certainty: Certainty
    """Certainty of the part; at most ``believed`` for a held part while no voltage is written that
    could be confirmed."""
    part_age_s: float | None
    """Time since the output last confirmed the voltage of a held part; without one, the same as
    ``state_age_s``.
    """


class LimitValue(Model):
    """A limit of the rig."""

    model_config = example(quantity="force_max", value=40.0, unit="mN")

    quantity: str
    value: float
    unit: str


class ModelInUse(Model):
    """Model that jobs use."""

    model_config = example(version=3, digest="9f31c2a4550b7e66")

    version: int
    """Version of the model; 0 means the rig file alone."""
    digest: str


class Newest(Model):
    """Newest samples of the rig."""

    model_config = example(
        seq=445,
        phase="hold",
        x_um=39.9,
        force_mN=19.98,
        force_uncertainty_mN=0.41,
        zero_age_s=4.1,
        voltage_V=2.49,
    )

    seq: int | None
    phase: str
    x_um: float | None
    force_mN: float | None
    """Contact force; null if it is unknown, for example before it is zeroed."""
    force_uncertainty_mN: float | None
    """Expanded uncertainty of ``force_mN``."""
    zero_age_s: float | None
    """Time since the force was zeroed; null if it has not been zeroed."""
    zero_invalid: bool = False
    """True if the zero of an arm's force is no longer valid, since a held part read a pull. The
    force is then unknown until it is zeroed again.
    """
    voltage_V: float | None
    """Applied voltage; null while the output has not confirmed it."""
    second_x_um: float | None = None
    """Position of the second arm. On a rig with one arm, this member and the following ones are
    null. All other members describe the first arm.
    """
    second_force_mN: float | None = None
    second_voltage_V: float | None = None


class Queue(Model):
    """Queue of jobs that wait for the running one."""

    model_config = example(
        length=2, halted="job 20260301-120000-1f0c failed: lost", capacity=16, proposed=0
    )

    length: int
    halted: str
    """Reason why the queue is halted; empty if the next job starts automatically. A person resumes
    the queue."""
    capacity: int
    proposed: int = 0
    """Number of jobs that wait for an approval. They have no position in the queue."""


QueueOrder = Literal["resume", "clear", "move"]


class QueueRequest(Model):
    """Request to change the queue."""

    model_config = example(type="move", job="20260301-120000-1f0c", position=1)

    type: QueueOrder
    """Requested change: resume with the next job, stop all waiting jobs, or move one of them."""
    job: str | None = Field(default=None, max_length=100)
    """Waiting job to be moved; only for ``move``."""
    position: Annotated[int, Field(ge=1, le=100), WHOLE] = 1
    """New position of the job, 1 for the next; a number larger than the length means the last
    position. Only for ``move``.
    """


UseLimit = Literal["days", "strokes", "contacts", "hours"]


class UseSinceCalibration(Model):
    """Use of the rig since the last accepted calibration, as its recorded jobs state it."""

    model_config = example(
        since="2026-03-01T12:00:00.000Z", strokes=5230, contacts=1180, hours=31.5, due=["strokes"]
    )

    since: str | None
    """Time of the newest acceptance in the model in use; null for the rig file alone, for which all
    jobs count.
    """
    strokes: int
    contacts: int
    hours: float
    """Time with the loop armed for jobs."""
    due: list[UseLimit]
    """Limits of ``[calibration]`` in the rig file that are exceeded; empty without limits."""


class SafeToMove(Model):
    """Statement whether the stage that carries the gripper may move."""

    model_config = example(value=False, state="moving", reasons=["the arm moves: approach"])

    value: bool
    state: MotionState
    """Motion of the arm; see the table of motions."""
    reasons: list[str]
    """Reasons why the stage must not move."""


class Rig(Model):
    """A rig: its programs, and whether a job can start or why it cannot."""

    model_config = example(
        name="demo",
        time="real",
        period_s=0.02,
        arms=1,
        digest="3f2a9d1c0b7e6655",
        model={"version": 0, "digest": ""},
        programs=[],
        checks=[],
        limits=[],
        latch={"state": "idle", "cause": "", "clear": ""},
        newest=None,
        part="none",
        standing=STANDING | {"state": "idle", "part": "none"},
        safe_to_move={"value": True, "state": "at_rest", "reasons": []},
        use={
            "since": "2026-03-01T12:00:00.000Z",
            "strokes": 412,
            "contacts": 96,
            "hours": 2.7,
            "due": [],
        },
        claim=None,
        active_job=None,
        queue={"length": 0, "halted": "", "capacity": 16, "proposed": 0},
        can_start=True,
        startable=["grip", "track", "move", "hold", "release", "calibrate"],
        reasons=[],
        warnings=[],
        allowed_actions=["start_job", "estop"],
    )

    name: str
    time: Literal["real", "lockstep"]
    period_s: float
    arms: int = 1
    """Number of driven arms. Kinds of job and laws list the numbers for which they are
    available.
    """
    digest: str
    """Digest of the rig file; it must be equal in all programs."""
    model: ModelInUse
    programs: list[Program]
    checks: list[Check] = Field(default_factory=list[Check])
    """All checks, each with its value and limit."""
    limits: list[LimitValue]
    latch: Latch
    newest: Newest | None
    part: PartState
    """State of the part: held, not held or unknown; ``standing`` states how certain it is."""
    standing: Standing
    safe_to_move: SafeToMove
    use: UseSinceCalibration | None = None
    """Use since the last calibration; null from a supervisor that does not count it."""
    claim: Claim | None = None
    """Claim on the rig; null if there is none."""
    active_job: str | None
    queue: Queue
    can_start: bool
    """True if a job that needs an empty gripper can start."""
    startable: list[str]
    """Kinds of job that can start. While a part is held without a job, these are ``hold`` and
    ``release``.
    """
    reasons: list[str]
    """Reasons why a job cannot start, as text."""
    warnings: list[str]
    """Problems that need attention although jobs can start."""
    allowed_actions: list[RigAction]


class RigList(Model):
    """The rigs that this supervisor serves."""

    model_config = example(rigs=[])

    rigs: list[Rig]


class ResetRequest(Model):
    """Request to clear the actuator's latch. It confirms that a person has seen the cause."""

    model_config = example(acknowledge=True)

    acknowledge: Literal[True]


class Stopped(Model):
    """Result of an emergency stop or a reset."""

    model_config = example(
        rig="demo", cause="estop", acknowledged=True, detail="", supervisor="3f9c0a51b2d47e68"
    )

    rig: str
    cause: str
    acknowledged: bool
    """True if the actuator has confirmed the stop or reset."""
    detail: str
    supervisor: str = ""
    """Identifier of the supervisor that replied, as in the page check; empty if the reply came over
    the bus.
    """


class StoppedList(Model):
    """Result of an emergency stop of every rig, all of which have confirmed it."""

    model_config = example(
        rigs=[
            {
                "rig": "demo",
                "cause": "estop",
                "acknowledged": True,
                "detail": "",
                "supervisor": "3f9c0a51b2d47e68",
            }
        ],
        supervisor="3f9c0a51b2d47e68",
    )

    rigs: list[Stopped]
    supervisor: str = ""
    """Identifier of the supervisor that replied, as in the page check."""
