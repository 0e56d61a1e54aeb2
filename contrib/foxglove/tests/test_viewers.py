"""A client of the Foxglove protocol receives a grip as recorded, and can stop the rig."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import base64
import signal
from collections.abc import Generator
from pathlib import Path

import pytest
from mcap.reader import make_reader
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from contrib.support.viewer import viewing
from pincette.bus.endpoints import program_endpoint
from pincette.config.programs import VIEWERS
from pincette.core.topics import ESTIMATE, key
from tests.support.adapters import FORCE_MN, adapter_rig, ports_of_adapters
from tests.support.foreign import outsider
from tests.support.grips import make_ready, restart
from tests.support.running import RunningRig

WARNING = 1
"""Level of a status of the Foxglove protocol."""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    place = tmp_path_factory.mktemp("foxglove")
    with adapter_rig(place, ports_of_adapters(), ["foxglove"]) as found:
        yield found


@pytest.fixture
def rig(running: RunningRig) -> RunningRig:
    make_ready(running)
    return running


def test_a_viewer_sees_a_grip_as_recorded(rig: RunningRig) -> None:
    with viewing(rig.rig) as viewer:
        assert viewer.server["name"] == "pincette demo"
        viewer.subscribe("estimate", "telemetry", "applied", "job")
        job = rig.start_grip(force_mN=FORCE_MN)
        viewer.until(lambda: any(one.state == "succeeded" for one in viewer.seen["job"]), "no end")
        seen = viewer.seen
    record = Path(rig.ended(job)["record"]) / "job.mcap"
    with record.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = summary.schemas
    kept = {one.topic: schemas[one.schema_id] for one in summary.channels.values()}
    for topic, channel in viewer.channels.items():
        there = kept[topic]
        assert channel["schemaName"] == there.name
        assert base64.b64decode(channel["schema"]) == there.data
        assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
    phases = {one.phase for one in seen["telemetry"]}
    assert {"approach", "load", "hold"} <= phases
    assert max(one.arms[0].force_mN for one in seen["estimate"] if one.valid) == pytest.approx(
        FORCE_MN, abs=1.5
    )
    numbers = [one.seq for one in seen["estimate"]]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_clients_of_an_older_protocol_are_refused(rig: RunningRig) -> None:
    address = f"ws://127.0.0.1:{rig.rig.foxglove.port}"
    with (
        pytest.raises(Exception, match="400"),
        connect(address, subprotocols=[Subprotocol("foxglove.websocket.v1")]),
    ):
        pass


def test_viewers_see_that_messages_of_the_bus_are_refused(rig: RunningRig) -> None:
    """A viewer that connects later also receives the status."""
    router = program_endpoint(rig.rig, "recorder", lockstep=False).connect[0]
    with outsider("client", router) as tool:
        for _ in range(3):
            tool.put(key(rig.rig.rig.name, ESTIMATE), b"rubbish")
        with viewing(rig.rig) as viewer:
            viewer.until(lambda: "refused" in viewer.statuses, "no status")
    assert viewer.statuses["refused"]["level"] == WARNING


def test_a_page_of_another_origin_is_refused(rig: RunningRig) -> None:
    address = f"ws://127.0.0.1:{rig.rig.foxglove.port}"
    spoken = [Subprotocol("foxglove.sdk.v1")]
    with (
        pytest.raises(Exception, match="403"),
        connect(address, subprotocols=spoken, origin=Origin("https://elsewhere.example")),
    ):
        pass
    with connect(address, subprotocols=spoken, origin=Origin(VIEWERS[0])) as line:
        assert line.recv(timeout=10.0)


def test_the_emergency_stop_stops_and_is_reported(rig: RunningRig) -> None:
    with viewing(rig.rig) as viewer:
        job = rig.start_grip(until_released=True)
        rig.until_phase(job, "approach")
        viewer.subscribe("applied")
        viewer.call("estop")
        viewer.until(lambda: viewer.answers, "no answer")
        viewer.until(
            lambda: any(one.state == "latched" for one in viewer.seen["applied"]),
            "the viewer does not receive the latch",
        )
    (answer,) = viewer.answers
    assert answer["stopped"] is True
    ended = rig.ended(job)
    assert ended["ending"]["code"] == "tripped", ended["cause"]
    assert rig.view()["latch"]["cause"] == "estop"
    rig.post("/rigs/demo/reset", {"acknowledge": True}).raise_for_status()


def test_an_unreachable_supervisor_is_reported_and_samples_continue(rig: RunningRig) -> None:
    rig.until_phase(rig.start_grip(until_released=True), "hold")
    with viewing(rig.rig) as viewer:
        viewer.subscribe("estimate")
        rig.fleet.signal("supervisor", signal.SIGKILL)
        viewer.call("estop")
        viewer.until(lambda: viewer.answers, "no answer")
        (answer,) = viewer.answers
        assert answer["stopped"] is False
        assert "pincette estop" in answer["detail"]
        before = len(viewer.seen["estimate"])
        viewer.until(lambda: len(viewer.seen["estimate"]) > before + 20, "no samples")
        restart(rig, "supervisor")
        viewer.call("estop")
        viewer.until(lambda: len(viewer.answers) == 2, "no answer")
    assert viewer.answers[1]["stopped"] is True


def test_a_killed_server_leaves_the_part_held_and_can_be_restarted(rig: RunningRig) -> None:
    job = rig.start_grip(until_released=True)
    rig.until_phase(job, "hold")
    rig.fleet.signal("foxglove", signal.SIGKILL)
    restart(rig, "foxglove")
    with viewing(rig.rig) as viewer:
        viewer.subscribe("telemetry")
        viewer.until(lambda: len(viewer.seen["telemetry"]) > 5, "no samples")
    assert {one.phase for one in viewer.seen["telemetry"]} == {"hold"}
    rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    assert rig.ended(job)["state"] == "succeeded"
