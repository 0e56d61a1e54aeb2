"""What a plan looks like on a screen."""

from rich.console import Console

from pincette.api.calibration_models import CalibrationPlan
from pincette.api.motion_models import MotionPlan
from pincette.api.plan_models import Law, Plan, SteadyErrors
from pincette.api.prediction_models import Margin, Prediction
from pincette.cli.tables import figures, table
from pincette.client.kinds import AnyPlan


def show_plan(plan: AnyPlan, console: Console) -> None:
    """Print what a job would do, and each limit that it would break."""
    if isinstance(plan, CalibrationPlan):
        _calibration(plan, console)
    else:
        _motion(plan, console)
    violations = list(plan.violations)
    foretold = getattr(plan, "prediction", None)
    if isinstance(foretold, Prediction):
        figures(predicted_lines(foretold), console)
        console.print()
        violations += foretold.violations
    if plan.feasible:
        console.print(f"[green]feasible[/green]: {_extent(plan)}")
        return
    console.print("[red]not feasible[/red]: the plan breaks a limit of the rig")
    for message in dict.fromkeys(violation.message for violation in violations):
        console.print(f"  {message}", markup=False, soft_wrap=True)


def _extent(plan: AnyPlan) -> str:
    if not isinstance(plan, CalibrationPlan):
        return f"{plan.duration_s:.2f} s, within every limit of the rig"
    return (
        f"{plan.duration_s:.2f} s, {plan.waits} waits, "
        f"{plan.voltage_min_V:.3f} V to {plan.voltage_max_V:.3f} V"
    )


def predicted_lines(foretold: Prediction) -> list[tuple[str, str]]:
    """What playing the plan on the model in use foretells, and the nearest limits."""
    peaks = foretold.peaks
    lines = [
        ("foretold", f"{foretold.outcome} after {foretold.duration_s:.2f} s"),
        ("  force", f"{peaks.force_max_mN:.2f} mN at most"),
        ("  position", f"{peaks.x_min_um:.2f} to {peaks.x_max_um:.2f} µm"),
        ("  voltage", f"{peaks.voltage_min_V:.3f} to {peaks.voltage_max_V:.3f} V"),
    ]
    nearest: dict[str, Margin] = {}
    for margin in foretold.margins:
        known = nearest.get(margin.quantity)
        if known is None or margin.distance < known.distance:
            nearest[margin.quantity] = margin
    lines += [
        (
            f"  {margin.quantity} left",
            f"{margin.distance:.3g} {margin.unit} to the limit {margin.limit:g} {margin.unit}, "
            f"at {margin.at_s:.2f} s ({margin.phase})",
        )
        for margin in nearest.values()
    ]
    if not foretold.complete:
        lines.append(("  not all of it", foretold.cut))
    return lines


def _motion(plan: Plan | MotionPlan, console: Console) -> None:
    phases = table("phase", "begins", "lasts", "to", "force", "voltage")
    for phase in plan.phases:
        phases.add_row(
            phase.phase,
            f"{phase.start_s:.2f} s",
            f"{phase.duration_s:.2f} s",
            f"{phase.x_um:.2f} µm",
            f"{phase.force_mN:.2f} mN",
            f"{phase.voltage_V:.3f} V",
        )
    console.print(phases)
    console.print()
    lines = [] if plan.law is None else _law(plan.law)
    if isinstance(plan, Plan):
        lines += _steady(plan.steady_errors)
    else:
        lines += [("note", warning) for warning in plan.warnings]
    figures(lines, console)
    console.print()


def _law(law: Law) -> list[tuple[str, str]]:
    """Which law a job runs with, and how stable its loop is at the worst."""
    gains = f"K_P = {law.K_P:g}, K_I = {law.K_I:g}, K_S = {law.K_S:g}, K_f = {law.K_f:g}"
    radius, limit = law.spectral_radius, law.spectral_radius_limit
    return [
        ("law", f"{law.scheme.upper()}, {law.set} set, {gains} ({law.gains_from})"),
        ("spectral radius", f"{radius:.3f} at the worst, limit {limit:g}"),
    ]


def _steady(errors: SteadyErrors) -> list[tuple[str, str]]:
    """Where the arm would rest if the part differed from the plan within its tolerances."""
    lowest_um, highest_um = errors.position_min_um, errors.position_max_um
    lowest_mN, highest_mN = errors.force_min_mN, errors.force_max_mN
    return [
        ("steady errors", "for a part within the tolerances of the rig file:"),
        ("  position", f"{lowest_um:+.2f} to {highest_um:+.2f} µm"),
        ("  force", f"{lowest_mN:+.2f} to {highest_mN:+.2f} mN, until the load finds the contact"),
    ]


def _calibration(plan: CalibrationPlan, console: Console) -> None:
    phases = table("phase", "begins", "lasts", "voltage")
    for phase in plan.phases:
        lasts = phase.duration_s
        phases.add_row(
            phase.phase,
            f"{phase.start_s:.2f} s",
            "waits for you" if lasts is None else f"{lasts:.2f} s",
            f"{phase.voltage_V:.3f} V",
        )
    console.print(phases)
    for item in plan.rests_on:
        console.print(f"rests on {item.quantity}, {item.source}", markup=False)
