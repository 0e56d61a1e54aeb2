"""A SiLA server for each of two rigs; their one supervisor is killed while both are at work."""

import signal
from collections.abc import Generator

import pytest

from pincette.config.reading import laid_over
from pincette.engine.fleet import Fleet
from tests.support.grips import SHORT, restart
from tests.support.laboratory import Laboratory, laboratory
from tests.support.rigs import Tree, free_ports
from tests.support.sila import client_at, refusal, responses, until

FORCE_MN = 9.0
NEAR_MN = 1.0


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Generator[Laboratory]:
    paced: Tree = {"simulation": {"pace": 1.0}}
    with laboratory(tmp_path_factory.mktemp("laboratory"), laid_over(SHORT, paced)) as made:
        yield made


@pytest.fixture(scope="module")
def ports(lab: Laboratory) -> Generator[dict[str, int]]:
    """Where the server of each rig listens."""
    found: dict[str, int] = {}
    fleets: list[Fleet] = []
    try:
        for rig in (lab.left.rig, lab.right):
            port = found[rig.rig.name] = free_ports(1)
            path = lab.left.path.with_name(f"{rig.rig.name}.toml")
            text = lab.left.path if rig is lab.left.rig else path
            own = path.with_name(f"sila-{path.name}")
            told = text.read_text(encoding="utf-8").replace("port = 50052", f"port = {port}")
            own.write_text(told, encoding="utf-8")
            fleet = Fleet(rig, own, lab.left.data, lambda _name, _line: None)
            fleet.start(["sila"])
            fleets.append(fleet)
        yield found
    finally:
        for fleet in fleets:
            fleet.down()


def test_each_server_moves_its_own_rig_also_past_a_killed_supervisor(
    lab: Laboratory, ports: dict[str, int]
) -> None:
    with client_at(ports["left"]) as left, client_at(ports["right"]) as right:
        both = {"left": left, "right": right}
        assert len({one.SiLAService.ServerUUID.get() for one in both.values()}) == 2
        assert [one.Microgripper.Rig.get() for one in both.values()] == list(both)
        grips = {name: one.Microgripper.Grip(FORCE_MN, 0.3, "") for name, one in both.items()}
        for name, grip in grips.items():
            done = responses(grip)
            assert abs(done.HeldForce - FORCE_MN) < NEAR_MN
            assert lab.left.job(done.Job)["rig"] == name
        grips = {name: one.Microgripper.Grip(FORCE_MN, 0.0, "") for name, one in both.items()}
        until(lambda: all(rig["active_job"] for rig in lab.rigs().values()), "no jobs")
        lab.left.fleet.signal("supervisor", signal.SIGKILL)
        until(lambda: left.Microgripper.RigState.get() == "unreachable", "it is told as there")
        restart(lab.left, "supervisor")
        # The motions go on; the supervisor that comes back says that it does not know their end.
        for name, grip in grips.items():
            error = refusal(grip)
            assert (error.identifier, "interrupted" in error.message) == ("JobFailed", True), name
        for one in both.values():
            until(lambda one=one: one.Microgripper.RigState.get() != "unreachable", "not back")
