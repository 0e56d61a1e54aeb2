"""After a job with a contact before its zero, the next zero needs a person's confirmation."""

from collections.abc import Callable

from pincette.config import RigFile
from pincette.control.record import replace
from pincette.core.faults import Outcome

from .harness import Harness
from .samples import Tick, numbered


def ending(phase: str) -> Callable[[list[Tick]], list[Tick]]:
    """Return an edit that ends a grip as a contact in the last tick of a phase."""

    def edit(ticks: list[Tick]) -> list[Tick]:
        (last, *_) = [n for n, tick in enumerate(ticks) if tick.telemetry.phase == phase][::-1]
        end = numbered(ticks[-1], last + 1)
        telemetry = replace(end.telemetry, phase="retreat", outcome=Outcome.CONTACT)
        return [*ticks[: last + 1], replace(end, telemetry=telemetry)]

    return edit


def test_after_a_touch_at_rest_every_later_job_waits_for_a_person(harness: Harness) -> None:
    harness.bus.edit = ending("zero")
    touched = harness.ended(harness.grip()["id"])
    assert (touched["state"], touched["ending"]["code"]) == ("failed", "bad_outcome")
    harness.bus.edit = list
    for body in ({"kind": "grip", "force_mN": 15.0}, {"kind": "move", "to_um": 5.0}):
        refused = harness.post("/jobs", body)
        assert refused.status_code == 409
        assert refused.json()["type"].endswith(":zero-not-confirmed")
        assert refused.json()["job"] == touched["id"]
    assert harness.ended(harness.grip(zero_confirmed=True)["id"])["state"] == "succeeded"
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"


def test_an_unconfirmed_zero_outlives_the_supervisor(
    rig_file: RigFile, open_harness: Callable[..., Harness], harness: Harness
) -> None:
    harness.bus.edit = ending("zero")
    harness.ended(harness.grip()["id"])
    harness.close()
    again = open_harness(rig_file)
    assert again.post("/jobs", {"kind": "grip"}).status_code == 409


def test_a_touch_during_the_motion_needs_no_confirmation(harness: Harness) -> None:
    harness.bus.edit = ending("approach")
    assert harness.ended(harness.grip()["id"])["state"] == "failed"
    harness.bus.edit = list
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"
