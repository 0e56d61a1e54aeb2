"""Declaration of every key on the bus: message, producer, and when and how it is sent.

If a link stalls, messages are dropped, so that no program waits for a link. In lockstep they are
delayed instead, since every service then processes every tick. The newest message of every topic
can be queried on the topic's own key.

A key has one producer, so that a query for its newest message has one reply. A topic that every
service of the loop publishes has one key per service.
"""

import re
from dataclasses import dataclass
from typing import Literal

from pincette.core import messages
from pincette.core.messages import Message

NAMESPACE = "pincette"
WIRE = 2
"""Version of keys and payloads; increased by every incompatible change."""
ROOT = f"{NAMESPACE}/v{WIRE}"
RIG_NAME = r"[a-z][a-z0-9-]{0,30}"
"""Regular expression of a rig's name."""
PROGRAM_TOKEN = re.compile(f"{ROOT}/(?P<rig>{RIG_NAME})/live/(?P<program>[a-z][a-z0-9_-]*)")
"""Liveliness token of a program; see ``live_key``."""

EACH_SERVICE = "each service of the loop"
"""Value of ``producer`` for topics that have one key per service."""
While = Literal["latched", "idle", "job"]
"""State of a rig in real time: the actuator is latched, or at rest, or a job plays a program."""
ALWAYS: tuple[While, ...] = ("latched", "idle", "job")


@dataclass(frozen=True, slots=True)
class Topic:
    """One kind of published message, with its key or keys."""

    name: str
    message: type[Message]
    producer: str
    """Program that publishes it, or ``EACH_SERVICE``."""
    summary: str
    published: tuple[While, ...] = ALWAYS
    """States of the rig in which it is published, in real time. In lockstep there are no ticks
    outside a job."""
    per_tick: bool = True
    bulky: bool = False
    """True for messages so large that they are sent at a lower priority than samples."""
    rate_hz: float | None = None
    """Largest mean rate at which a subscriber reads messages; further messages are dropped unread.
    None: no limit.
    """

    @property
    def per_service(self) -> bool:
        """Return whether the key ends with the service, because each service publishes the
        topic.
        """
        return self.producer == EACH_SERVICE


@dataclass(frozen=True, slots=True)
class Request:
    """One query that a program serves, with the types of request and reply."""

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
    published=("job",),
    per_tick=False,
    bulky=True,
)
ESTIMATE = Topic("estimate", messages.Estimate, "estimator", "contact force and perturbation")
COMMAND = Topic("command", messages.Command, "controller", "commanded voltage")
APPLIED = Topic("applied", messages.Applied, "actuator", "voltage applied, state and cause")
TELEMETRY = Topic(
    "telemetry",
    messages.Telemetry,
    "controller",
    "references and sliding function; between jobs the last sample of the last motion program",
    published=("job",),
)
GROUND_TRUTH = Topic(
    "ground_truth",
    messages.GroundTruth,
    "rig",
    "true state of a simulated rig at each write of its output; for the record only",
    published=("latched", "job"),
)
REQUEST_LOG = Topic(
    "request_log",
    messages.RequestLog,
    EACH_SERVICE,
    "each request that the service accepts; for the record only",
    per_tick=False,
)
TIMING = Topic(
    "timing",
    messages.Timing,
    EACH_SERVICE,
    "timing statistics, about once a second in real time",
    per_tick=False,
)

JOB = Topic(
    "job",
    messages.JobNotice,
    "supervisor",
    "a job's state and phase",
    published=("job",),
    per_tick=False,
)

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
PLACE = Topic(
    "place",
    messages.Place,
    "a vision client",
    "place of the part, which a job takes if its request asks so",
    per_tick=False,
    rate_hz=50.0,
)
INPUTS = (PLACE,)
"""Topics that clients publish and the supervisor reads; the programs of the loop do not read
them.
"""
TOPIC_OF: dict[type[Message], Topic] = {topic.message: topic for topic in (*TOPICS, *INPUTS)}

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
    "extend the time for which the motion program may run",
)
IDLE = Request("idle", "sensor", messages.Idle, messages.Ack, "sample slowly until the next arming")
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
    for name in (*LOOP, "recorder", "rig")
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
    IDLE,
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


def key(rig: str, topic: Topic, service: str = "*") -> str:
    """Return the key of a topic of one rig.

    If the topic has one key per service, return that of ``service``, by default a wildcard for all.
    """
    place = f"{ROOT}/{rig}/{topic.name}"
    return f"{place}/{service}" if topic.per_service else place


def keys_of(rig: str, topic: Topic) -> dict[str, str]:
    """Return the producers of a topic, each with its key."""
    producers = LOOP if topic.per_service else (topic.producer,)
    return {producer: key(rig, topic, producer) for producer in producers}


def topic_keys(rig: str) -> tuple[str, ...]:
    """Return key expressions that cover all topics of a rig, but no requests or tokens."""
    return f"{ROOT}/{rig}/*", *(key(rig, topic) for topic in TOPICS if topic.per_service)


def request_key(rig: str, request: Request) -> str:
    """Return the key expression under which a program serves a request."""
    return f"{ROOT}/{rig}/call/{request.service}/{request.name}"


def live_key(rig: str, program: str) -> str:
    """Return the key of a program's liveliness token."""
    return f"{ROOT}/{rig}/live/{program}"


def alive_of(token: str) -> tuple[str, str] | None:
    """Return rig and program of a liveliness token, or None if it is not the token of a program.

    Any tool on the bus may declare a token, even one with wildcards that matches the tokens of
    programs.
    """
    found = PROGRAM_TOKEN.fullmatch(token)
    return None if found is None else (found["rig"], found["program"])


def live_key_of_any_wire(rig: str) -> str:
    """Return a key expression that covers all liveliness tokens of a rig, for every version of the
    wire protocol.
    """
    return f"{NAMESPACE}/*/{rig}/live/*"
