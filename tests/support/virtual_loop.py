"""The virtual loop with those around it: who asks, arms and resets, and who hurts its programs."""

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
    """A rig in real time whose clock is made; ``fork`` gives a twin that goes on by itself."""

    @property
    def newest(self) -> Applied:
        """Last message of the actuator."""
        return self.applied[-1][1]

    def call_at(self, at_s: float, deed: Callable[[Self], None]) -> None:
        """Do something to the loop at a time."""
        self._push(at_s, "call", "", deed)

    def call(self, name: str, request: Message) -> Message | str:
        """Ask a program; the reply, or the text of a refusal."""
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
        """Ask, and fail where that is refused."""
        reply = self.call(name, request)
        assert not isinstance(reply, str), reply

    def reset(self) -> None:
        """What a person does who has seen the cause."""
        self.must("actuator", Reset(acknowledge=True))

    def kill(self, name: str) -> None:
        self.programs[name].alive = False
        if self.program("actuator") is self.programs[name]:
            self.predecessor = Predecessor.DIED

    def stop(self, name: str, for_s: float) -> None:
        """The program stands still; what comes waits."""
        program = self.programs[name]
        program.stopped_until_s = max(program.stopped_until_s, self.now_s + for_s)

    def restart(self, name: str) -> None:
        """A fresh program in place of one that was killed, of another instance."""
        if name in self.fresh:
            runner = forked_runner(self.fresh[name], {})
            runner.instance = self.instances
            self.start(name, [runner])
        else:
            self.add(name)

    def add_rival(self, program: Played, epoch: int) -> None:
        """A second controller, armed for the same epoch as another owner."""
        runner = forked_runner(self.fresh["controller"], {})
        runner.instance = self.instances
        self.start("rival", [runner])
        self.must("rival", Load(program))
        self.must("rival", Arm(epoch, runner.instance, self.rig.digest()))

    def put_out_by_module(self) -> float:
        """What the output's module says that it puts out."""
        reply = self.bench.module.answer(b"$0180")
        assert reply is not None
        return float(reply[3:])
