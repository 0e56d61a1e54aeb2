"""Every key on the bus, declared once: message, producer, and how it is sent.

A sample goes out at real-time priority and is dropped, not blocked, when a link stalls; in
lockstep it is sent reliably, since there every service answers every tick. What is told seldom is
sent reliably, unless whoever tells it must not be delayed by it. The newest message of every topic
can be queried on the topic's own key.
"""

from dataclasses import dataclass

from pincette import messages
from pincette.messages import Message

NAMESPACE = "pincette"
WIRE = 1
"""Version of keys and payloads; a change that breaks a listener raises it."""
ROOT = f"{NAMESPACE}/v{WIRE}"


@dataclass(frozen=True, slots=True)
class Topic:
    """One published key."""

    name: str
    message: type[Message]
    producer: str
    summary: str
    per_tick: bool = True
    urgent: bool = False
    """Told by a program that must not wait for a link, however seldom."""

    @property
    def reliable(self) -> bool:
        """Whether a stalled link delays it, for a bounded time, rather than losing it."""
        return not (self.per_tick or self.urgent)


@dataclass(frozen=True, slots=True)
class Question:
    """One query a program answers, with its request and its reply."""

    name: str
    service: str
    request: type[Message]
    reply: type[Message]
    summary: str


POSITION = Topic("position", messages.Position, "sensor", "measured tip position")
BURST = Topic(
    "burst", messages.Burst, "sensor", "buffered acquisition, where one is made", per_tick=False
)
ESTIMATE = Topic("estimate", messages.Estimate, "estimator", "contact force and perturbation")
COMMAND = Topic("command", messages.Command, "controller", "voltage asked for")
APPLIED = Topic("applied", messages.Applied, "actuator", "voltage applied, state and cause")
TELEMETRY = Topic("telemetry", messages.Telemetry, "controller", "references and sliding function")
TRUTH = Topic("truth", messages.Truth, "rig", "what a simulated rig knows; for the record only")
ASKED = Topic(
    "asked",
    messages.Asked,
    "every program of the loop",
    "questions taken; for the record only",
    per_tick=False,
    urgent=True,
)
TIMING = Topic(
    "timing",
    messages.Timing,
    "every program of the loop",
    "how punctual it is, about once a second",
    per_tick=False,
    urgent=True,
)

JOB = Topic("job", messages.JobNotice, "supervisor", "a job's state and phase", per_tick=False)

TOPICS = (POSITION, BURST, ESTIMATE, COMMAND, APPLIED, TELEMETRY, TRUTH, ASKED, TIMING, JOB)
TOPIC_OF: dict[type[Message], Topic] = {topic.message: topic for topic in TOPICS}

LOOP = ("sensor", "estimator", "controller", "actuator")
"""The services of the loop, in the order in which a tick passes through them."""

LOAD = Question("load", "controller", messages.Load, messages.Done, "load a program")
ACT = Question(
    "act", "controller", messages.Act, messages.Done, "stop, pause, resume, release, continue …"
)
LEASE = Question(
    "lease", "controller", messages.Lease, messages.Done, "let the program play on for a while"
)
TRIP = Question("trip", "actuator", messages.Trip, messages.Done, "go to the safe state, latch")
RESET = Question("reset", "actuator", messages.Reset, messages.Done, "clear the latch")
RECORD = Question("record", "recorder", messages.Record, messages.Done, "begin a job's record")
FINISH = Question("finish", "recorder", messages.Finish, messages.Recorded, "end a job's record")
ORDER = Question("order", "rig", messages.Order, messages.Done, "operate a simulated rig")
ARM = {
    name: Question("arm", name, messages.Arm, messages.Done, "begin a new epoch") for name in LOOP
}
STATUS = {
    name: Question(
        "status", name, messages.StatusRequest, messages.Status, "version, epoch, counters"
    )
    for name in (*LOOP, "recorder")
}
TIMING_OF = {
    name: Question(
        "timing", name, messages.TimingRequest, messages.Timing, "how punctual it has been"
    )
    for name in LOOP
}
RIG_FILE = {
    name: Question(
        "rig_file", name, messages.RigFileRequest, messages.RigFileTold, "the rig file it has"
    )
    for name in LOOP
}
QUESTIONS = (
    LOAD,
    ACT,
    LEASE,
    TRIP,
    RESET,
    ORDER,
    RECORD,
    FINISH,
    *ARM.values(),
    *STATUS.values(),
    *TIMING_OF.values(),
    *RIG_FILE.values(),
)


def key(rig: str, topic: Topic) -> str:
    """Key expression of a topic of one rig."""
    return f"{ROOT}/{rig}/{topic.name}"


def question_key(rig: str, question: Question) -> str:
    """Key expression under which a program answers a question."""
    return f"{ROOT}/{rig}/ask/{question.service}/{question.name}"


def live_key(rig: str, program: str) -> str:
    """Key expression of a program's liveliness token."""
    return f"{ROOT}/{rig}/live/{program}"


def alive_of(token: str) -> tuple[str, str]:
    """Rig and program of a liveliness token; see ``live_key``."""
    rig, _, program = token.removeprefix(f"{ROOT}/").split("/")
    return rig, program


def live_key_of_any_wire(rig: str) -> str:
    """Key expression of all liveliness tokens of a rig, whatever wire version they are of."""
    return f"{NAMESPACE}/*/{rig}/live/*"
