"""A simulated rig that plays prepared samples as soon as it is armed."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pincette.bus.protocol import BusError, RefusalError, RequestHandler, Sink
from pincette.bus.refused import RefusedMessages
from pincette.config import RigFile, parse_calibration
from pincette.control.quantities import Document
from pincette.control.record import replace
from pincette.core import messages
from pincette.core.faults import Acted, Fault, Mode, Outcome, Predecessor
from pincette.core.messages.arms import ArmPosition
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.topics import TOPIC_OF, Request, Topic
from pincette_supervisor.rigs.health import PROGRAMS, SIMULATION
from tests.support.bytes_bus import carried

from . import samples
from .canned_record import closed, trip_reason

IN_HOLD, IN_APPROACH = 160, 60
"""Number of ticks of the prepared grip."""

ANSWERING = (*PROGRAMS, SIMULATION)
"""Programs that state their status."""


class CannedRig:
    """The bus of a rig whose services reply at once and play a prepared grip within the arming.

    ``pause_at`` names the tick before which the playing waits: for an action, or for ever.
    ``pauses`` are the ticks before which it waits for the action continue. If ``rests`` is false, a
    pause begins only when ``rest`` is called. If ``freezes`` is true, a trip keeps a held part
    until ``thaw`` or a reset. If ``deaf`` is true, the controller accepts every action and does
    nothing.
    """

    def __init__(self, rig: RigFile) -> None:
        self.rig = rig
        self.digests: dict[str, str] = dict.fromkeys(ANSWERING, rig.digest())
        self.instances: dict[str, int] = dict.fromkeys(ANSWERING, 1)
        self.replaces: int | None = None
        """Instance of the previous actuator, which was switched off with the latch of its boot."""
        self.told = rig.model_dump_json()
        """Replies of its programs to a request for their rig file."""
        self.exchanges: dict[str, tuple[ExchangeTimes, ...]] = {}
        """Measured exchanges of its programs with their instruments."""
        self.silent: set[str] = set()
        self.refused = RefusedMessages("supervisor")
        self.latch = "boot"
        self.epoch = 0
        self.asked: list[str] = []
        self.ticks: list[samples.Tick] = []
        self.edit: Callable[[list[samples.Tick]], list[samples.Tick]] = list
        self.pause_at: int | None = None
        self.pauses: list[int] = []
        self.calibration = ""
        """Digest of the model with which the rig was armed; empty for the rig file alone."""
        self.place = 0
        self.acts: list[str] = []
        """Requests to the controller, in order."""
        self.trips: list[messages.Trip] = []
        self.notices: list[messages.JobNotice] = []
        self.rests, self.freezes, self.deaf = True, False, False
        self.paused, self.frozen = False, False
        self.part_held = False
        """True if the actuator keeps a part beyond the end of a program."""
        self.mode: Mode | None = None
        """Mode that the actuator states in its status; None if it states none."""
        self.findings: dict[str, tuple[Fault, ...]] = {}
        self.missed = dict[str, int]()
        """Additional members of a program's status."""
        self.record: messages.Record | None = None
        self.records = Path()
        self.incomplete = ""
        """Reason why the record will not be complete."""
        self._last: messages.Applied | None = None
        self.turn = threading.RLock()
        """Lock that is held while the rig acts; a test holds it for consistent readings."""
        self._sinks: dict[Topic, list[Sink]] = {}
        self._latest: dict[Topic, messages.Message] = {}
        self._watchers: list[Callable[[str, bool], None]] = []

    def publish(self, message: messages.Message) -> None:
        topic, message = TOPIC_OF[type(message)], carried(message)
        if isinstance(message, messages.JobNotice):
            self.notices.append(message)
        self._latest[topic] = message
        for sink in self._sinks.get(topic, ()):
            sink(topic, message)

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> messages.Message | None:  # noqa: ARG002
        return self._latest.get(topic)

    def sinks(self, topic: Topic) -> list[Sink]:
        """Return the receivers of the messages of a topic."""
        return self._sinks.get(topic, [])

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        self._sinks.setdefault(topic, []).append(sink)

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        raise NotImplementedError(f"{question} {answerer}")

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        self._watchers.append(sink)
        for program in ANSWERING:
            sink(program, True)

    def kill(self, program: str) -> None:
        """Remove a program."""
        self.silent.add(program)
        for sink in self._watchers:
            sink(program, False)

    def revive(self, program: str) -> None:
        """Bring a program back."""
        self.silent.discard(program)
        for sink in self._watchers:
            sink(program, True)

    def idle(self) -> None:
        """Publish what a rig in real time publishes while nothing plays."""
        self.publish(messages.Position(self.epoch, 0, 0.0, (ArmPosition(0.01, valid=True),)))
        self.publish(self._applied(Mode.LATCHED if self.latch else Mode.IDLE, self.latch))

    def call(
        self, question: Request, request: messages.Message, timeout_s: float = 2.0
    ) -> messages.Message:
        service = question.service
        if service in self.silent:
            raise BusError(f"no program answers {service}/{question.name} within {timeout_s:g} s")
        if not isinstance(request, messages.StatusRequest):
            self.asked.append(f"{service}/{question.name}")
        with self.turn:
            return carried(self._answer(service, carried(request)))

    def _answer(self, service: str, request: messages.Message) -> messages.Message:
        match request:
            case messages.StatusRequest():
                digest, instance = self.digests[service], self.instances[service]
                values: dict[str, Any] = {"findings": self.findings.get(service, ())}
                values["exchanges"] = self.exchanges.get(service, ())
                if service == "actuator":
                    values |= {"mode": self.mode, "replaces": self.replaces}
                    values["predecessor"] = Predecessor.NONE
                counts = (self.epoch, 0, self.missed.get(service, 0), 0)
                return messages.Status(
                    service, "0.1.0", instance, digest, *counts, self.calibration, **values
                )
            case messages.RigFileRequest():
                return messages.RigFileReply(Document(self.told), self.rig.digest())
            case messages.Record():
                self.record = request
            case messages.Finish():
                return self._finish(request)
            case messages.Arm():
                self._arm(service, request)
            case messages.Reset():
                self.latch = ""
                self.part_held = self.part_held and self.frozen
                self.frozen = False
                self.publish(replace(self._applied(Mode.IDLE, ""), final=True))
            case messages.Trip():
                seq = self.place
                self.trips.append(request)
                self.trip(": ".join(filter(None, (request.cause, request.words))))
                return messages.Ack(seq)
            case messages.Action():
                seq = self.place
                self.acts.append(request.action)
                self._act(request.action)
                return messages.Ack(seq)
            case messages.TimingRequest():
                return samples.timing(service, self.place)
            case messages.Load() | messages.Lease() | messages.SimCommand() | messages.Idle():
                pass
            case _:
                raise AssertionError(request)
        return messages.Ack(self.place)

    def _arm(self, service: str, request: messages.Arm) -> None:
        if service == "actuator" and self.latch:
            raise RefusalError(f"the actuator is latched ({self.latch}): reset it first")
        if service != "sensor":
            return
        self.epoch, self.place = request.epoch, 0
        self.paused = self.part_held = False
        self._last = None
        self.calibration = parse_calibration(request.calibration).digest
        self.ticks = self.edit(samples.grip(request.epoch))
        self.play(self.pauses[0] if self.pauses else self.pause_at)

    def play(self, until: int | None = None) -> None:
        """Send prepared ticks up to a tick, or to the end."""
        with self.turn:
            end = len(self.ticks) if until is None else until
            while self.place < end:
                tick = self.ticks[self.place]
                self._last = tick.applied
                for message in tick.messages():
                    self.publish(message)
                self.place += 1

    def trip(self, cause: str) -> None:
        """Ramp and latch the actuator; the remaining samples are not played."""
        self.latch = cause
        held = self.place > 0 and self.ticks[self.place - 1].telemetry.held
        self.place = len(self.ticks)
        if self.freezes and held:
            self.frozen = self.part_held = True
            self.publish(self._applied(Mode.FROZEN, cause))
            return
        self.thaw()

    def thaw(self) -> None:
        """Ramp the actuator, and latch it then."""
        self.frozen = self.part_held = False
        self.publish(self._applied(Mode.RAMPING, self.latch))
        self.publish(replace(self._applied(Mode.LATCHED, self.latch), final=True))

    def _applied(self, state: Mode, told: str) -> messages.Applied:
        last = self._last or samples.grip(self.epoch)[0].applied
        cause, faults = trip_reason(told)
        return replace(
            last,
            state=state,
            cause=cause,
            faults=faults,
            part_held=self.part_held,
            answered=False,
        )

    def _act(self, action: str) -> None:
        if self.place >= len(self.ticks):
            raise RefusalError(f"no program runs: {action} cannot act")
        if self.deaf:
            return
        tick = self.ticks[self.place]
        held, outcome = tick.telemetry.held, tick.telemetry.outcome
        match action:
            case "continue":
                self._continue(tick)
            case "pause" if self.rests:
                self.rest()
            case "pause":
                pass
            case "resume":
                self.say(tick, (Acted.RESUME,), None)
                self.play(max(self.pause_at or len(self.ticks), self.place + 1))
            case "keep":
                self._keep(tick)
            case "stop" | "let_go" | "retract":
                self.say(tick, (Acted.STOP,), Outcome.STOPPED)
                self.play(self.place + 1 if held and action == "stop" else None)
            case _ if not held:
                raise RefusalError("no part is held: none can be released")
            case _:
                self.say(tick, (Acted(action),), outcome)
                self.play()

    def say(self, tick: samples.Tick, acted: tuple[Acted, ...], outcome: Outcome | None) -> None:
        """Let an action take effect at the next tick, and report an outcome from there on."""
        self.paused = False
        self.ticks[self.place] = replace(tick, telemetry=replace(tick.telemetry, acted=acted))
        if outcome is not None:
            self.ticks[self.place :] = [
                replace(later, telemetry=replace(later.telemetry, outcome=outcome))
                for later in self.ticks[self.place :]
            ]

    def rest(self) -> None:
        """Rest the references: one more sample like the previous one, marked as paused."""
        last = self.ticks[max(self.place - 1, 0)]
        stated = replace(last.telemetry, acted=(Acted.PAUSE,), paused=True)
        self.ticks.insert(self.place, replace(last, telemetry=stated))
        self.ticks[self.place :] = [
            samples.numbered(tick, seq)
            for seq, tick in enumerate(self.ticks[self.place :], self.place)
        ]
        self.pause_at = None if self.pause_at is None else self.pause_at + 1
        self.paused = True
        self.play(self.place + 1)

    def lose(self) -> None:
        """End the pause by a guard: the program retreats."""
        tick = self.ticks[self.place]
        self.say(tick, (), Outcome.LOST)
        self.play()

    def _keep(self, tick: samples.Tick) -> None:
        """End with the part held."""
        self.part_held = True
        self.ticks[self.place :] = []
        outcome = tick.telemetry.outcome or Outcome.STOPPED
        self.publish(replace(tick.telemetry, outcome=outcome, playing=False))
        self.publish(replace(tick.applied, state=Mode.IDLE, final=True, part_held=True))

    def _finish(self, request: messages.Finish) -> messages.Recorded:
        assert self.record is not None
        played = [message for tick in self.ticks[: self.place] for message in tick.messages()]
        return closed(self, self.record, request, played)

    def _continue(self, tick: samples.Tick) -> None:
        if self.place not in self.pauses:
            raise RefusalError("the program does not wait for a person: it cannot be continued")
        acted = replace(tick.telemetry, acted=(Acted.CONTINUE,))
        self.ticks[self.place] = replace(tick, telemetry=acted)
        self.play(next((place for place in self.pauses if place > self.place), None))

    def close(self) -> None:
        pass
