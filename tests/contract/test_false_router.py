"""No other program is mistaken for the router, and a default of allow would leave a hole in the
access list."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
from time import monotonic, sleep
from typing import Any

import pytest
import zenoh

from pincette.bus.endpoints import program_endpoint, tool_endpoint
from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.settings import settings
from pincette.bus.topology import TlsIdentity, router_session, secured
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.faults import Cause
from pincette.core.messages import Trip
from pincette.core.topics import COMMAND, TRIP, key
from pincette.security.folder import Folder
from pincette.security.identity import person, program
from tests.support.certificates import Intruder
from tests.support.rigs import demo_rig

WAIT_S = 30.0
QUIET_S = 0.3


def test_a_viewer_cannot_be_mistaken_for_a_router(folder: Folder) -> None:
    """The certificate of the viewer is not valid for a server, so no client accepts it."""
    rig = demo_rig().secured(folder.path)
    viewer = TlsIdentity(folder.credentials(person("viewer", "viewer")), {})
    false = secured(router_session("127.0.0.1", rig.bus.port), viewer)
    with open_session(false, "false"), pytest.raises(BusError, match="not trusted here"):
        open_session(tool_endpoint(rig), "tool")


def test_a_client_sends_nothing_to_a_false_router(folder: Folder) -> None:
    """A service's certificate is valid for a server; a client still sends nothing to it."""
    rig = demo_rig().secured(folder.path)
    sensor = TlsIdentity(folder.credentials(program("sensor", "demo")), {})
    tree = settings(secured(router_session("127.0.0.1", rig.bus.port), sensor), "false")
    tree.pop("access_control")
    heard: list[Any] = []
    with zenoh.open(zenoh.Config.from_json5(json.dumps(tree))) as false:
        false.declare_subscriber("**", heard.append)
        false.declare_queryable("**", heard.append)
        bus = ZenohBus(program_endpoint(rig, "supervisor", lockstep=False), "demo", "supervisor")
        with pytest.raises(BusError, match="no program answers"):
            bus.call(TRIP, Trip(Cause.ESTOP), 0.3)
        bus.close()
    assert heard == []


def test_a_wildcard_bypasses_a_deny_rule_under_a_default_of_allow(
    folder: Folder,
) -> None:
    """The reason for denying everything that no rule allows: a default of allow leaves a hole."""
    port = demo_rig().bus.port
    member = TlsIdentity(folder.credentials(program("router", "")), {})
    tree = settings(secured(router_session("127.0.0.1", port), member), "lax")
    tree["access_control"] = {
        "enabled": True,
        "default_permission": "allow",
        "rules": [
            {
                "id": "kept",
                "permission": "deny",
                "flows": ["ingress"],
                "messages": ["put"],
                "key_exprs": [key("demo", COMMAND)],
            }
        ],
        "subjects": [{"id": "viewer", "cert_common_names": ["viewer"]}],
        "policies": [{"id": "kept", "subjects": ["viewer"], "rules": ["kept"]}],
    }
    got: list[str] = []
    viewer, hearer = (
        Intruder(name, folder.credentials(folder.named(name)))
        for name in ("viewer", "demo/recorder")
    )
    with (
        zenoh.open(zenoh.Config.from_json5(json.dumps(tree))),
        hearer.joined("127.0.0.1", port) as ears,
        viewer.joined("127.0.0.1", port) as mouth,
    ):
        ears.declare_subscriber(
            key("demo", COMMAND), lambda sample: got.append(sample.payload.to_string())
        )
        sleep(QUIET_S)
        mouth.put(key("demo", COMMAND), "exact")
        mouth.put("pincette/v2/demo/*", "wildcard")
        deadline = monotonic() + WAIT_S
        while not got:
            assert monotonic() < deadline
            sleep(0.01)
    assert got == ["wildcard"]
