"""``pincette model`` and ``recipe``: the model in use, and recipes for parts."""

import json
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, BadParameter, Option

from pincette.cli import CliError
from pincette.cli.access import Target
from pincette.cli.readers import integer, literal
from pincette.cli.results import Tree, measured, quantity
from pincette.cli.terminal import clock, command, figures, group, screen, table, tree

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.models import ModelView
    from pincette.api.requests import Recipe
    from pincette.cli.screen import Rows

Calibration = Annotated[
    str, Argument(metavar="CALIBRATION", help="its id, that of its job, or `last`")
]

app = group()
model_app = group("model", "show the model in use, and accept or discard proposals of calibrations")
app.add_typer(model_app)


@command(model_app, "show")
def show(
    target: Target,
    proposals: Annotated[
        bool, Option("--proposals", help="list what calibrations propose, the newest first")
    ] = False,
) -> None:
    """Show the model in use: every quantity that can be calibrated, with the source of its
    value.
    """
    if not proposals:
        _answer(target, target.rig().model())
        return
    found = target.supervisor().proposals()
    rows = [
        (
            one.id,
            one.calibration,
            one.state,
            "" if one.model_version is None else str(one.model_version),
        )
        for one in found
    ]
    shown = table("calibration", "of", "state", "version", rows=rows)
    target.answer(found, shown, "no calibration has proposed anything yet")


@command(model_app, "accept")
def accept(target: Target, name: Calibration) -> None:
    """Accept the proposal of a calibration as a new version of the model."""
    _decide(target, name, "accept")


@command(model_app, "discard")
def discard(target: Target, name: Calibration) -> None:
    """Discard the proposal of a calibration."""
    _decide(target, name, "discard")


@command(model_app, "use")
def use(
    target: Target, version: Annotated[int, Argument(metavar="VERSION", parser=integer)]
) -> None:
    """Use another version of the model; 0 means the rig file alone."""
    _answer(target, target.rig().use_model(version))


def _answer(target: Target, model: "ModelView") -> None:
    target.answer(model, lambda: show_model(tree(model), screen()))


def _decide(target: Target, name: str, decision: Literal["accept", "discard"]) -> None:
    supervisor = target.supervisor()
    wanted: str | None = name
    if name == "last":
        rig = target.rig().name
        wanted = next((one.id for one in supervisor.proposals() if one.rig == rig), None)
    if wanted is None:
        raise CliError("nothing is proposed yet; `pincette job calibrate` measures")
    found = supervisor.decide(wanted, decision)
    target.answer(found, lambda: show_proposal(tree(found), screen()))


def show_proposal(proposal: Tree, console: "Console") -> None:
    """Print the values of a proposal and the values in use."""
    version = proposal["model_version"]
    of_model = "" if version is None else f", model {version}"
    console.print(f"{proposal['calibration']} {proposal['id']}: {proposal['state']}{of_model}")
    lines: list[tuple[str, str]] = []
    for value in proposal["values"]:
        text = f"{measured(value)}, before {quantity(value['in_use'], value['unit'])}"
        if value["difference_percent"] is not None:
            text += f" ({value['difference_percent']:+.2f} %)"
        lines.append((value["quantity"], text))
    figures(lines, console)


def show_model(model: Tree, console: "Console") -> None:
    """Print the model in use."""
    console.print(f"rig {model['rig']}: model {model['version']} {model['digest']}".rstrip())
    if model["trouble"]:
        console.print(f"[red]{model['trouble']}[/red]")
    rows = [
        (one["quantity"], quantity(one["value"], one["unit"]), one["source"], _due(one))
        for one in model["quantities"]
    ]
    console.print(table("quantity", "value", "from", "due", rows=rows))
    for version in model["versions"]:
        made = f" of {version['made_at']}" if version["made_at"] else ""
        text = f"model {version['version']}{made}: "
        console.print(text + (version["trouble"] or ", ".join(version["quantities"])), markup=False)


def _due(item: Tree) -> str:
    """Return the date by which a quantity should be calibrated again."""
    day = clock(item.get("due_at"))[:10]
    return f"[red]{day}, overdue[/red]" if item.get("overdue") else day


recipe_app = group("recipe", "save sets of parameters for parts; `job grip --recipe NAME` uses one")
app.add_typer(recipe_app)


def value(text: str) -> tuple[list[str], Any]:
    """Read NAME=VALUE: return the path to the member of a recipe, and its value."""
    name, equals, text_of_value = text.partition("=")
    if not equals or not name:
        raise BadParameter(f"{text!r} is not a value: give FIELD=VALUE, such as force_mN=8")
    path = name.split(".")
    return path, literal(path[-1], text_of_value)


def values(given: list[tuple[list[str], Any]]) -> dict[str, Any]:
    """Return the members as nested dictionaries."""
    found: dict[str, Any] = {}
    for path, one in given:
        place = found
        for name in path[:-1]:
            place = place.setdefault(name, {})
        place[path[-1]] = one
    return found


@command(recipe_app, "show")
def show_recipe(
    target: Target,
    name: Annotated[
        str | None,
        Argument(metavar="NAME[@N]", help="name of a recipe, or NAME@VERSION; all if not given"),
    ] = None,
) -> None:
    """List the recipes, each with its newest version, or show one and its versions."""
    if name is None:
        found = target.supervisor().recipes()
        none = "no recipe yet; `pincette recipe save NAME force_mN=8` makes one"
        target.answer(found, _table(found), none)
        return
    name, _, wanted = name.partition("@")
    history = target.supervisor().recipe(name)
    chosen = [one for one in history.versions if not wanted or str(one.version) == wanted]
    if not chosen:
        there = ", ".join(str(one.version) for one in history.versions)
        raise CliError(f"recipe {name!r} has no version {wanted!r}; there are {there}")
    one = chosen[0]
    others = [] if wanted else history.versions
    target.answer(one if wanted else history, lambda: _show_recipe(one, others, screen()))


def _show_recipe(one: "Recipe", versions: "list[Recipe]", console: "Console") -> None:
    console.print(f"recipe {one.name}@{one.version} of {clock(one.created_at)}, {one.digest}")
    if one.note:
        console.print(one.note, markup=False)
    for field, content in one.values.items():
        console.print(f"  {field} = {json.dumps(content, ensure_ascii=False)}", markup=False)
    if len(versions) > 1:
        console.print()
        console.print(_table(versions))


@command(recipe_app, "save")
def save(
    target: Target,
    name: Annotated[str, Argument(metavar="NAME")],
    fields: Annotated[
        list[Any],
        Argument(
            metavar="FIELD=VALUE",
            parser=value,
            help="as in a request: force_mN=8 hold_s=2 part.stiffness_mN_per_um=2.1",
        ),
    ],
    note: Annotated[str, Option("--note", metavar="TEXT", help="kept with this version")] = "",
) -> None:
    """Save a recipe, or its next version."""
    saved = target.supervisor().save_recipe(name, values(fields), note)
    target.answer(saved, f"recipe {saved.name}@{saved.version} saved")


def _table(found: "list[Recipe]") -> "Rows":
    rows = [(one.name, str(one.version), clock(one.created_at), one.note) for one in found]
    return table("recipe", "version", "made", "note", rows=rows, right=("version",))
