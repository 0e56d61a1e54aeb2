"""Whatever messages pass the decoders, no service raises, and others can decode what it sends.

Each service receives frames of all its topics and requests: valid, odd and corrupted. Seeded.
"""

import random
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pytest
from msgspec.structs import replace

from pincette.config import RigFile
from pincette.core.codec import decode, encode
from pincette.core.codec.refusals import CodecError
from pincette.core.messages import Applied, Arm, Command, Estimate, Load, Message, Reset
from pincette.core.topics import LOOP
from pincette.engine.process import loop_services
from pincette.engine.runner import Runner
from tests.support.arms import with_arm
from tests.support.frames import EPOCH, OWNER, Chance, sound, spoilt
from tests.support.rigs import demo_rig

SEED = 20132
FRAMES = 5_000
"""Number of frames for each service, in each kind of time."""
MANY = 125_000
STEP_S = 0.004
SERVICES = loop_services()
STEADY: dict[type, dict[str, Any]] = {
    Applied: {"state": "armed", "final": False},
    Estimate: {"tripped": False, "zero_age_s": 0.0, "x_um": 1.5},
}
"""Shares of the choices that mostly keep a program playing."""
RIGS = {time: demo_rig(time=time) for time in ("real", "lockstep")}


class Line:
    """An instrument of either kind: returns constant readings, and outputs voltages within the
    limits."""

    def __init__(self, rig: RigFile) -> None:
        self._limits = rig.limits
        self.voltage_V = rig.safety.safe_V

    def read_um(self) -> float:
        return 1.0

    def read_V(self) -> float:
        return self.voltage_V

    def write_V(self, voltage_V: float) -> None:
        assert self._limits.voltage_min_V <= voltage_V <= self._limits.voltage_max_V
        self.voltage_V = voltage_V

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:
        assert rate_hz > 0.0
        for voltage_V in (voltages_V[0], voltages_V[-1]):
            self.write_V(voltage_V)

    def look(self) -> None:
        """The wave goes on."""

    def close(self) -> None:
        """Do nothing: there is no port to close."""


class Besieged:
    """A service that receives arbitrary messages and requests; its own messages are decoded as
    others decode them."""

    def __init__(self, name: str, rig: RigFile, chance: Chance) -> None:
        service = SERVICES[name]
        self._runner = Runner(service, rig, Line(rig) if service.instrument else None, OWNER)
        self._chance, self._now, self._digest = chance, 100.0, rig.digest()
        self._heard = [item.topic.message for item in service.inputs]
        self._asked = [question.request for question in service.requests]
        self._good: set[tuple[int, int]] = set()
        """Epoch and seq of commands that the actuator may accept."""
        self._armed: int | None = None
        self._seq = -1
        self.told = Counter[str]()
        self._runner.begin(self._now)

    def frame(self) -> None:
        """Deliver a message, then let time pass."""
        luck = self._chance.random()
        if luck < 0.02:
            self._begin()
        elif luck < 0.3:
            self._go_on()
        else:
            kind = self._chance.choice((*self._heard, *self._heard, *self._asked))
            odd = self._chance.random() < 0.5
            payload = encode(sound(kind, self._chance)) if odd else spoilt(self._chance, kind)
            try:
                self._take(decode(kind, payload))
            except CodecError:
                self.told["refused"] += 1
        self._now += self._chance.choice((0.0, STEP_S))
        while (outputs := self._runner.fire(self._now)) is not None:
            self._say(outputs)
        if self._runner.due(self._now):
            self._say(self._runner.tick(self._now))
            self._runner.settle(self._now)

    def _begin(self) -> None:
        """Arm the service as a supervisor does, so that it has a state to lose."""
        self._seq = -1
        load: Load = sound(Load, self._chance)
        for request in (Reset(acknowledge=True), load, Arm(EPOCH, OWNER, self._digest)):
            if type(request) in self._asked:
                self._take(request)

    def _go_on(self) -> None:
        """Send the next sample of each topic with the next sequence number, though with any
        values."""
        self._seq += 1
        for kind in self._heard:
            sample = replace(sound(kind, self._chance), epoch=EPOCH, seq=self._seq)
            if not isinstance(sample, Applied) and self._chance.random() < 0.9:
                sample = with_arm(sample, valid=True)
            if isinstance(sample, Applied | Estimate) and self._chance.random() < 0.9:
                sample = with_arm(sample, **STEADY[type(sample)])
            self._take(decode(kind, encode(sample)))

    def _take(self, message: Message) -> None:
        if type(message) in self._heard:
            if isinstance(message, Command) and message.valid and message.owner == OWNER:
                self._good.add((message.epoch, message.seq))
            self._runner.take(message, self._now)
            self.told["heard"] += 1
            return
        reply, outputs = self._runner.call(message, self._now)
        self.told["declined" if isinstance(reply, str) else "answered"] += 1
        if isinstance(message, Arm) and not isinstance(reply, str):
            self._armed, self._good = message.epoch, set()
        if not isinstance(reply, str):
            self._say((reply,))
        self._say(outputs)

    def _say(self, outputs: Sequence[Message]) -> None:
        for message in outputs:
            assert isinstance(decode(type(message), encode(message)), type(message))
            self.told[type(message).__name__] += 1
            if isinstance(message, Applied) and message.answered:
                assert message.epoch == self._armed
                assert (message.epoch, message.seq) in self._good


def besiege(name: str, time: str, frames: int, seed: int) -> Counter[str]:
    """Send this many frames to one service; returns the outcomes."""
    besieged = Besieged(name, RIGS[time], random.Random(f"{seed} {name} {time}"))
    for _ in range(frames):
        besieged.frame()
    return besieged.told


SIEGES = [(name, time) for name in LOOP for time in RIGS]


@pytest.mark.parametrize(("name", "time"), SIEGES)
def test_no_frame_causes_an_exception_in_a_service(name: str, time: str) -> None:
    print(f"seed {SEED}")
    reported = besiege(name, time, FRAMES, SEED)
    assert all(reported[what] for what in ("refused", "heard", "answered", "declined"))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "time"), SIEGES)
def test_many_frames_cause_no_exception_in_a_service(name: str, time: str) -> None:
    seed = random.SystemRandom().randrange(2**32)
    print(f"seed {seed}")
    reported = besiege(name, time, MANY, seed)
    print(", ".join(f"{what} {count}" for what, count in sorted(reported.items())))
    assert all(reported[what] for what in ("refused", "heard", "answered", "declined"))
