"""``pincette recipe``: named, versioned sets of parameters for parts."""

import argparse
import json
from typing import Any

from rich.console import Console

from pincette.api.recipe_models import Recipe
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, words
from pincette.cli.output import emit, screen
from pincette.cli.rest import CliError, reached
from pincette.cli.tables import clock, table

ABOUT = "keep sets of parameters for parts; `job grip --recipe NAME` uses one"


def add(word: Words) -> None:
    """Add ``recipe`` with every word below it."""
    below = words(word("recipe", ABOUT), "what", "WHAT")
    does(addressed(below("list", "list recipes, each with its newest version")), list_recipes)
    one = below("show", "show a recipe and its versions")
    one.add_argument("name", metavar="NAME[@N]", help="its name, and a version of it")
    does(addressed(one), show)
    one = below("save", "keep a recipe, or its next version")
    one.add_argument("name", metavar="NAME")
    one.add_argument(
        "values",
        nargs="+",
        type=value,
        metavar="FIELD=VALUE",
        help="as in a request: force_mN=8 hold_s=2 part.stiffness_mN_per_um=2.1",
    )
    one.add_argument("--note", default="", metavar="TEXT", help="kept with this version")
    does(addressed(one), save)


def value(text: str) -> tuple[list[str], Any]:
    """One member of a recipe: the path to it, and its value in JSON, else as text."""
    name, equals, said = text.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no value: give FIELD=VALUE, such as force_mN=8"
        )
    try:
        return name.split("."), json.loads(said)
    except ValueError:
        return name.split("."), said


def values(given: list[tuple[list[str], Any]]) -> dict[str, Any]:
    """Members put into each other."""
    found: dict[str, Any] = {}
    for path, one in given:
        place = found
        for name in path[:-1]:
            place = place.setdefault(name, {})
        place[path[-1]] = one
    return found


def list_recipes(given: argparse.Namespace) -> int:
    """List recipes, a line each."""
    found = reached(given).recipes()
    if given.json:
        emit(found)
    elif not found:
        print("no recipe yet; `pincette recipe save NAME force_mN=8` makes one")
    else:
        _table(found, screen())
    return Exit.DONE


def show(given: argparse.Namespace) -> int:
    """Show one version of a recipe, and which there are."""
    name, _, wanted = given.name.partition("@")
    history = reached(given).recipe(name)
    chosen = [one for one in history.versions if not wanted or str(one.version) == wanted]
    if not chosen:
        there = ", ".join(str(one.version) for one in history.versions)
        raise CliError(f"recipe {name!r} has no version {wanted!r}; there are {there}")
    if given.json:
        emit(chosen[0] if wanted else history)
        return Exit.DONE
    console = screen()
    one = chosen[0]
    console.print(f"recipe {one.name}@{one.version} of {clock(one.created_at)}, {one.digest}")
    if one.note:
        console.print(one.note, markup=False)
    for field, said in one.values.items():
        console.print(f"  {field} = {json.dumps(said, ensure_ascii=False)}", markup=False)
    if not wanted and len(history.versions) > 1:
        console.print()
        _table(history.versions, console)
    return Exit.DONE


def save(given: argparse.Namespace) -> int:
    """Keep a recipe."""
    kept = reached(given).save_recipe(given.name, values(given.values), given.note)
    if given.json:
        emit(kept)
    else:
        print(f"recipe {kept.name}@{kept.version} kept")
    return Exit.DONE


def _table(found: list[Recipe], console: Console) -> None:
    rows = table("recipe", "version", "made", "note", right=("version",))
    for one in found:
        rows.add_row(one.name, str(one.version), clock(one.created_at), one.note)
    console.print(rows)
