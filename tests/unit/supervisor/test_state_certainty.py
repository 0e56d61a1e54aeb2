"""How certain the reported state of actuator and part is; time is virtual."""

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from pincette.config import RigFile
from pincette.core.faults import Cause, Fault, FaultCode, Mode, fault
from pincette.core.messages import Applied
from pincette_supervisor.metrics import RigCollector

from . import samples
from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness

T0_S = 100.0
HEARD_S = 0.2
"""Age beyond which a sample no longer determines the state, in s."""
LETS_GO_S = 0.4
"""Earliest release of the demo's output, in s: after 0.5 s in steps of 0.1 s."""
SILENT = fault(FaultCode.INSTRUMENT_SILENT, "no answer on the line")


class Rig:
    """A rig in real time whose supervisor's clock a test sets."""

    def __init__(self, harness: Harness) -> None:
        self.harness, self.now_s = harness, T0_S
        harness.observer.clock = lambda: self.now_s
        harness.health.clock = lambda: self.now_s
        harness.bus.idle()
        harness.health.refresh(force=True)

    def say(self, place: int = IN_HOLD, **changes: Any) -> None:
        """Let the actuator publish a sample."""
        applied: Applied = samples.grip(7)[place].applied
        self.harness.bus.publish(replace(applied, **changes))

    def told(self, after_s: float) -> dict[str, Any]:
        """Return the REST state this long after the first sample."""
        self.now_s = T0_S + after_s
        return self.harness.get("/rigs/demo")


@pytest.fixture
def rig(real_time: RigFile, open_harness: Callable[..., Harness]) -> Rig:
    return Rig(open_harness(real_time))


def state_of(view: dict[str, Any]) -> tuple[str, str]:
    assert view["latch"]["state"] == view["standing"]["state"]
    return view["standing"]["state"], view["standing"]["state_certainty"]


def part_of(view: dict[str, Any]) -> tuple[str, str]:
    assert view["part"] == view["standing"]["part"]
    return view["part"], view["standing"]["part_certainty"]


def test_a_fresh_state_is_known(rig: Rig) -> None:
    rig.say()
    view = rig.told(0.0)
    assert (state_of(view), part_of(view)) == (("armed", "known"), ("held", "known"))
    assert view["standing"]["state_age_s"] == view["standing"]["part_age_s"] == 0.0


def test_an_actuator_killed_in_a_hold_holds_a_part_until_its_module_may_have_released(
    rig: Rig,
) -> None:
    rig.say()
    rig.harness.bus.kill("actuator")
    view = rig.told(HEARD_S + 0.01)
    assert (state_of(view), part_of(view)) == (("unknown", "unknown"), ("held", "believed"))
    assert view["standing"]["part_age_s"] == pytest.approx(HEARD_S + 0.01)
    view = rig.told(LETS_GO_S + 0.01)
    assert (state_of(view), part_of(view)) == (("unknown", "unknown"), ("unknown", "unknown"))
    assert view["standing"]["state_age_s"] == pytest.approx(LETS_GO_S + 0.01)
    assert not view["safe_to_move"]["value"]


def test_the_state_of_a_hanging_program_is_trusted_briefly_and_then_unknown(rig: Rig) -> None:
    rig.say()
    rig.harness.bus.silent.add("actuator")
    view = rig.told(HEARD_S + 0.01)
    assert (state_of(view), part_of(view)) == (("armed", "believed"), ("held", "believed"))
    assert state_of(rig.told(LETS_GO_S + 0.01)) == ("unknown", "unknown")


def test_a_part_is_believed_to_be_held_without_time_limit_if_the_output_holds_its_voltage(
    real_time: RigFile, open_harness: Callable[..., Harness]
) -> None:
    output = real_time.output.model_copy(
        update={"options": {"watchdog_s": 0.0}, "on_silence": "holds"}
    )
    rig = Rig(open_harness(real_time.model_copy(update={"output": output})))
    rig.say()
    rig.harness.bus.kill("actuator")
    view = rig.told(3600.0)
    assert (state_of(view), part_of(view)) == (("unknown", "unknown"), ("held", "believed"))


def test_a_part_known_to_be_absent_is_not_reported_as_held_later(rig: Rig) -> None:
    rig.say(IN_APPROACH)
    rig.harness.bus.kill("actuator")
    view = rig.told(60.0)
    assert (state_of(view), part_of(view)) == (("unknown", "unknown"), ("none", "believed"))


LOST = fault(FaultCode.OUTPUT_UNCONFIRMED, "no answer on the line")


@pytest.mark.parametrize(
    ("cause", "faults"), [(Cause.DEVICE, (SILENT,)), (Cause.ABORT, (LOST,))], ids=["trip", "later"]
)
def test_a_freeze_with_a_silent_output_does_not_count_as_holding(
    rig: Rig, cause: Cause, faults: tuple[Fault, ...]
) -> None:
    rig.say()
    frozen: dict[str, Any] = {
        "state": Mode.FROZEN,
        "cause": cause,
        "faults": faults,
        "answered": False,
    }
    rig.say(**frozen)
    view = rig.told(0.02)
    assert (state_of(view), part_of(view)) == (("frozen", "known"), ("held", "believed"))
    rig.now_s = T0_S + LETS_GO_S
    rig.say(**frozen)  # it continues to report its last message
    view = rig.told(LETS_GO_S + 0.01)
    assert (state_of(view), part_of(view)) == (("frozen", "known"), ("unknown", "unknown"))
    assert view["standing"]["part_age_s"] == pytest.approx(LETS_GO_S + 0.01)


def test_during_a_freeze_a_part_is_believed_to_be_held_with_the_age_of_the_confirmed_voltage(
    rig: Rig,
) -> None:
    rig.say()
    rig.now_s = T0_S + 5.0
    rig.say(state=Mode.FROZEN, cause=Cause.ABORT, answered=False)
    view = rig.told(5.02)
    assert (state_of(view), part_of(view)) == (("frozen", "known"), ("held", "believed"))
    assert view["standing"]["part_age_s"] == pytest.approx(5.02)


def test_metrics_export_the_state_too(rig: Rig) -> None:
    def served() -> dict[str, list[tuple[dict[str, str], float]]]:
        found = RigCollector(rig.harness.rigs).collect()
        return {
            metric.name: [(sample.labels, sample.value) for sample in metric.samples]
            for metric in found
        }

    rig.say()
    rig.harness.bus.kill("actuator")
    for after_s, reported in ((0.0, ("held", "known")), (1.0, ("unknown", "unknown"))):
        rig.now_s = T0_S + after_s
        metrics = served()
        ((_, heard_s),) = metrics["pincette_actuator_heard_age_seconds"]
        assert heard_s == pytest.approx(after_s)
        shown = [labels for labels, value in metrics["pincette_part"] if value]
        assert [(one["part"], one["certainty"]) for one in shown] == [reported]


@pytest.mark.parametrize(
    ("mode", "holder", "expected"),
    [
        (Mode.IDLE, None, ("none", "known")),
        (Mode.ARMED, None, ("none", "known")),
        (Mode.FROZEN, None, ("none", "known")),
        (Mode.LATCHED, None, ("unknown", "unknown")),
        (Mode.IDLE, "present", ("none", "known")),
        (Mode.ARMED, "present", ("none", "known")),
        (Mode.LATCHED, "present", ("unknown", "unknown")),
        (Mode.IDLE, "earlier", ("unknown", "unknown")),
        (Mode.ARMED, "earlier", ("unknown", "unknown")),
        (Mode.FROZEN, "earlier", ("unknown", "unknown")),
        (Mode.LATCHED, "earlier", ("unknown", "unknown")),
    ],
)
def test_a_restarted_actuator_does_not_know_of_an_earlier_part(
    rig: Rig, mode: Mode, holder: str | None, expected: tuple[str, str]
) -> None:
    health = rig.harness.health
    if holder is not None:
        health.note_part(True)
    if holder == "earlier":
        rig.harness.bus.instances["actuator"] += 1
        health.refresh(force=True)
        health.reset()
    rig.say(IN_APPROACH, state=mode, part_held=False)
    assert part_of(rig.told(0.0)) == expected
    health.note_part(None)
    assert part_of(rig.told(0.0)) == expected
    health.note_part(False)
    empty = "unknown" if mode == Mode.LATCHED else "none"
    assert part_of(rig.told(0.0))[0] == empty
