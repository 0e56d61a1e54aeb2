"""The stock client of MADSci drives a node: run in the node's environment, with its address.

``URL ACTION ARGUMENTS`` runs one action, ``URL each`` runs the actions in the standard input, ``URL
leave ACTION ARGUMENTS`` begins one and does not wait, ``URL admin COMMAND`` runs an admin command,
and ``URL all REST FORCE_MN PROCESS`` runs every case; PROCESS is the process id of the supervisor.
"""
# pyright: basic, reportMissingImports=false

import json
import os
import signal
import sys
import threading
import time
from typing import Any

import httpx
from madsci.client.node.rest_node_client import RestNodeClient
from madsci.common.types.action_types import ActionRequest


def action(client: RestNodeClient, name: str, **args: Any) -> dict[str, Any]:
    """Result of an action."""
    request = ActionRequest(action_name=name, args=args)
    found = client.send_action(request, timeout=120.0)
    if str(found.status.value) != "succeeded":
        # If an action has failed, the call that waits for it returns only its status.
        found = client.get_action_result(found.action_id)
    errors = [[one.error_type, one.message] for one in found.errors]
    return {"status": str(found.status.value), "json": found.json_result, "errors": errors}


def everything(client: RestNodeClient, rest: str, force_mN: float, process: int) -> dict[str, Any]:
    """Results of all calls, by name."""
    values: dict[str, Any] = {"actions": sorted(client.get_info().actions)}

    def act(name: str, **args: Any) -> dict[str, Any]:
        return action(client, name, **args)

    def rig() -> dict[str, Any]:
        return httpx.get(f"{rest}/api/v1/rigs/demo", trust_env=False).json()

    def until(there: Any) -> None:
        deadline = time.monotonic() + 60.0
        while not there(rig()):
            if time.monotonic() > deadline:
                raise TimeoutError(rig()["reasons"])
            time.sleep(0.02)

    def gripping(found: dict[str, Any]) -> threading.Thread:
        """A grip that runs in the background."""
        thread = threading.Thread(target=lambda: found.update(act("grip", force_mN=force_mN)))
        thread.start()
        return thread

    def during(command: str) -> dict[str, Any]:
        """A grip that an admin command interrupts, on a node that was locked in the meantime."""
        found: dict[str, Any] = {}
        thread = gripping(found)
        until(lambda view: (view["newest"] or {}).get("phase") == "approach" and view["active_job"])
        client.send_admin_command("lock")
        found["locked"] = client.get_status().ready is False
        found["command"] = client.send_admin_command(command).success
        thread.join()
        client.send_admin_command("unlock")
        return found

    def during_the_request() -> dict[str, Any]:
        """A grip and its cancellation that both wait at the port of the supervisor."""
        found: dict[str, Any] = {}
        os.kill(process, signal.SIGSTOP)
        try:
            thread = gripping(found)
            # A stopped process cannot report that a request is waiting for it, so the test waits
            # for a fixed time.
            time.sleep(1.0)
            cancel = threading.Thread(target=client.send_admin_command, args=["cancel"])
            cancel.start()
            time.sleep(0.5)
        finally:
            os.kill(process, signal.SIGCONT)
        cancel.join()
        thread.join()
        return found

    values["plan"] = act("plan", force_mN=force_mN)
    values["refused"] = act("grip", force_mN=500.0)
    values["infeasible"] = act("plan", force_mN=500.0)
    values["grip"] = act("grip", force_mN=force_mN)
    values["part"] = rig()["part"]
    values["second"] = act("grip", force_mN=force_mN)
    values["higher"] = act("grip", force_mN=force_mN + 5.0)
    values["lower"] = act("grip", force_mN=force_mN)
    values["release"] = act("release")
    values["nothing"] = act("release")
    client.send_admin_command("lock")
    values["locked"] = act("grip", force_mN=force_mN)["status"]
    client.send_admin_command("unlock")
    values["requested"] = during_the_request()
    until(lambda view: view["can_start"])
    values["cancelled"] = during("cancel")
    until(lambda view: view["can_start"])
    values["stopped"] = during("safety_stop")
    until(lambda view: view["latch"]["state"] == "latched")
    values["ready"] = client.get_status().ready
    values["latched"] = act("grip", force_mN=force_mN)
    values["errored"] = client.get_status().errored
    return values


if __name__ == "__main__":
    node = RestNodeClient(url=sys.argv[1])
    if sys.argv[2] == "all":
        found = everything(node, sys.argv[3], float(sys.argv[4]), int(sys.argv[5]))
    elif sys.argv[2] == "admin":
        answer = node.send_admin_command(sys.argv[3])
        found = {"success": answer.success, "errors": [one.error_type for one in answer.errors]}
    elif sys.argv[2] == "each":
        for line in sys.stdin:
            name, arguments = json.loads(line)
            print(json.dumps(action(node, name, **arguments)), flush=True)
        sys.exit()
    elif sys.argv[2] == "leave":
        request = ActionRequest(action_name=sys.argv[3], args=json.loads(sys.argv[4]))
        found = {"status": str(node.send_action(request, await_result=False).status.value)}
    else:
        found = action(node, sys.argv[2], **json.loads(sys.argv[3]))
    print(json.dumps(found))
