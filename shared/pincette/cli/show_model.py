"""What a calibration has found, a proposal and a model look like on a screen."""

from typing import Any

from rich.console import Console

from pincette.cli.tables import clock, figures, table

Tree = dict[str, Any]
QUANTITY_WIDTH = 34


def number(value: Any, unit: str) -> str:
    """A value with its unit; a table of numbers is told as one."""
    if value is None:
        return "none"
    if isinstance(value, int | float):
        return f"{value:.5g} {unit}" if unit != "1" else f"{value:.5g}"
    return "a table"


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
    rows = table("calibration", "of", "state", "version")
    for item in proposals:
        version = item["model_version"]
        rows.add_row(
            item["id"], item["calibration"], item["state"], "" if version is None else str(version)
        )
    console.print(rows)


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
    rows = table("quantity", "value", "from", "due")
    for item in model["quantities"]:
        value = number(item["value"], item["unit"])
        rows.add_row(item["quantity"], value, item["source"], _due(item))
    console.print(rows)
    for version in model["versions"]:
        text = f"model {version['version']} of {version['made_at']}: "
        console.print(text + (version["trouble"] or ", ".join(version["quantities"])), markup=False)


def _found(value: Tree) -> str:
    text = number(value["value"], value["unit"])
    uncertainty = value["uncertainty"]
    return text if uncertainty is None else f"{text} ± {uncertainty:.2g}"


def _due(item: Tree) -> str:
    """The day on which a quantity is to be calibrated again."""
    day = clock(item.get("due_at"))[:10]
    return f"[red]{day}, overdue[/red]" if item.get("overdue") else day


def _line(console: Console, label: str, text: str) -> None:
    figures([(label, text)], console, QUANTITY_WIDTH)
