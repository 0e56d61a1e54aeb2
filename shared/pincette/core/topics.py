"""Every key on the bus, declared once: message, producer, and how it is sent.

A sample goes out at real-time priority and is dropped, not blocked, when a link stalls; in
lockstep it is sent reliably, since there every service answers every tick. A topic that is
not sent every tick is sent reliably, unless its producer must not be delayed. The newest message of
every topic can be queried on the topic's own key.
"""

from dataclasses import dataclass

from pincette.core import messages
from pincette.core.messages import Message

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
    """Sent by a program that must never wait for a link."""

    @property
    def reliable(self) -> bool:
        """Whether a stalled link delays it, for a bounded time, rather than losing it."""
        return not (self.per_tick or self.urgent)


@dataclass(frozen=True, slots=True)
class Request:
    """One query a program answers, with its request and its reply."""

    name: str
    service: str
    request: type[Message]
    reply: type[Message]
    summary: str


POSITION = Topic("position", messages.Position, "sensor", "measured tip position")
BURST = Topic(
    "burst",
    messages.Burst,
    "sensor",
    "buffered acquisition, if the sensor makes one",
    per_tick=False,
)
ESTIMATE = Topic("estimate", messages.Estimate, "estimator", "contact force and perturbation")
COMMAND = Topic("command", messages.Command, "controller", "commanded voltage")
APPLIED = Topic("applied", messages.Applied, "actuator", "voltage applied, state and cause")
TELEMETRY = Topic("telemetry", messages.Telemetry, "controller", "references and sliding function")
GROUND_TRUTH = Topic(
    "ground_truth",
    messages.GroundTruth,
    "rig",
    "true state of a simulated rig; for the record only",
)
REQUEST_LOG = Topic(
    "request_log",
    messages.RequestLog,
    "every program of the loop",
    "accepted requests; for the record only",
    per_tick=False,
    urgent=True,
)
TIMING = Topic(
    "timing",
    messages.Timing,
    "every program of the loop",
    "timing statistics, about once a second",
    per_tick=False,
    urgent=True,
)

JOB = Topic("job", messages.JobNotice, "supervisor", "a job's state and phase", per_tick=False)

TOPICS = (
    POSITION,
    BURST,
    ESTIMATE,
    COMMAND,
    APPLIED,
    TELEMETRY,
    GROUND_TRUTH,
    REQUEST_LOG,
    TIMING,
    JOB,
)
TOPIC_OF: dict[type[Message], Topic] = {topic.message: topic for topic in TOPICS}

LOOP = ("sensor", "estimator", "controller", "actuator")
"""The services of the loop, in the order in which a tick passes through them."""

LOAD = Request("load", "controller", messages.Load, messages.Ack, "load a program")
ACTION = Request(
    "action",
    "controller",
    messages.Action,
    messages.Ack,
    "stop, pause, resume, release, continue …",
)
LEASE = Request(
    "lease",
    "controller",
    messages.Lease,
    messages.Ack,
    "extend the time for which the program may play",
)
TRIP = Request("trip", "actuator", messages.Trip, messages.Ack, "go to the safe state, latch")
RESET = Request("reset", "actuator", messages.Reset, messages.Ack, "clear the latch")
RECORD = Request("record", "recorder", messages.Record, messages.Ack, "begin a job's record")
FINISH = Request("finish", "recorder", messages.Finish, messages.Recorded, "end a job's record")
SIM_COMMAND = Request(
    "sim_command", "rig", messages.SimCommand, messages.Ack, "operate a simulated rig"
)
ARM = {name: Request("arm", name, messages.Arm, messages.Ack, "begin a new epoch") for name in LOOP}
STATUS = {
    name: Request(
        "status", name, messages.StatusRequest, messages.Status, "version, epoch, counters"
    )
    for name in (*LOOP, "recorder")
}
TIMING_OF = {
    name: Request("timing", name, messages.TimingRequest, messages.Timing, "timing statistics")
    for name in LOOP
}
RIG_FILE = {
    name: Request(
        "rig_file",
        name,
        messages.RigFileRequest,
        messages.RigFileReply,
        "the rig file that it uses",
    )
    for name in LOOP
}
REQUESTS = (
    LOAD,
    ACTION,
    LEASE,
    TRIP,
    RESET,
    SIM_COMMAND,
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


def request_key(rig: str, request: Request) -> str:
    """Key expression under which a program answers a request."""
    return f"{ROOT}/{rig}/call/{request.service}/{request.name}"


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
