"""The trace context of a request changes no bit of its motion."""

from pathlib import Path

from pincette.control.record import replace
from pincette.core.messages import Message
from pincette_supervisor.kinds.grip import GripJobRequest
from tests.support.grips import SHORT
from tests.support.office import Office
from tests.support.rigs import demo_rig
from tests.support.virtual_rig import VirtualRig

GRIP = GripJobRequest(kind="grip", autostart=True, hold_s=0.2)
TICKS = 250
TRACE = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"


def played(data: Path, trace: str | None) -> list[Message]:
    """Grip a part; returns the messages of the loop without the epoch, which is random."""
    rig = VirtualRig(demo_rig(SHORT, time="lockstep"), data)
    office = Office(rig, data)
    job, _ = office.manager.create(GRIP, trace=trace)
    office.steps.pass_(TICKS)
    assert office.manager.index.job(job.id).traceparent == trace
    office.end()
    rig.close()
    return [replace(message, epoch=0) for message in (*rig.applied, *rig.telemetry)]


def test_a_traced_grip_has_the_same_bits_as_an_untraced_one(tmp_path: Path) -> None:
    untraced, traced = played(tmp_path / "untraced", None), played(tmp_path / "traced", TRACE)
    assert len(untraced) >= TICKS // 2
    assert traced == untraced
