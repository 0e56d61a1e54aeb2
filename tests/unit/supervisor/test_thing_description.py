"""Content of the Thing Description about keys, several rigs, and the resources of REST."""

import json
from typing import Any

import pytest

from pincette_supervisor.rest.routes_probes import ACTIONS, EVENTS, OPEN, PROPERTIES, thing
from tests.support.api_document import openapi

BASE = "http://192.168.1.20:8000"


@pytest.fixture(scope="module")
def document() -> Any:
    return openapi()


def test_each_affordance_of_the_thing_description_is_a_rest_path(document: Any) -> None:
    for table, method in ((PROPERTIES, "get"), (ACTIONS, "post"), (EVENTS, "get")):
        assert {path for path in table.values() if method not in document["paths"][path]} == set()


def test_no_affordance_resets_the_rig(document: Any) -> None:
    actions = thing(document, "a", BASE)["actions"].values()
    assert not [one for one in actions if "reset" in one["forms"][0]["href"]]


def test_units_and_limits_of_a_request_are_kept(document: Any) -> None:
    kinds = thing(document, "a", BASE)["actions"]["start"]["input"]["oneOf"]
    whole = [one["properties"] for one in kinds if "properties" in one]
    found = {one["kind"]["const"]: one for one in whole}
    assert found.keys() >= {"grip", "track", "move", "hold", "release"}
    grip = found["grip"]
    assert "exclusiveMinimum" in json.dumps(grip["force_mN"])


def test_a_key_is_required_for_all_but_an_emergency_stop(document: Any) -> None:
    found = thing(document, "a", BASE, keys=True)
    assert found["security"] == "key"
    assert found["securityDefinitions"]["key"]["scheme"] == "bearer"
    free = {
        name for name, one in found["actions"].items() if one["forms"][0].get("security") == "none"
    }
    assert free == set(OPEN)
    assert list(thing(document, "a", BASE)["securityDefinitions"]) == ["none"]


def test_a_thing_description_links_to_the_other_rigs(document: Any) -> None:
    left = thing(document, "left", BASE, others=["right"])
    right = thing(document, "right", BASE, others=["left"])
    assert left["links"][0]["href"] == f"{BASE}/.well-known/wot?rig=right"
    assert left["id"] != right["id"]
    assert left["properties"]["state"]["forms"][0]["href"] == "api/v1/rigs/left"


def test_a_request_names_the_rig_if_there_are_several(document: Any) -> None:
    for others in ([], ["right"]):
        actions = thing(document, "left", BASE, others=others)["actions"]
        for name in ("plan", "start"):
            kinds = [one for one in actions[name]["input"]["oneOf"] if "properties" in one]
            assert {one["properties"]["rig"]["const"] for one in kinds} == {"left"}
            assert {"rig" in one.get("required", ()) for one in kinds} == {bool(others)}
