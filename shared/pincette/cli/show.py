"""What a plan and a result look like on a screen."""

from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from pincette.cli.show_model import show_found

PLOTS = ("grip.png", "track.png", "calibration.png")
LABEL = 19
"""Width of the names of figures."""


def _table(*names: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for place, name in enumerate(names):
        table.add_column(name, justify="left" if place == 0 else "right")
    return table


def show_result(job: dict[str, Any], console: Console) -> None:
    """Print what a job came to."""
    good = job["state"] == "succeeded"
    colour = "green" if good else "red"
    console.print(f"\njob {job['id']} [bold {colour}]{job['state']}[/]")
    if job.get("cause"):
        console.print(f"  {job['cause']}", markup=False)
    result: dict[str, Any] | None = job.get("result")
    if result is None:
        return
    phases = _table("phase", "begins", "lasts")
    for phase in result["phases"]:
        phases.add_row(phase["phase"], f"{phase['start_s']:.2f} s", f"{phase['duration_s']:.2f} s")
    console.print()
    console.print(phases)
    console.print()
    if "calibration" in result:
        show_found(result, job["id"], console)
    lines = [] if "calibration" in result else result_lines(result)
    for label, text in [*lines, *record_lines(job)]:
        console.print(f"{label:<{LABEL}} {text}", markup=False, soft_wrap=True)


def _quantity(value: float | None, unit: str, digits: int = 2) -> str:
    return "not known" if value is None else f"{value:.{digits}f} {unit}"


def _contact(result: dict[str, Any]) -> list[tuple[str, str]]:
    return [
        ("outcome", str(result["outcome"])),
        ("contact position", _quantity(result["contact_x_um"], "µm")),
        ("contact stiffness", _quantity(result["contact_stiffness_mN_per_um"], "mN/µm", 3)),
    ]


def result_lines(result: dict[str, Any]) -> list[tuple[str, str]]:
    """The figures of a result, named, with their units."""
    if "shape" in result:
        return _track_lines(result)
    error = result["force_error_mN"]
    lines = [
        *_contact(result),
        (
            "force held",
            f"not known, of {result['force_target_mN']:g} mN"
            if error is None
            else f"{_quantity(result['force_held_mN'], 'mN')} "
            f"± {_quantity(result['force_uncertainty_mN'], 'mN')} "
            f"of {result['force_target_mN']:g} mN, error {error:+.2f} mN",
        ),
        ("peak force", _quantity(result["peak_force_mN"], "mN")),
        (
            "RMSE over the hold",
            f"position {_quantity(result['rmse_position_um'], 'µm', 3)}, "
            f"force {_quantity(result['rmse_force_mN'], 'mN', 3)}",
        ),
    ]
    true_mN = result.get("true_force_held_mN")
    if true_mN is not None:
        lines.append(("true force held", f"{true_mN:.2f} mN, known to the simulation alone"))
    return lines


def _track_lines(result: dict[str, Any]) -> list[tuple[str, str]]:
    height = (
        f"{_quantity(result['x_pp_um'], 'µm')} and {_quantity(result['force_pp_mN'], 'mN')}"
        " peak to peak"
    )
    lines = [
        *_contact(result),
        (str(result["shape"]), "not tracked" if result["x_pp_um"] is None else height),
        ("position error", _tracking(result["position_um"], "µm")),
        ("force error", _tracking(result["force_mN"], "mN")),
        ("force uncertainty", _quantity(result["force_uncertainty_mN"], "mN")),
    ]
    if result["true_force_mN"] is not None:
        lines.append(
            ("true force error", f"{_tracking(result['true_force_mN'], 'mN')}, by the simulation")
        )
    return lines


def _tracking(tracking: dict[str, Any] | None, unit: str) -> str:
    if tracking is None:
        return "not known"
    percent = tracking["rmse_percent"]
    share = "" if percent is None else f" ({percent:.2f} %)"
    return f"RMSE {tracking['rmse']:.3f} {unit}{share}, at most {tracking['maximum']:.3f} {unit}"


def record_lines(job: dict[str, Any]) -> list[tuple[str, str]]:
    """Where a job's record is, and its plot where the folder can be seen from here."""
    if not job.get("record"):
        return []
    folder = Path(job["record"])
    if folder.is_relative_to(Path.cwd()):
        folder = folder.relative_to(Path.cwd())
    lines = [("record", str(folder))]
    plots = (folder / name for name in PLOTS)
    return [*lines, *(("plot", str(plot)) for plot in plots if plot.is_file())]


def show_plan(plan: dict[str, Any], console: Console) -> None:
    """Print what a job would do."""
    phases = _table("phase", "begins", "lasts", "to", "force", "voltage")
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
    console.print()
    if "law" in plan:
        print_law(plan["law"], console)
    if "steady_errors" in plan:
        for label, text in steady_lines(plan["steady_errors"]):
            console.print(f"{label:<{LABEL}} {text}", markup=False, soft_wrap=True)
        console.print()
    if plan["feasible"]:
        console.print(f"feasible: {plan['duration_s']:.2f} s, within every limit of the rig")
        return
    console.print("[red]not feasible[/red]: the plan breaks a limit of the rig")
    for violation in plan["violations"]:
        console.print(f"  {violation['message']}", markup=False)


def print_law(law: dict[str, Any], console: Console) -> None:
    """Print which law a job runs with, and how stable its loop is at the worst."""
    gains = ", ".join(f"{name} = {law[name]:g}" for name in ("K_P", "K_I", "K_S", "K_f"))
    text = f"{law['scheme'].upper()}, {law['set']} set, {gains} ({law['gains_from']})"
    console.print(f"{'law':<{LABEL}} {text}", markup=False, soft_wrap=True)
    radius, limit = law["spectral_radius"], law["spectral_radius_limit"]
    text = f"{radius:.3f} at the worst, limit {limit:g}"
    console.print(f"{'spectral radius':<{LABEL}} {text}", markup=False, soft_wrap=True)


def steady_lines(errors: dict[str, float]) -> list[tuple[str, str]]:
    """Where the arm would rest if the part differed from the plan within its tolerances."""
    lowest_um, highest_um = errors["position_min_um"], errors["position_max_um"]
    lowest_mN, highest_mN = errors["force_min_mN"], errors["force_max_mN"]
    return [
        ("steady errors", "for a part within the tolerances of the rig file:"),
        ("  position", f"{lowest_um:+.2f} to {highest_um:+.2f} µm"),
        ("  force", f"{lowest_mN:+.2f} to {highest_mN:+.2f} mN, until the load finds the contact"),
    ]
