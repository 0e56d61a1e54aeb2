"""Plans and results of jobs, as text."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pincette.cli import working_folder
from pincette.cli.terminal import figures, table

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import Console

    from pincette.api.calibrations import CalibrationPlan
    from pincette.api.job_kinds import ResultField
    from pincette.api.jobs import Job
    from pincette.api.plans import JobPlan, Law, MotionPlan, Plan, SteadyErrors
    from pincette.api.predictions import Prediction


def show_plan(plan: "JobPlan", console: "Console") -> None:
    """Print what a job would do, and each limit that it would exceed."""
    from pincette.api.calibrations import CalibrationPlan
    from pincette.api.plans import MotionPlan, Plan
    from pincette.api.predictions import Prediction

    if isinstance(plan, CalibrationPlan):
        _calibration(plan, console)
    elif isinstance(plan, Plan | MotionPlan):
        _motion(plan, console)
    if (place := plan.place) is not None:
        ways = zip(place.search_from_um, place.search_to_um, strict=False)
        searched = " and ".join(f"{start:.2f} to {end:.2f} µm" for start, end in ways)
        console.print(
            f"place of {place.source}: {place.x_um:.2f} ± {place.u_um:.2g} µm, {place.age_s:.1f} s "
            f"old; search range {searched}",
            markup=False,
        )
    violations = list(plan.violations)
    prediction = getattr(plan, "prediction", None)
    if isinstance(prediction, Prediction):
        figures(predicted_lines(prediction), console)
        console.print()
        violations += prediction.violations
    if plan.feasible:
        extent = "within every limit of the rig"
        if isinstance(plan, CalibrationPlan):
            volts = f"{plan.voltage_min_V:.3f} V to {plan.voltage_max_V:.3f} V"
            extent = f"{plan.waits} waits, {volts}"
        console.print(f"[green]feasible[/green]: {plan.duration_s:.2f} s, {extent}")
        return
    console.print("[red]not feasible[/red]: the plan breaks a limit of the rig")
    for message in dict.fromkeys(violation.message for violation in violations):
        console.print(f"  {message}", markup=False)


def predicted_lines(prediction: "Prediction") -> list[tuple[str, str]]:
    """Return the motion predicted by the model in use, and the nearest limits."""
    peaks = prediction.peaks
    lines = [
        ("predicted", f"{prediction.outcome} after {prediction.duration_s:.2f} s"),
        ("  force", f"{peaks.force_max_mN:.2f} mN at most"),
        ("  position", f"{peaks.x_min_um:.2f} to {peaks.x_max_um:.2f} µm"),
        ("  voltage", f"{peaks.voltage_min_V:.3f} to {peaks.voltage_max_V:.3f} V"),
    ]
    of_both = getattr(prediction, "figures", None)
    if of_both is not None and of_both.force_held_mN is not None:
        lines += [
            (
                "  force of both arms",
                f"{of_both.force_held_mN:.2f} mN ± {of_both.force_uncertainty_mN:.2f} mN",
            ),
            ("  place", f"{of_both.held_place_um:.2f} µm"),
        ]
        for name, errors, unit in (
            ("place", of_both.place_um, "µm"),
            ("force", of_both.force_mN, "mN"),
        ):
            if errors is not None:
                lines.append((f"  RMSE of the {name}", f"{errors.rmse:.3f} {unit}, without noise"))
    for name in dict.fromkeys(margin.quantity for margin in prediction.margins):
        margins = (margin for margin in prediction.margins if margin.quantity == name)
        near = min(margins, key=lambda margin: margin.distance)
        left = f"{near.distance:.3g} {near.unit} to the limit {near.limit:g} {near.unit}"
        where = near.phase if of_both is None else f"{near.phase}, arm {near.arm}"
        lines.append((f"  {name} left", f"{left}, at {near.at_s:.2f} s ({where})"))
    if not prediction.complete:
        lines.append(("  not all of it", prediction.cut))
    return lines


def _motion(plan: "Plan | MotionPlan", console: "Console") -> None:
    from pincette.api.plans import Plan

    rows = [
        (
            phase.phase,
            f"{phase.start_s:.2f} s",
            _or_dash(phase.duration_s, "s"),
            _or_dash(phase.x_um, "µm"),
            _or_dash(phase.force_mN, "mN"),
            f"{phase.voltage_V:.3f} V",
        )
        for phase in plan.phases
    ]
    console.print(table("phase", "begins", "lasts", "to", "force", "voltage", rows=rows))
    console.print()
    lines = [] if plan.law is None else _law(plan.law)
    if isinstance(plan, Plan):
        lines += [] if plan.profile is None else [("profile", plan.profile)]
        lines += _steady(plan.steady_errors)
    lines += [("note", warning) for warning in plan.warnings]
    figures(lines, console)
    console.print()


def _or_dash(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.2f} {unit}"


def _law(law: "Law") -> list[tuple[str, str]]:
    """Return the law of a job, and the stability of its loop in the worst case."""
    gains = ", ".join(f"{name} = {value:g}" for name, value in law.gains.items())
    radius, limit = law.spectral_radius, law.spectral_radius_limit
    return [
        ("law", f"{law.scheme.upper()}, {law.set} set, {gains} ({law.gains_from})"),
        ("spectral radius", f"{radius:.4g} in the worst case, limit {limit:.4g}"),
        *_peak(law),
    ]


def _peak(law: "Law") -> list[tuple[str, str]]:
    """Return the sensitivity peak as text, if it is limited."""
    peak, limit = law.sensitivity_peak, law.sensitivity_peak_limit
    if peak is None or limit is None:
        return []
    return [("peak of sensitivity", f"{peak:.3g} in the worst case, limit {limit:g}")]


def _steady(errors: "SteadyErrors") -> list[tuple[str, str]]:
    """Return the steady state of the arm if the part differed from the plan within its
    tolerances.
    """
    lowest_um, highest_um = errors.position_min_um, errors.position_max_um
    lowest_mN, highest_mN = errors.force_min_mN, errors.force_max_mN
    return [
        ("steady errors", "for a part within the tolerances of the rig file:"),
        ("  position", f"{lowest_um:+.2f} to {highest_um:+.2f} µm"),
        ("  force", f"{lowest_mN:+.2f} to {highest_mN:+.2f} mN, until loading finds the contact"),
    ]


def _calibration(plan: "CalibrationPlan", console: "Console") -> None:
    phases = table("phase", "begins", "lasts", "voltage")
    for phase in plan.phases:
        lasts = "waits for you" if phase.duration_s is None else f"{phase.duration_s:.2f} s"
        phases.add_row(phase.phase, f"{phase.start_s:.2f} s", lasts, f"{phase.voltage_V:.3f} V")
    console.print(phases)
    for item in plan.assumptions:
        console.print(f"depends on {item.quantity}, {item.source}", markup=False)


Tree = dict[str, Any]


def outcome(job: "Job") -> str:
    """Return the outcome of a job's motion program; empty if the job has no result."""
    return str((job.result or {}).get("outcome", ""))


def show_result(
    job: "Job", console: "Console", *, everything: bool = False, more: str | None = None
) -> None:
    """Print the result of a job: the verdict, its main figures and its record.

    Parameters
    ----------
    job
        The job, with its result.
    console
        The console to print on.
    everything
        True to print every phase and every value.
    more
        Text in a short result that states where all values are shown; None: the command that
        shows them.
    """
    colour = "green" if job.state == "succeeded" else "red"
    result: Tree | None = job.result
    verdict = "" if result is None else "".join(f", {words}" for words in verdict_words(result))
    colon = ":" if verdict else ""
    console.print(f"\njob {job.id} [bold {colour}]{job.state}[/]{colon}{verdict[1:]}")
    if job.cause:
        console.print(f"  {job.cause}", markup=False)
    if result is None:
        return
    lines = [] if everything else brief_lines(result, job.kind)
    is_brief = bool(lines)
    console.print()
    if not is_brief:
        rows = [
            (phase["phase"], f"{phase['start_s']:.2f} s", f"{phase['duration_s']:.2f} s")
            for phase in result["phases"]
        ]
        console.print(table("phase", "begins", "lasts", rows=rows))
        console.print()
        if "calibration" in result:
            _show_findings(result, job.id, console)
        else:
            lines = result_lines(result, job.kind)
    if result.get("held_at_end"):
        lines.append(("to let it go", "`pincette job release`"))
    kept = record_lines(job.record)
    figures([*lines, *(kept[:1] if is_brief else kept)], console)
    if is_brief:
        where = f"`pincette job show {job.id} --all`" if more is None else more
        console.print(f"\nall figures: {where}", markup=False)


def verdict_words(result: Tree) -> list[str]:
    """Return the outcome, and the reasons to trust or doubt its values."""
    from pincette.api.results import confirmations

    outcome = str(result.get("outcome", "")).replace("_", " ")
    return list(dict.fromkeys(filter(None, [outcome, *(few for few, _ in confirmations(result))])))


def brief_lines(result: Tree, kind: str) -> list[tuple[str, str]]:
    """Return the main values of a result; empty if its kind defines none or is not installed."""
    from pincette.api.job_kinds import job_kinds

    known = job_kinds().get(kind)
    return [] if known is None else _figure_lines(result, known.brief_figures_of(result))


def quantity(value: Any, unit: str) -> str:
    """Return a calibrated value with its unit; for a table of numbers, only its name."""
    if value is None:
        return "none"
    if isinstance(value, int | float):
        return f"{value:.5g} {unit}" if unit != "1" else f"{value:.5g}"
    return "a table"


def measured(value: Tree) -> str:
    """Return a calibrated value with its uncertainty."""
    text = quantity(value["value"], value["unit"])
    uncertainty = value["uncertainty"]
    return text if uncertainty is None else f"{text} ± {uncertainty:.2g}"


def _show_findings(result: Tree, name: str, console: "Console") -> None:
    """Print the findings of a calibration, and how to use them."""
    lines = [(value["quantity"], measured(value)) for value in result["values"]]
    lines += [(one["name"], quantity(one["value"], one["unit"])) for one in result["figures"]]
    figures(lines, console)
    console.print(result["statement"], markup=False)
    for warning in result["warnings"]:
        console.print(f"[yellow]warning[/yellow]: {warning}")
    if result["values"]:
        console.print(f"proposed; `pincette model accept {name}` uses it")


def result_lines(result: Tree, kind: str) -> list[tuple[str, str]]:
    """Return the outcome and the values that the kind defines; without the values if the kind is
    not installed.
    """
    from pincette.api.job_kinds import job_kinds

    known = job_kinds().get(kind)
    outcome = ("outcome", str(result.get("outcome", "")))
    return [outcome, *_figure_lines(result, () if known is None else known.figures_of(result))]


def _figure_lines(result: Tree, shown: "Iterable[ResultField]") -> list[tuple[str, str]]:
    """Return a label and a text for each value of a result."""
    lines: list[tuple[str, str]] = []
    for field in shown:
        value = _member(result, field.name)
        if value is None and field.optional:
            continue
        text = _figure(value, field)
        uncertainty = _member(result, field.uncertainty) if field.uncertainty else None
        if value is not None and uncertainty is not None:
            text += f" ± {_figure(uncertainty, field)}"
        lines.append((field.label, text))
        assumed = _member(result, field.assumed) if field.assumed else None
        if uncertainty is not None and assumed:
            lines.append(("  its ± assumes", ", ".join(assumed)))
    return lines


def _figure(value: Any, field: "ResultField") -> str:
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:.{field.digits}f} {field.unit}".rstrip()
    return str(value)


def _member(tree: Tree, path: str) -> Any:
    found: Any = tree
    for name in path.split("."):
        found = cast("Tree", found).get(name) if isinstance(found, dict) else None
    return found


def record_lines(record: str | None) -> list[tuple[str, str]]:
    """Return the folder of a job's record, and the path of its plot if the folder is on this
    machine.
    """
    from pincette.api.job_kinds import job_kinds

    if not record:
        return []
    folder = Path(record)
    here = working_folder()
    if folder.is_relative_to(here):
        folder = folder.relative_to(here)
    lines = [("record", str(folder))]
    plots = (folder / name for name in sorted({kind.plot for kind in job_kinds().values()}))
    return [*lines, *(("plot", str(plot)) for plot in plots if plot.is_file())]
