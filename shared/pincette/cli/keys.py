"""``pincette key``: keys and users of a supervisor, in its data folder.

Keys are for programs. A user is a person who signs in to the page by name and password.
"""

import getpass
import re
import sys
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Annotated, Protocol, cast

from typer import Argument, BadParameter, Option

from pincette.api.access import KEY_NAME, MEANINGS, SCOPES, KeyView, Scope
from pincette.cli import CliError, Exit
from pincette.cli.options import DATA, DataFolder
from pincette.cli.readers import number
from pincette.cli.terminal import Json, clock, command, group, table
from pincette.core import plugins

SCOPE_HELP = "; ".join(f"{name}: {text}" for name, text in MEANINGS.items())
SUPERVISOR = "supervisor"
SOON = "a supervisor that uses this folder accepts it within a second"
LONGEST_DAYS = 36_500.0
SHORTEST_PASSWORD, LONGEST_PASSWORD = 10, 200

app = group()
key_app = group("key", "make, list and revoke keys and users of the REST interface")
app.add_typer(key_app)


class _Keys(Protocol):
    """Keys in a data folder, as the supervisor stores them; a key itself is shown only once."""

    def add(self, name: str, scope: Scope, days: float | None) -> tuple[str, KeyView]: ...

    def add_user(self, name: str, scope: Scope, password: str) -> KeyView: ...

    def set_password(self, name: str, password: str) -> bool: ...

    def all(self, *, users: bool = False) -> list[KeyView]: ...

    def revoke(self, name: str) -> bool: ...


def key_name(text: str) -> str:
    """Read the name of a key or a user from the command line; raises BadParameter."""
    if re.fullmatch(KEY_NAME, text) is None:
        raise BadParameter(
            f"{text!r} is not a name: use a-z and 0-9, after the first character also . "
            "_ and -, at most 40 characters"
        )
    return text


@contextmanager
def opened_keys(data: Path, *refused: type[Exception]) -> Generator[_Keys]:
    """Open the keys of a data folder; raises CliError, also for the errors in ``refused``."""
    try:
        keys = plugins.load(plugins.KEYS, SUPERVISOR)(data)
        with cast("AbstractContextManager[_Keys]", keys) as opened:
            yield opened
    except (*refused, OSError, plugins.PluginError) as error:
        raise CliError(str(error)) from error


@command(key_app, "add")
def add(
    form: Json,
    name: Annotated[
        str,
        Argument(
            metavar="NAME", parser=key_name, help="name of its owner; stored with each action"
        ),
    ],
    scope: Annotated[Scope, Option("--scope", help=SCOPE_HELP)] = SCOPES[0],
    days: Annotated[
        float | None,
        Option("--days", parser=number("days"), metavar="DAYS", help="after which it expires"),
    ] = None,
    password: Annotated[
        bool,
        Option(
            "--password",
            help="make a user who signs in with name and password instead of a key; the password "
            "is prompted for, or read from standard input",
        ),
    ] = False,
    data: DataFolder = DATA,
) -> None:
    """Create a key, which is shown once, or a user. As soon as one key exists, keys are
    required.
    """
    if days is not None and not 0.0 < days <= LONGEST_DAYS:
        raise CliError(f"--days {days:g} must be above 0 and at most {LONGEST_DAYS:g}", Exit.USAGE)
    if password:
        if days is not None:
            raise CliError("--days: a user with a password does not expire", Exit.USAGE)
        secret = _password()
        with opened_keys(data, ValueError) as keys:
            view = keys.add_user(name, scope, secret)
        form.answer(view, f"user {name!r} has scope {scope}; {SOON}")
        return
    with opened_keys(data, ValueError) as keys:
        key, view = keys.add(name, scope, days)
    form.answer({**view.model_dump(mode="json"), "key": key}, key)
    if not form.json:
        may = f"key {view.name!r} may {MEANINGS[view.scope]}; it is shown this once."
        sys.stderr.write(f"{may} Stored as a digest in {data}: {SOON}\n")


def _password() -> str:
    """Return a new password: typed twice at a terminal, otherwise the first line of standard
    input.
    """
    if sys.stdin.isatty():
        password = getpass.getpass("password: ")
        if getpass.getpass("the same again: ") != password:
            raise CliError("the two passwords differ: nothing was changed", Exit.USAGE)
    else:
        password = sys.stdin.readline().rstrip("\n")
    if not SHORTEST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        raise CliError(
            f"the password has {len(password)} characters: use {SHORTEST_PASSWORD} to "
            f"{LONGEST_PASSWORD}",
            Exit.USAGE,
        )
    return password


@command(key_app, "list")
def list_keys(form: Json, data: DataFolder = DATA) -> None:
    """List keys and users, without secrets and passwords."""
    with opened_keys(data) as keys:
        found = [("key", one) for one in keys.all()]
        found += [("user", one) for one in keys.all(users=True)]
    rows = [
        (one.name, kind, one.scope, clock(one.made_at), clock(one.used_at) or "never", state(one))
        for kind, one in found
    ]
    shown = table("name", "kind", "scope", "made", "last used", "state", rows=rows, right=())
    none = f"no key in {data}: unless its rig file requires keys, the supervisor is open"
    form.answer([{"kind": kind, **one.model_dump(mode="json")} for kind, one in found], shown, none)


def state(one: KeyView) -> str:
    """Return, as text, whether a key or a user is valid."""
    if one.revoked_at is not None:
        return f"revoked {clock(one.revoked_at)}"
    if one.expires_at is None:
        return "in force"
    return f"{'until' if one.usable else 'expired'} {clock(one.expires_at)}"


Name = Annotated[str, Argument(metavar="NAME", help="as `key list` shows it")]


@command(key_app, "password")
def set_password(form: Json, name: Name, data: DataFolder = DATA) -> None:
    """Set a new password for a user, and end all sessions of the user."""
    password = _password()
    with opened_keys(data) as keys:
        if not keys.set_password(name, password):
            raise CliError(f"no user {name!r} is valid in {data}")
    form.answer({"user": name}, f"user {name!r} has a new password; {SOON}")


@command(key_app, "revoke")
def revoke(form: Json, name: Name, data: DataFolder = DATA) -> None:
    """Revoke a key or a user, and end its sessions; the name remains in recorded actions."""
    with opened_keys(data) as keys:
        done = keys.revoke(name)
        found = [*keys.all(), *keys.all(users=True)]
        there = ", ".join(one.name for one in found if one.revoked_at is None) or "none"
    if not done:
        raise CliError(f"no key or user {name!r} is valid in {data}; there are {there}")
    form.answer({"revoked": name}, f"{name!r} is revoked; {SOON}. Valid: {there}")
