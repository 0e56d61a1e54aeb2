"""The virtual loop with its users: requests, arming, resets, and faults of its programs."""

from collections.abc import Callable
from typing import Self

from pincette.control.planning.program import Program as Played
from pincette.control.quantities import Document
from pincette.core.faults import Predecessor
from pincette.core.messages import Applied, Arm, Load, Message, Reset
from pincette.engine.arming import ORDER
from tests.support.virtual_loop_engine import Engine
from tests.support.virtual_loop_program import forked_runner

PATIENCE_S = 2.0


class VirtualLoop(Engine):
    """A rig in virtual real time; ``fork`` returns a copy that continues independently."""

    @property
    def newest(self) -> Applied:
        """Last message of the actuator."""
        return self.applied[-1][1]

    def call_at(self, at_s: float, deed: Callable[[Self], None]) -> None:
        """Do something to the loop at a given time."""
        self._push(at_s, "call", "", deed)

    def call(self, name: str, request: Message) -> Message | str:
        """Send a request to a program; returns the reply, or the text of a refusal."""
        replies: list[Message | str] = []
        self.hand_over(self.program(name), (name, request, replies.append))
        assert self.run(self.now_s + PATIENCE_S, lambda: bool(replies)), f"{name} does not answer"
        return replies[0]

    def arm(self, program: Played, epoch: int = 1, calibration: str = "") -> None:
        """Load a program and begin an epoch, as the supervisor does."""
        owner, digest = self.runner("controller").instance, self.rig.digest()
        self.must("controller", Load(program))
        for name in ORDER:
            self.must(name, Arm(epoch, owner, digest, Document(calibration), program.capture_hz))

    def must(self, name: str, request: Message) -> None:
        """Send a request, and fail if it is refused."""
        reply = self.call(name, request)
        assert not isinstance(reply, str), reply

    def reset(self) -> None:
        """Reset, as a person does after seeing the cause."""
        self.must("actuator", Reset(acknowledge=True))

    def kill(self, name: str) -> None:
        self.programs[name].alive = False
        if self.program("actuator") is self.programs[name]:
            self.predecessor = Predecessor.DIED

    def stop(self, name: str, for_s: float) -> None:
        """Stall the program; incoming messages wait."""
        program = self.programs[name]
        program.stopped_until_s = max(program.stopped_until_s, self.now_s + for_s)

    def restart(self, name: str) -> None:
        """Start a new instance of a program that was killed."""
        if name in self.fresh:
            runner = forked_runner(self.fresh[name], {})
            runner.instance = self.instances
            self.start(name, [runner])
        else:
            self.add(name)

    def add_rival(self, program: Played, epoch: int) -> None:
        """Add a second controller, armed for the same epoch as another owner."""
        runner = forked_runner(self.fresh["controller"], {})
        runner.instance = self.instances
        self.start("rival", [runner])
        self.must("rival", Load(program))
        self.must("rival", Arm(epoch, runner.instance, self.rig.digest()))

    def put_out_by_module(self) -> float:
        """Return the voltage that the output's module reports."""
        reply = self.bench.module.answer(b"$0180")
        assert reply is not None
        return float(reply[3:])
