"""What a kind of job declares about stops and leases holds for its jobs."""

from dataclasses import replace

import pytest

from pincette.api.job_kinds import JobKind, job_kinds
from pincette.config import RigFile
from pincette.core.faults import ActionCode, LeaseEnd
from pincette_supervisor import plugin
from pincette_supervisor.jobs.lease import interruption, lease_end, lease_s
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.motions import MoveJobRequest

MOVE = MoveJobRequest(kind="move", to_um=3.0)
GRIP = GripJobRequest(kind="grip", on_stop="retract")


@pytest.fixture
def kinds(monkeypatch: pytest.MonkeyPatch) -> dict[str, JobKind]:
    """The installed kinds; ``move`` and ``grip`` release a part, and continue for longer."""
    found = dict(job_kinds())
    for name in ("move", "grip"):
        found[name] = replace(found[name], on_stop="release", lease_factor=2.5)
    monkeypatch.setattr(plugin, "job_kinds", lambda: found)
    return found


def test_a_kind_states_what_a_stop_does_if_its_request_cannot(kinds: dict[str, JobKind]) -> None:
    assert kinds["move"].stop_of(MOVE) == "release"
    assert lease_end(MOVE) is LeaseEnd.LET_GO
    assert kinds["grip"].stop_of(GRIP) == "retract"
    assert lease_end(GRIP) is LeaseEnd.RETRACT


def test_a_kind_states_what_the_end_of_the_supervisor_does(kinds: dict[str, JobKind]) -> None:
    assert interruption(kinds["grip"]) is ActionCode.LET_GO
    assert interruption(kinds["hold"]) is ActionCode.STOP
    assert interruption(kinds["calibrate"]) is ActionCode.RETRACT
    assert interruption(None) is ActionCode.STOP


@pytest.mark.usefixtures("kinds")
def test_a_kind_states_how_long_its_program_runs_without_a_renewed_lease(rig_file: RigFile) -> None:
    assert lease_s(MOVE, rig_file) == 2.5 * rig_file.safety.lease_s
