"""What a calibration's plan, a proposal and a model look like on a screen."""

from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

Tree = dict[str, Any]


def _table(*names: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for place, name in enumerate(names):
        table.add_column(name, justify="left" if place == 0 else "right")
    return table


def number(value: Any, unit: str) -> str:
    """A value with its unit; a table of numbers is told as one."""
    if value is None:
        return "none"
    if isinstance(value, int | float):
        return f"{value:.5g} {unit}" if unit != "1" else f"{value:.5g}"
    return "a table"


def show_calibration_plan(plan: Tree, console: Console) -> None:
    """Print what a calibration would do."""
    phases = _table("phase", "begins", "lasts", "voltage")
    for phase in plan["phases"]:
        lasts = phase["duration_s"]
        phases.add_row(
            phase["phase"],
            f"{phase['start_s']:.2f} s",
            "waits for you" if lasts is None else f"{lasts:.2f} s",
            f"{phase['voltage_V']:.3f} V",
        )
    console.print(phases)
    for item in plan["rests_on"]:
        console.print(f"rests on {item['quantity']}, {item['source']}", markup=False)
    low_V, high_V = plan["voltage_min_V"], plan["voltage_max_V"]
    if plan["feasible"]:
        console.print(
            f"feasible: {plan['duration_s']:.2f} s, {plan['waits']} waits, "
            f"{low_V:.3f} V to {high_V:.3f} V"
        )
        return
    console.print("[red]not feasible[/red]: the plan breaks a limit of the rig")
    for violation in plan["violations"]:
        console.print(f"  {violation['message']}", markup=False)


def show_found(result: Tree, name: str, console: Console) -> None:
    """Print what a calibration has found, and what to do with it."""
    for value in result["values"]:
        _line(console, value["quantity"], _found(value))
    for figure in result["figures"]:
        _line(console, figure["name"], f"{number(figure['value'], figure['unit'])}")
    console.print(result["statement"], markup=False)
    for warning in result["warnings"]:
        console.print(f"[yellow]warning[/yellow]: {warning}")
    if result["values"]:
        console.print(f"proposed; `pincette model accept {name}` uses it")


def show_proposals(proposals: list[Tree], console: Console) -> None:
    """Print proposals, a line each."""
    if not proposals:
        console.print("no calibration has proposed anything yet")
        return
    table = _table("calibration", "of", "state", "version")
    for item in proposals:
        version = item["model_version"]
        table.add_row(
            item["id"], item["calibration"], item["state"], "" if version is None else str(version)
        )
    console.print(table)


def show_proposal(proposal: Tree, console: Console) -> None:
    """Print a proposal beside what was in use."""
    version = proposal["model_version"]
    of_model = "" if version is None else f", model {version}"
    console.print(f"{proposal['calibration']} {proposal['id']}: {proposal['state']}{of_model}")
    for value in proposal["values"]:
        text = f"{_found(value)}, before {number(value['in_use'], value['unit'])}"
        if value["difference_percent"] is not None:
            text += f" ({value['difference_percent']:+.2f} %)"
        _line(console, value["quantity"], text)


def show_model(model: Tree, console: Console) -> None:
    """Print the model in use."""
    console.print(f"rig {model['rig']}: model {model['version']} {model['digest']}".rstrip())
    if model["trouble"]:
        console.print(f"[red]{model['trouble']}[/red]")
    table = _table("quantity", "value", "from")
    for item in model["quantities"]:
        table.add_row(item["quantity"], number(item["value"], item["unit"]), item["source"])
    console.print(table)
    for version in model["versions"]:
        text = f"model {version['version']} of {version['made_at']}: "
        console.print(text + (version["trouble"] or ", ".join(version["quantities"])), markup=False)


def _found(value: Tree) -> str:
    text = number(value["value"], value["unit"])
    uncertainty = value["uncertainty"]
    return text if uncertainty is None else f"{text} ± {uncertainty:.2g}"


def _line(console: Console, label: str, text: str) -> None:
    console.print(f"{label:<34} {text}", markup=False, soft_wrap=True)
