"""``pincette user``: people who sign in to the page by name and password."""

import getpass
import sys
from typing import Annotated

from typer import Argument, Option

from pincette.api.access import Scope
from pincette.cli import CliError, Exit
from pincette.cli.access import SCOPE_HELP, SOON, key_name, key_state, opened_keys
from pincette.cli.options import DATA, DataFolder
from pincette.cli.terminal import Json, clock, command, group, table

SHORTEST, LONGEST = 10, 200
Name = Annotated[str, Argument(metavar="NAME", parser=key_name, help="kept with each action")]

app = group()
user_app = group("user", "people who sign in by name and password, in a data folder")
app.add_typer(user_app)


def _password() -> str:
    """A new password, asked for twice at a terminal, else the first line of standard input."""
    if sys.stdin.isatty():
        password = getpass.getpass("password: ")
        if getpass.getpass("the same again: ") != password:
            raise CliError("the two differ: nothing was changed", Exit.USAGE)
    else:
        password = sys.stdin.readline().rstrip("\n")
    if not SHORTEST <= len(password) <= LONGEST:
        raise CliError(
            f"the password has {len(password)} characters: {SHORTEST} to {LONGEST} are wanted",
            Exit.USAGE,
        )
    return password


@command(user_app, "add")
def add_user(
    form: Json,
    name: Name,
    scope: Annotated[Scope, Option("--scope", help=SCOPE_HELP)] = "observe",
    data: DataFolder = DATA,
) -> None:
    """Add a user; the password is asked for, or read from standard input."""
    password = _password()
    with opened_keys(data, ValueError) as keys:
        view = keys.add_user(name, scope, password)
    form.answer(view, f"user {name!r} has scope {scope}; {SOON}")


@command(user_app, "list")
def list_users(form: Json, data: DataFolder = DATA) -> None:
    """List the users."""
    with opened_keys(data) as keys:
        found = keys.all(users=True)
    rows = [
        (one.name, one.scope, clock(one.made_at), clock(one.used_at) or "never", key_state(one))
        for one in found
    ]
    shown = table("user", "scope", "made", "last seen", "state", rows=rows)
    form.answer(found, shown if rows else f"no user in {data}")


@command(user_app, "password")
def set_password(form: Json, name: Name, data: DataFolder = DATA) -> None:
    """Give a user another password, and sign the user out everywhere."""
    password = _password()
    with opened_keys(data) as keys:
        if not keys.set_password(name, password):
            raise CliError(f"no user {name!r} is in force in {data}")
    form.answer({"user": name}, f"user {name!r} has another password; {SOON}")


@command(user_app, "remove")
def remove(form: Json, name: Name, data: DataFolder = DATA) -> None:
    """Keep a user out, and sign the user out everywhere; the name stays with what was done."""
    with opened_keys(data) as keys:
        known = {one.name for one in keys.all(users=True)}
        if name not in known or not keys.revoke(name):
            raise CliError(f"no user {name!r} is in force in {data}")
    form.answer({"removed": name}, f"user {name!r} is kept out; {SOON}")
