"""Row 27: an output that does not confirm its voltage is read back before it moves again.

The actuator with each driver and its simulated instrument, in virtual time. A write is lost, its
reply is lost, the line fails, or the instrument loses its supply: once or for long, with samples or
without, with a watchdog or without. The voltage at the terminals is compared with the limits.
"""

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest

from pincette.config import RigFile, read_rig
from pincette.core.messages import Applied, Arm, Command, Position, Reset
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.engine.runner import Runner
from pincette.instruments.icpdas_i7024 import I7024, I7024Options
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import InstrumentError, Link, VoltageOutput
from pincette.instruments.srs_dc205 import DC205, DC205Options
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette_actuator import SERVICE
from tests.support.rigs import DEMO

T = 0.02
HIGH_V = 3.0
CLIMB_S, AFTER_S = 0.6, 0.7
WATCHED_S = 0.5
Fate = Literal["write lost", "answer lost", "line gone", "power cycle"]
DRIVERS = ("icpdas_i7024", "icpdas_i7024 unwatched", "srs_dc205")
SEEDS, SEEDS_IN_FULL = 4, 60


@dataclass
class Wired:
    """A driver, its instrument, and a line between them with its own faults."""

    name: str
    now_s: float = 0.0
    fate: Fate | None = None
    until_s: float = 0.0
    told: bool = False
    """True while the host sends messages; otherwise the instrument moves on its own."""
    moves: list[tuple[float, float, bool]] = field(default_factory=list)
    """Voltages at the terminals with their times, and whether the host has commanded them."""
    on_open: Callable[[Link], None] | None = None
    lost: bool = False

    def __post_init__(self) -> None:
        self.terminator: bytes | None = b"\r"
        if self.name.startswith("icpdas"):
            self.instrument: Any = SimulatedI7024(self.put, lambda: self.now_s)
            watchdog_s = 0.0 if "unwatched" in self.name else WATCHED_S
            self.output: VoltageOutput = I7024(I7024Options(watchdog_s=watchdog_s), self.connect)
        elif self.name == "srs_dc205":
            self.terminator = b"\n"
            self.instrument = SimulatedDC205(self.put)
            self.output = DC205(DC205Options(), self.connect)
        else:
            self.terminator = None
            OTHERS[self.name](self)

    @property
    def put_V(self) -> float:
        return self.moves[-1][1] if self.moves else 0.0

    def put(self, voltage_V: float) -> None:
        self.moves.append((self.now_s, voltage_V, self.told))

    def connect(self, on_open: Callable[[Link], None]) -> Link:
        self.on_open = on_open
        return MemoryLink(self._answer, self.terminator)

    def begin(self, fate: Fate, for_s: float) -> None:
        self.fate, self.until_s = fate, self.now_s + for_s
        if fate == "power cycle":
            self.instrument.power_cycle()

    def _answer(self, line: bytes) -> bytes | None:
        if self.now_s < self.until_s:
            if self.fate == "line gone":
                self.lost = True
                raise InstrumentError("the line is gone", "hung_up")
            if self.fate in ("write lost", "power cycle"):
                return None
            self._said(line)
            return None
        if self.lost and self.on_open is not None:
            self.lost = False
            self.on_open(MemoryLink(self._said, self.terminator))
        return self._said(line)

    def _said(self, line: bytes) -> bytes | None:
        self.told = True
        try:
            return self.instrument.answer(line)
        finally:
            self.told = False

    def idle(self) -> None:
        self.instrument.idle()


OTHERS: dict[str, Callable[[Wired], None]] = {}
"""Functions that set instrument and output of drivers in other packages; their tests add them."""


def demo_rig_file() -> RigFile:
    return read_rig(DEMO)


class Stage:
    """An actuator that is armed and commanded, sample by sample."""

    def __init__(self, name: str) -> None:
        self.rig = demo_rig_file()
        self.wired = Wired(name)
        self.runner = Runner(SERVICE, self.rig, self.wired.output, check_timing=False)
        self.wake_s = self.runner.config.age.wake_s
        self.seq, self.epoch = 0, 0
        self.echoes: list[tuple[float, Applied]] = []
        self.wanted_V = 0.0
        self.due_s = 0.0
        self.commanded = False

    @property
    def now_s(self) -> float:
        return self.wired.now_s

    def _keep(self, outputs: Any) -> None:
        self.echoes += [(self.now_s, one) for one in outputs if isinstance(one, Applied)]

    def ask(self, request: Any) -> Any:
        reply, outputs = self.runner.call(request, self.now_s)
        self._keep(outputs)
        return reply

    def arm(self) -> Any:
        self.epoch, self.seq = self.epoch + 1, 0
        self.wanted_V = self.runner.state.arms[0].voltage_V
        return self.ask(Arm(self.epoch, 5, self.rig.digest()))

    def run(self, for_s: float, chance: random.Random, *, samples: bool = True) -> None:
        """Let time pass, with a sample each period and a command that climbs, at any phase."""
        until_s = self.now_s + for_s
        while self.now_s < until_s:
            self.wired.now_s += self.wake_s * chance.uniform(0.9, 1.1)
            self.wired.idle()
            if samples and self.now_s >= self.due_s:
                self.due_s = self.now_s + T
                self._tick()
            self._keep(self.runner.tick(self.now_s))

    def _tick(self) -> None:
        self.runner.take(
            Position(self.epoch, self.seq, self.now_s, (ArmPosition(1.0, valid=True),)), self.now_s
        )
        self._keep(self.runner.fire(self.now_s) or ())
        self.wired.now_s += 0.003
        self.wanted_V = min(HIGH_V, self.wanted_V + 0.15)
        command = Command(
            self.epoch, self.seq, 5, (ArmCommand(self.wanted_V),), False, False, False, True
        )
        self.runner.take(command, self.now_s)
        self._keep(self.runner.fire(self.now_s) or ())
        self.seq += 1

    def most_step_V(self) -> float:
        """Return the largest step of a ramp, or of a command."""
        limits = self.runner.config
        slew_V = limits.arms[0].voltage.slew_V
        return max(slew_V, HIGH_V * 2.5 * limits.age.wake_s / limits.ramp_s) + 0.002


def check_steps(stage: Stage, said: str) -> None:
    before_V = 0.0
    for at_s, put_V, reported in stage.wired.moves:
        step_V = abs(put_V - before_V)
        assert not reported or step_V <= stage.most_step_V(), (
            f"{said}: {step_V:.3f} V at {at_s:.4f} s"
        )
        before_V = put_V


def check(name: str, fate: Fate, seed: int) -> None:
    chance = random.Random(f"{name} {fate} {seed}")
    case = f"{name}, {fate}, seed {seed}"
    stage = Stage(name)
    stage.ask(Reset(acknowledge=True))
    stage.arm()
    stage.run(CLIMB_S, chance)
    assert stage.wired.put_V > 2.5, case
    # A module that has lost its supply does not reply at once; a loss that cannot be noticed is not
    # reported.
    for_s = chance.choice(
        (0.05, 0.2, 1.0) if fate == "power cycle" else (0.004, 0.02, 0.05, 0.2, 1.0)
    )
    stage.run(chance.uniform(0.0, T), chance)
    stage.wired.begin(fate, for_s)
    samples = chance.random() < 0.5
    if not samples:
        stage.run(2.2 * T, chance)
    stage.run(for_s, chance, samples=samples)
    tells_no_untruth(stage, case)
    stage.run(AFTER_S, chance, samples=samples)
    check_steps(stage, case)
    echo = stage.echoes[-1][1]
    if echo.state == "armed":
        assert for_s < 2.5 * T, f"{case}: nothing was noticed"
        return
    assert echo.state == "latched", f"{case}: {echo}"
    assert not echo.unconfirmed, case
    assert stage.wired.put_V == pytest.approx(0.0, abs=0.002), f"{case}: not safe"
    assert stage.ask(Reset(acknowledge=True)) is not None
    stage.run(3 * T, chance)
    stage.arm()
    stage.run(CLIMB_S, chance)
    check_steps(stage, f"{case}, armed again")


def tells_no_untruth(stage: Stage, said: str) -> None:
    """Return whether each voltage that is reported as applied is applied, or reported as
    unconfirmed."""
    echo = stage.echoes[-1][1]
    if echo.state != "armed" and not echo.unconfirmed and stage.wired.fate != "power cycle":
        assert stage.wired.put_V == pytest.approx(echo.arms[0].voltage_V, abs=0.35), (
            f"{said}: {echo}"
        )


FATES: tuple[Fate, ...] = ("write lost", "answer lost", "line gone", "power cycle")
CASES = [(name, fate) for name in DRIVERS for fate in FATES]


@pytest.mark.parametrize(("name", "fate"), CASES)
def test_an_output_with_an_unconfirmed_voltage_never_jumps(name: str, fate: Fate) -> None:
    for seed in range(SEEDS):
        check(name, fate, seed)


@pytest.mark.full
@pytest.mark.parametrize(("name", "fate"), CASES)
def test_an_output_with_an_unconfirmed_voltage_never_jumps_in_many_cases(
    name: str, fate: Fate
) -> None:
    for seed in range(SEEDS, SEEDS_IN_FULL):
        check(name, fate, seed)


@pytest.mark.parametrize("name", DRIVERS)
def test_the_next_job_causes_no_voltage_step_at_an_idle_output_that_has_lost_its_voltage(
    name: str,
) -> None:
    """The voltage that it reports at the arming counts, not earlier commands."""
    chance = random.Random(21)
    stage = Stage(name)
    stage.ask(Reset(acknowledge=True))
    stage.arm()
    stage.run(CLIMB_S, chance)
    final = Command(stage.epoch, stage.seq, 5, (ArmCommand(HIGH_V),), False, False, True, True)
    stage.runner.take(
        Position(stage.epoch, stage.seq, stage.now_s, (ArmPosition(1.0, valid=True),)), stage.now_s
    )
    stage.runner.fire(stage.now_s)
    stage.runner.take(final, stage.now_s)
    stage.runner.fire(stage.now_s)
    assert stage.runner.state.mode == "idle"
    stage.wired.begin("power cycle", 0.0)
    stage.arm()
    assert stage.runner.state.arms[0].voltage_V == 0.0
    stage.run(CLIMB_S, chance)
    check_steps(stage, name)


@pytest.mark.parametrize("name", DRIVERS)
def test_without_a_fault_there_is_no_read_back_and_no_trip(name: str) -> None:
    check_without_a_fault(name)


def check_without_a_fault(name: str) -> None:
    stage = Stage(name)
    stage.ask(Reset(acknowledge=True))
    stage.arm()
    stage.run(1.0, random.Random(1))
    assert {echo.state for _, echo in stage.echoes[2:]} == {"armed"}
    assert stage.wired.put_V == pytest.approx(HIGH_V, abs=0.002)
    check_steps(stage, name)
