"""``pincette key``: who may ask a supervisor over REST, and what for."""

import argparse
import re
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol, cast

from pincette import plugins
from pincette.api.access_models import KEY_NAME, MEANINGS, SCOPES, KeyView, Scope
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, kept, machine, words
from pincette.cli.output import emit, screen
from pincette.cli.readers import number
from pincette.cli.rest import CliError
from pincette.cli.tables import clock, table

ABOUT = "make, list and revoke keys of the REST interface, in a data folder"
SCOPE = "; ".join(f"{name}: {text}" for name, text in MEANINGS.items())
SUPERVISOR = "supervisor"
SOON = "a supervisor that runs on this folder knows it within a second"


class Keys(Protocol):
    """The keys of a data folder, as the supervisor keeps them."""

    def add(self, name: str, scope: Scope, days: float | None) -> tuple[str, KeyView]:
        """Make a key, which is told this once; raises ValueError where the name is taken."""
        ...

    def all(self) -> list[KeyView]:
        """Every key there is or was."""
        ...

    def revoke(self, name: str) -> bool:
        """Take a key out of force; false where there is none to be."""
        ...


def add(word: Words) -> None:
    """Add ``key`` with every word below it."""
    below = words(word("key", ABOUT), "what", "WHAT")
    one = below("add", "make a key; it is shown once. From the first one on, keys are wanted")
    one.add_argument("name", metavar="NAME", type=_name, help="whose it is; kept with each action")
    one.add_argument("--scope", choices=SCOPES, default=SCOPES[0], help=SCOPE)
    one.add_argument("--days", type=number("days"), metavar="DAYS", help="after which it expires")
    does(machine(kept(one)), add_key)
    does(machine(kept(below("list", "list the keys, without the keys themselves"))), list_keys)
    one = below("revoke", "take a key out of force, and sign out its pages")
    one.add_argument("name", metavar="NAME")
    does(machine(kept(one)), revoke)


def _name(text: str) -> str:
    if re.fullmatch(KEY_NAME, text) is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no name: a-z, 0-9, and behind the first . _ and -, 40 at most"
        )
    return text


def _opened(data: Path) -> AbstractContextManager[Keys]:
    return cast("AbstractContextManager[Keys]", plugins.load(plugins.KEYS, SUPERVISOR)(data))


def add_key(given: argparse.Namespace) -> int:
    """Make a key and show it; it alone goes to standard output."""
    if given.days is not None and not 0.0 < given.days <= 36_500.0:
        raise CliError(f"--days {given.days:g} is not above 0 and at most 36500", Exit.USAGE)
    try:
        with _opened(given.data) as keys:
            key, view = keys.add(given.name, given.scope, given.days)
    except (ValueError, OSError, plugins.PluginError) as error:
        raise CliError(str(error)) from error
    if given.json:
        emit({**view.model_dump(mode="json"), "key": key})
        return Exit.DONE
    print(key)
    sys.stderr.write(
        f"key {view.name!r} may {MEANINGS[view.scope]}; it is shown this once. Kept as a digest in "
        f"{given.data}: {SOON}\n"
    )
    return Exit.DONE


def list_keys(given: argparse.Namespace) -> int:
    """List the keys, a line each."""
    try:
        with _opened(given.data) as keys:
            found = keys.all()
    except (OSError, plugins.PluginError) as error:
        raise CliError(str(error)) from error
    if given.json:
        emit(found)
    elif not found:
        print(f"no key in {given.data}: whoever reaches the supervisor may do everything")
    else:
        rows = table("key", "scope", "made", "last used", "state")
        for one in found:
            rows.add_row(one.name, one.scope, clock(one.made_at), _clock(one.used_at), _state(one))
        screen().print(rows)
    return Exit.DONE


def _clock(time: str | None) -> str:
    return "never" if time is None else clock(time)


def _state(one: KeyView) -> str:
    if one.revoked_at is not None:
        return f"revoked {clock(one.revoked_at)}"
    if one.expires_at is None:
        return "in force"
    return f"{'until' if one.usable else 'expired'} {clock(one.expires_at)}"


def revoke(given: argparse.Namespace) -> int:
    """Take a key out of force."""
    try:
        with _opened(given.data) as keys:
            done = keys.revoke(given.name)
            there = ", ".join(one.name for one in keys.all() if one.revoked_at is None) or "none"
    except (OSError, plugins.PluginError) as error:
        raise CliError(str(error)) from error
    if not done:
        raise CliError(f"no key {given.name!r} is in force in {given.data}; there are {there}")
    if given.json:
        emit({"revoked": given.name})
    else:
        print(f"key {given.name!r} is revoked; {SOON}. In force: {there}")
    return Exit.DONE
