"""What a result looks like on a screen."""

from pathlib import Path
from typing import Any

from rich.console import Console

from pincette.cli.show_model import show_found
from pincette.cli.tables import figures, table

PLOTS = ("grip.png", "track.png", "calibration.png")


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
    phases = table("phase", "begins", "lasts")
    for phase in result["phases"]:
        phases.add_row(phase["phase"], f"{phase['start_s']:.2f} s", f"{phase['duration_s']:.2f} s")
    console.print()
    console.print(phases)
    console.print()
    if "calibration" in result:
        show_found(result, job["id"], console)
    lines = [] if "calibration" in result else result_lines(result)
    figures([*lines, *record_lines(job)], console)


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
    if "ends_at" in result:
        return _motion_lines(result)
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


def _motion_lines(result: dict[str, Any]) -> list[tuple[str, str]]:
    pose = result["ends_at"]
    taught = f", taught as {result['teach']}" if result["teach"] else ""
    lines = [
        ("outcome", str(result["outcome"])),
        (
            "rests at",
            f"{_quantity(pose['x_um'], 'µm')}, {_quantity(pose['voltage_V'], 'V', 3)}{taught}",
        ),
    ]
    if result["target_um"] is not None:
        error = result["target_error_um"]
        said = "" if error is None else f", error {error:+.3f} µm"
        lines.append(("target", f"{result['target_um']:.2f} µm{said}"))
    if result["drift_um"] is not None:
        lines.append(("drift", f"{_quantity(result['drift_um'], 'µm', 3)} while the part was held"))
    if result["held_at_end"]:
        lines.append(("part", "still held: `pincette job release` lets it go"))
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
