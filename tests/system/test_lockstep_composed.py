"""Several services in one process give the same bits as five; real processes over Zenoh."""

from pathlib import Path

import pytest

from pincette.api.requests import JobRequest
from pincette.core.topics import LOOP
from pincette.security.establishing import enrol
from tests.support.certificates import NOW, folder_for
from tests.support.partitions import Programs
from tests.support.rigs import demo_rig
from tests.support.running import running_rig
from tests.system.test_lockstep import GRIP, TRACK, in_one_process, recorded

WHOLE: Programs = ("loop",)
PAIRS: Programs = ("sensor+actuator", "estimator+controller")


@pytest.mark.parametrize(
    ("programs", "request_", "secured"),
    [(WHOLE, GRIP, False), (PAIRS, TRACK, False), (WHOLE, GRIP, True), (PAIRS, GRIP, True)],
    ids=["one", "pairs, track", "one over mutual TLS", "pairs over mutual TLS"],
)
def test_however_services_are_shared_out_they_give_the_same_bits(
    tmp_path: Path, programs: Programs, request_: JobRequest, secured: bool
) -> None:
    rig = demo_rig({"rig": {"composed": list(programs)}}, time="lockstep")
    if secured:
        folder = folder_for(tmp_path / "pki", rig.rig.name)
        enrol(folder, rig.rig.name, (), NOW, composed=rig.rig.composed)
        rig = rig.secured(folder.path)
    with running_rig(rig, tmp_path) as running:
        assert set(running.fleet.members) & {*LOOP, *programs} == set(programs)
        body = request_.model_dump(mode="json", exclude_unset=True)
        taken = running.post("/jobs", body).raise_for_status().json()
        job = running.ended(taken["id"])
    assert job["state"] == "succeeded"
    assert job["result"]["missed_ticks"] == 0
    numbers = in_one_process(rig, request_)
    assert recorded(tmp_path / "data" / "jobs" / job["id"], numbers) == numbers
