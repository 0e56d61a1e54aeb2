"""Jobs from the command line: start, follow, act."""

from typing import Any

from rich.console import Console

from pincette.cli.follow import follow
from pincette.cli.rest import CliError, Supervisor
from pincette.cli.show import show_plan, show_result
from pincette.cli.show_model import show_calibration_plan


def start(url: str, kind: str, wishes: dict[str, Any], *, dry_run: bool) -> int:
    """Start a job and follow it to its end; the exit status says whether it succeeded."""
    console = Console(highlight=False)
    supervisor = Supervisor(url)
    request = {"kind": kind, "autostart": True, **wishes}
    if dry_run:
        plan = supervisor.post("/jobs", request, dry_run="true")
        if kind == "calibrate":
            show_calibration_plan(plan, console)
        else:
            show_plan(plan, console)
        return 0 if plan["feasible"] else 1
    name: str = supervisor.post("/jobs", request)["id"]
    try:
        job = follow(supervisor, name, console)
    except KeyboardInterrupt:
        raise CliError(
            f"no longer followed, but job {name} goes on: `pincette job stop {name}` stops it, "
            "`pincette estop` stops the rig"
        ) from None
    show_result(job, console)
    return 0 if job["state"] == "succeeded" else 1


def act(url: str, action: str, name: str) -> int:
    """Ask a job to stop, to abort, or to release its part."""
    job: dict[str, Any] = Supervisor(url).post(f"/jobs/{name}/actions", {"type": action})
    print(f"job {name}: {action} taken; it is {job['state']}")
    return 0
