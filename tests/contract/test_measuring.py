"""One real measurement of this machine, by separate programs over a separate bus."""

import pytest

from pincette.config.programs import Scheduling
from pincette.engine.measuring import machine
from pincette.engine.measuring.machine import MeasuringError, measure
from pincette.engine.measuring.worker import command

pytestmark = pytest.mark.usefixtures("stalls")

NONE = Scheduling(priority=0, timer_slack_s=0.0)


def test_a_real_machine_is_measured() -> None:
    """The test asserts that the machine was measured, not how punctual it is."""
    received: list[str] = []

    def progress(what: str, part_s: float) -> None:
        assert part_s > 0.0
        received.append(what)

    found = measure((0.002, 0.001), 1.0, NONE, progress, loaded=False)
    assert received == ["wake-ups each 2 ms", "wake-ups each 1 ms", "hops over the bus"]
    assert [one.period_s for one in found.wake_ups] == [0.002, 0.001]
    assert all(one.lateness.count > 0 for one in found.wake_ups)
    assert all(one.lateness.max_s > 0.0 for one in found.wake_ups)
    assert found.hop.count > 0
    assert found.refused == ""
    assert not found.loaded


def test_a_failing_program_is_reported_with_a_readable_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def other(scheduling: Scheduling, _task: str, *numbers: float) -> list[str]:
        return command(scheduling, "no such task", *numbers)

    def progress(_what: str, _part_s: float) -> None:
        """Do nothing: progress is not shown."""

    monkeypatch.setattr(machine, "command", other)
    with pytest.raises(MeasuringError, match="has failed"):
        measure((0.001,), 1.0, NONE, progress, loaded=False)
