"""Jobs from the command line: start, follow, stop."""

from pathlib import Path
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from pincette.bus.links import client_ends, direct_ends
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli.rest import CliError, Supervisor
from pincette.config import ConfigError, read_rig
from pincette.messages import Trip
from pincette.topics import TRIP

TERMINAL = frozenset({"succeeded", "stopped", "aborted", "failed", "interrupted"})
POLL_S = 0.2


def grip(url: str, wishes: dict[str, float], *, dry_run: bool) -> int:
    """Start a grip and follow it to its end; the exit status says whether it succeeded."""
    console = Console(highlight=False)
    supervisor = Supervisor(url)
    request = {"kind": "grip", "autostart": True, **wishes}
    if dry_run:
        show_plan(supervisor.post("/jobs", request, dry_run="true"), console)
        return 0
    job = follow(supervisor, supervisor.post("/jobs", request)["id"], console)
    show_result(job, console)
    return 0 if job["state"] == "succeeded" else 1


def follow(supervisor: Supervisor, name: str, console: Console) -> dict[str, Any]:
    """Show a job's progress until it has ended."""
    columns = (
        TextColumn("{task.description:<9}"),
        BarColumn(),
        TextColumn("{task.fields[now]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=not console.is_terminal) as progress:
        bar = progress.add_task("starting", total=None, now="")
        said = ""
        while True:
            job: dict[str, Any] = supervisor.get(f"/jobs/{name}", wait="terminal", timeout_s=POLL_S)
            live: dict[str, Any] = job.get("progress") or {}
            phase = live.get("phase") or job["state"]
            if phase != said and not console.is_terminal:
                console.print(f"  {phase}")
            said = phase
            progress.update(
                bar,
                description=phase,
                total=live.get("planned_s"),
                completed=live.get("elapsed_s", 0.0),
                now=_now(live),
            )
            if job["state"] in TERMINAL:
                return job


def _now(live: dict[str, Any]) -> str:
    if live.get("x_um") is None or live.get("force_mN") is None:
        return ""
    return f"{live['x_um']:7.2f} µm {live['force_mN']:6.2f} mN"


def show_result(job: dict[str, Any], console: Console) -> None:
    """Print what a grip came to."""
    console.print(f"job {job['id']} [bold]{job['state']}[/bold] {job.get('cause') or ''}")
    result: dict[str, Any] | None = job.get("result")
    if result is None:
        return
    phases = Table("phase", "begins", "lasts", title="phases", title_justify="left")
    for phase in result["phases"]:
        phases.add_row(phase["phase"], f"{phase['start_s']:.2f} s", f"{phase['duration_s']:.2f} s")
    console.print(phases)
    for label, text in result_lines(result):
        console.print(f"  {label:<19} {text}")
    if job.get("record"):
        console.print(f"  {'record':<19} {job['record']}", soft_wrap=True)


def _quantity(value: float | None, unit: str, digits: int = 2) -> str:
    return "not known" if value is None else f"{value:.{digits}f} {unit}"


def result_lines(result: dict[str, Any]) -> list[tuple[str, str]]:
    """The figures of a result, named, with their units."""
    held = (
        f"{_quantity(result['force_held_mN'], 'mN')} of {result['force_target_mN']:g} mN, "
        f"error {_quantity(result['force_error_mN'], 'mN')}, "
        f"uncertainty ± {_quantity(result['force_uncertainty_mN'], 'mN')}"
    )
    lines = [
        ("outcome", str(result["outcome"])),
        ("contact position", _quantity(result["contact_x_um"], "µm")),
        ("contact stiffness", _quantity(result["contact_stiffness_mN_per_um"], "mN/µm", 3)),
        ("force held", held),
        ("peak force", _quantity(result["peak_force_mN"], "mN")),
        ("RMSE over the hold", _rmse(result)),
    ]
    if result.get("true_force_held_mN") is not None:
        lines.append(
            (
                "true force held",
                f"{_quantity(result['true_force_held_mN'], 'mN')} (known to the simulation alone)",
            )
        )
    return lines


def _rmse(result: dict[str, Any]) -> str:
    position = _quantity(result["rmse_position_um"], "µm", 3)
    return f"position {position}, force {_quantity(result['rmse_force_mN'], 'mN', 3)}"


def show_plan(plan: dict[str, Any], console: Console) -> None:
    """Print what a grip would do."""
    phases = Table("phase", "begins", "lasts", "to", "force", "voltage")
    for phase in plan["phases"]:
        phases.add_row(
            phase["phase"],
            f"{phase['start_s']:.2f} s",
            f"{phase['duration_s']:.2f} s",
            f"{phase['x_um']:.2f} µm",
            f"{phase['force_mN']:.2f} mN",
            f"{phase['voltage_V']:.3f} V",
        )
    console.print(phases)
    console.print("feasible" if plan["feasible"] else "[red]not feasible[/red]")
    for violation in plan["violations"]:
        console.print(f"  {violation['pointer']} {violation['message']}")


def estop(rig_path: Path, url: str | None) -> int:
    """Trip the actuator through the supervisor, the router, or straight."""
    try:
        rig = read_rig(rig_path)
    except ConfigError as error:
        raise CliError(str(error)) from error
    started = monotonic()
    address = url or f"http://{rig.supervisor.host}:{rig.supervisor.port}"
    trouble: list[str] = []
    try:
        Supervisor(address).post(f"/rigs/{rig.rig.name}/estop")
    except CliError as error:
        trouble.append(str(error))
    else:
        print(f"stopped by the supervisor in {1e3 * (monotonic() - started):.0f} ms")
        return 0
    for ends in (
        direct_ends(rig.bus.host, rig.bus.port, "actuator"),
        client_ends(rig.bus.host, rig.bus.port),
    ):
        try:
            bus = ZenohBus(ends, rig.rig.name, "estop")
        except BusError as error:
            trouble.append(str(error))
            continue
        try:
            bus.ask(TRIP, Trip("estop"), 1.0)
        except BusError as error:
            trouble.append(str(error))
            continue
        finally:
            bus.close()
        print(f"stopped at the actuator in {1e3 * (monotonic() - started):.0f} ms")
        return 0
    raise CliError("the rig could not be stopped:\n  " + "\n  ".join(trouble))


def reset(url: str) -> int:
    """Acknowledge the cause and clear the latch."""
    supervisor = Supervisor(url)
    for rig in supervisor.get("/rigs")["rigs"]:
        supervisor.post(f"/rigs/{rig['name']}/reset", {"acknowledge": True})
        print(f"{rig['name']}: reset")
    return 0
