"""An instrument behind a line with scripted faults."""

import pytest

from pincette.core.messages import SimCommand
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.script.faults import Fault, Faults, HungUpError
from pincette.sim.script.script import Script
from pincette.sim.script.scripted_line import ScriptedLine
from tests.unit.sim.stand import Echo, Rig, Stand, stand


def on_a_line(what: str, *value: float, lockstep: bool = True) -> tuple[Stand, Echo, Instrument]:
    bench, echo = stand(lockstep=lockstep), Echo()
    line = bench.script.link("sensor", echo)
    assert line.answer(b"before") == b"before"
    bench.order("sensor", what, *value)
    return bench, echo, line


def test_an_unplugged_instrument_receives_nothing_and_keeps_running() -> None:
    bench, echo, line = on_a_line("off")
    assert line.answer(b"MS,01") is None
    assert (echo.heard, echo.idled) == ([b"before"], 1)
    bench.order("sensor", "heal")
    assert line.answer(b"MS,01") == b"MS,01"


def test_a_pulled_cable_closes_a_connection() -> None:
    with pytest.raises(HungUpError):
        on_a_line("off", 1.0, lockstep=False)[2].answer(b"MS,01")
    assert on_a_line("off", 1.0, lockstep=True)[2].answer(b"MS,01") is None


def test_simulated_garbage_depends_on_seed_target_and_exchange_only() -> None:
    def said(seed: int, name: str) -> list[bytes | None]:
        script, rig = Script(seed=seed), Rig()
        script.operate(rig)
        line = script.link(name, Echo())
        script.order(SimCommand(name, "garbage"))
        return [line.answer(b"MS,01") for _ in range(50)]

    once = said(1, "sensor")
    assert once == said(1, "sensor")
    assert once != said(2, "sensor")
    assert once != said(1, "output")
    assert len(set(once)) > 45
    assert not any(b"\r" in reply or b"\n" in reply for reply in once if reply is not None)


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 1.0])
def test_an_intermittent_line_loses_the_configured_share_of_exchanges(share: float) -> None:
    _, echo, line = on_a_line("intermittent", share)
    lost = [line.answer(b"?") for _ in range(2000)].count(None)
    # Four standard deviations of a binomial share.
    assert abs(lost / 2000 - share) <= 4.0 * (share * (1.0 - share) / 2000) ** 0.5
    assert len(echo.heard) == 2001 - lost


def test_a_slow_answer_in_lockstep_is_dropped_after_its_timeout() -> None:
    script, rig, echo = Script(timeouts_s={"sensor": 0.1}), Rig(), Echo()
    script.operate(rig)
    line = script.link("sensor", echo)
    script.order(SimCommand("sensor", "slow", 0.1))
    assert line.answer(b"a") == b"a"
    script.order(SimCommand("sensor", "slow", 0.11))
    assert line.answer(b"b") is None
    assert echo.heard == [b"a", b"b"]


def test_a_slow_answer_waits_in_real_time() -> None:
    slept: list[float] = []
    slow = Faults((Fault("output", "slow", 0.3, 0.0),))
    line = ScriptedLine(Echo(), lambda: slow, "", None, slept.append)
    assert line.answer(b"x") == b"x"
    assert slept == [0.3]


def test_the_idle_call_reaches_the_instrument_behind_its_line() -> None:
    echo = Echo()
    ScriptedLine(echo, Faults, "", None).idle()
    assert echo.idled == 1
