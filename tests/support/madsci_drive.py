"""The stock client of MADSci drives a node: run in the node's environment, with its address."""
# pyright: basic, reportMissingImports=false

import json
import sys
import threading
import time
from typing import Any

import httpx
from madsci.client.node.rest_node_client import RestNodeClient
from madsci.common.types.action_types import ActionRequest


def main(url: str, rest: str, force_mN: float) -> dict[str, Any]:
    """What came of each call."""
    client = RestNodeClient(url=url)
    said: dict[str, Any] = {"actions": sorted(client.get_info().actions)}

    def act(name: str, **args: Any) -> dict[str, Any]:
        request = ActionRequest(action_name=name, args=args)
        found = client.send_action(request, timeout=120.0)
        if found.errors == [] and str(found.status.value) != "succeeded":
            # What waits for an action gives its status alone where it has failed.
            found = client.get_action_result(found.action_id)
        errors = [[one.error_type, one.message] for one in found.errors]
        return {"status": str(found.status.value), "json": found.json_result, "errors": errors}

    def rig() -> dict[str, Any]:
        return httpx.get(f"{rest}/api/v1/rigs/demo", trust_env=False).json()

    def until(there: Any) -> None:
        deadline = time.monotonic() + 60.0
        while not there(rig()):
            if time.monotonic() > deadline:
                raise TimeoutError(rig()["reasons"])
            time.sleep(0.02)

    def during(command: str) -> dict[str, Any]:
        """A grip into which an admin command falls."""
        found: dict[str, Any] = {}
        thread = threading.Thread(target=lambda: found.update(act("grip", force_mN=force_mN)))
        thread.start()
        until(lambda view: view["active_job"] and view["newest"]["phase"] == "approach")
        found["command"] = client.send_admin_command(command).success
        thread.join()
        return found

    said["plan"] = act("plan", force_mN=force_mN)
    said["refused"] = act("grip", force_mN=500.0)
    said["infeasible"] = act("plan", force_mN=500.0)
    said["grip"] = act("grip", force_mN=force_mN)
    said["part"] = rig()["part"]
    said["second"] = act("grip", force_mN=force_mN)
    said["release"] = act("release")
    said["nothing"] = act("release")
    said["cancelled"] = during("cancel")
    until(lambda view: view["can_start"])
    said["stopped"] = during("safety_stop")
    until(lambda view: view["latch"]["state"] == "latched")
    said["latched"] = act("grip", force_mN=force_mN)
    said["errored"] = client.get_status().errored
    return said


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], sys.argv[2], float(sys.argv[3]))))
