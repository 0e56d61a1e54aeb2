"""Certificates, discovery and keys of the SiLA server on a network, with the stock client."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from sila2.client import SilaClient
from sila2.framework import DefinedExecutionError, InvalidMetadata, SilaConnectionError

from contrib.support.sila import refusal, responses, stock_client
from pincette.client import Supervisor
from pincette.security.folder import Folder
from tests.support.adapters import FORCE_MN, adapter_rig, until
from tests.support.certificates import folder_for
from tests.support.commands import pincette
from tests.support.rigs import Tree, free_ports
from tests.support.running import RunningRig

# sila2 searches for a server's UUID in its certificate; a certificate of an authority need not
# contain it.
pytestmark = pytest.mark.filterwarnings("ignore:Server certificate is missing the extension")

DISCOVERY_S = 20.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    return folder_for(tmp_path_factory.mktemp("certificates") / "pki", "demo")


@pytest.fixture(scope="module")
def keys() -> dict[str, str]:
    """Keys of the supervisor by their scope; filled when the rig starts."""
    return {}


@pytest.fixture(scope="module")
def rig(
    folder: Folder, keys: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Generator[RunningRig]:
    """A rig whose bus, REST and SiLA server use certificates, and whose REST requires keys."""
    place = tmp_path_factory.mktemp("sila")
    for scope in ("observe", "operate", "admin"):
        added = pincette("key", "add", f"a-{scope}", "--scope", scope, "--data", place / "data")
        assert added.returncode == 0, added.stderr
        keys[scope] = added.stdout.split()[-1]
    changes: Tree = {
        "bus": {"pki": str(folder.path)},
        "supervisor": {"tls": True},
        "sila": {
            "port": free_ports(1),
            "certificate": str(folder.path / "router.crt"),
            "discovery": True,
            "login": True,
        },
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PINCETTE_KEY", keys["observe"])
        patch.setenv("PINCETTE_PKI", str(folder.path))
        with adapter_rig(place, changes, ["sila"]) as running:
            yield running


@pytest.fixture
def believed(folder: Folder) -> dict[str, Any]:
    return {"root_certs": (folder.path / "authority.crt").read_bytes()}


def logged_in(client: Any, name: str, key: str) -> list[Any]:
    """Metadata with the token of a login with a key."""
    server = str(client.SiLAService.ServerUUID.get())
    login = client.AuthenticationService.Login(name, key, server, [])
    return [client.AuthorizationService.AccessToken(login.AccessToken)]


def test_clients_that_trust_another_authority_cannot_connect(
    rig: RunningRig, tmp_path: Path
) -> None:
    other = folder_for(tmp_path / "pki", "demo").path / "authority.crt"
    for details in ({"root_certs": other.read_bytes()}, {"insecure": True}):
        with pytest.raises((SilaConnectionError, ConnectionError)), stock_client(rig, **details):
            raise AssertionError("it has connected")


def test_a_motion_needs_a_login_with_a_key_that_may_operate(
    rig: RunningRig, keys: dict[str, str], believed: dict[str, Any]
) -> None:
    with stock_client(rig, **believed) as client:
        gripper = client.Microgripper
        until(lambda: gripper.RigState.get() != "unknown", "the state of the rig was not read")
        with pytest.raises(InvalidMetadata):
            gripper.Grip(FORCE_MN, 0.3, "")
        with pytest.raises(DefinedExecutionError) as caught:
            logged_in(client, "nobody", "pk_nothing")
        assert caught.value.identifier == "AuthenticationFailed"
        seeing = logged_in(client, "ada", keys["observe"])
        with pytest.raises(DefinedExecutionError) as caught:
            gripper.Plan(FORCE_MN, 0.3, "", metadata=seeing)
        assert caught.value.identifier == "NotPermitted"
        message = refusal(gripper.Grip(FORCE_MN, 0.3, "", metadata=seeing))
        assert message.identifier == "NotPermitted"
        acting = logged_in(client, "ada", keys["operate"])
        done = responses(gripper.Grip(FORCE_MN, 0.3, "", metadata=acting))
        assert done.Outcome == "gripped"
        grip = gripper.Grip(FORCE_MN, 0.0, "", metadata=acting)
        client.CancelController.CancelCommand(str(grip.execution_uuid))
        assert refusal(grip).identifier == "Cancelled"


def test_an_emergency_stop_needs_no_login(
    rig: RunningRig, folder: Folder, keys: dict[str, str], believed: dict[str, Any]
) -> None:
    with stock_client(rig, **believed) as client:
        assert client.Microgripper.EmergencyStop().Cause == "estop"
    url, authority = rig.rig.supervisor.url, folder.path / "authority.crt"
    with Supervisor(url, key=keys["admin"], authority=authority) as supervisor:
        view = supervisor.rig("demo")
        until(lambda: view.state().latch.state == "latched", "the rig did not come to rest")
        view.reset()


def test_the_server_is_found_by_discovery(rig: RunningRig, believed: dict[str, Any]) -> None:
    name = f"pincette {rig.rig.rig.name}"
    with SilaClient.discover(server_name=name, timeout=DISCOVERY_S, **believed) as found:
        client: Any = found
        assert client.Microgripper.Rig.get() == rig.rig.rig.name
        assert client.SiLAService.ServerType.get() == "PiezoMicrogripper"
