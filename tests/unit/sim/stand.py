"""A rig with a script, and an instrument on a line; time advances with the writes."""

from dataclasses import dataclass, field

from pincette.config.script import ScriptedOrder
from pincette.core.messages import SimCommand
from pincette.sim.rig.commands import Orders
from pincette.sim.script.script import Script

T = 0.02


@dataclass
class Rig(Orders):
    """A rig whose arm is at one micrometre per tick; time advances with the writes."""

    writes: list[float] = field(default_factory=list[float])
    done: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])

    def now_s(self) -> float:
        return len(self.writes) * T

    def measure_um(self) -> float:
        return float(len(self.writes))

    def put_out(self, voltage_V: float) -> None:
        self.writes.append(voltage_V)

    def _did(self, text: str) -> None:
        self.done.append((round(self.now_s(), 9), text))

    def place_part(self, contact_um: float | None = None) -> None:
        if contact_um == 13.0:
            raise ValueError("contact_um = 13 µm: there is no room")
        self._did(f"place {contact_um}")

    def remove_part(self) -> None:
        self._did("remove")

    def lose_part(self) -> None:
        self._did("lose")

    def hang(self, weight_mN: float) -> None:
        self._did(f"hang {weight_mN}")

    def scale_stiffness(self, factor: float) -> None:
        self._did(f"stiffness {factor}")

    def scale_hysteresis(self, factor: float) -> None:
        self._did(f"hysteresis {factor}")


class Echo:
    """An instrument that echoes its requests, and counts the calls of ``idle``."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []
        self.idled = 0

    def answer(self, line: bytes) -> bytes | None:
        self.heard.append(line)
        return line

    def idle(self) -> None:
        self.idled += 1


@dataclass
class Stand:
    """A rig with a script, driven tick by tick; tick k outputs k/10 V."""

    script: Script
    rig: Rig

    def __post_init__(self) -> None:
        self.script.operate(self.rig)
        self.measure = self.script.measure(self.rig.measure_um)
        self.put_out = self.script.put_out(self.rig.put_out)

    def run(self, ticks: int) -> list[float]:
        seen: list[float] = []
        for _ in range(ticks):
            seen.append(self.measure())
            self.put_out(0.1 * len(self.rig.writes))
        return seen

    def order(
        self, target: str, what: str, value: float | None = None, *, after_s: float = 0.0
    ) -> None:
        assert self.script.order(SimCommand(target, what, value, after_s)) == ""


def stand(*orders: ScriptedOrder, lockstep: bool = True) -> Stand:
    return Stand(Script(orders, lockstep=lockstep), Rig())


def entry(at_s: float, target: str, what: str, **more: float) -> ScriptedOrder:
    return ScriptedOrder(at_s=at_s, target=target, what=what, **more)
