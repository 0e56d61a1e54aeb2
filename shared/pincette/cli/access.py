"""The supervisor of a command and the key for it; ``pincette key``."""

import os
import re
import stat
import sys
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol, cast

from typer import Argument, BadParameter, Option

from pincette.api.access import KEY_NAME, MEANINGS, SCOPES, KeyView, Scope
from pincette.cli import PKI, CliError, Exit
from pincette.cli.options import DATA, DataFolder, number
from pincette.cli.terminal import Json, clock, command, emit, group, table
from pincette.core import plugins
from pincette.core.text_files import EncodingError, decoded

if TYPE_CHECKING:
    from pincette.client import JobHandle, RigHandle, Supervisor

DEFAULT_URL = "http://127.0.0.1:8000"
VARIABLE = "PINCETTE_KEY"
CLAIM = "PINCETTE_CLAIM"
"""Holds the secret of a claim, which every command then sends."""
FILE_MARK = "@"
"""Before the name of a file in place of a key."""
PATIENCE_S = 0.5
"""How long a person waits to learn that no supervisor answers."""
FOLLOWED_S = 30.0
"""How long a job is followed on while its supervisor does not answer, as when it restarts."""
STATUSES = {  # of refusals, by their codes
    **dict.fromkeys(("estop-engaged", "rig-latched", "rig-not-ready"), Exit.NOT_READY),
    "limit-violation": Exit.LIMIT,
}
Key = Annotated[
    str | None,
    Option(
        "--key",
        metavar="KEY",
        help=f"for a supervisor that requires one, or {FILE_MARK}FILE with it; ${VARIABLE}, else "
        "~/.config/pincette/key, if not given",
    ),
]

Authority = Annotated[
    Path | None,
    Option(
        "--authority",
        metavar="FILE",
        envvar="PINCETTE_AUTHORITY",
        show_envvar=False,
        help="authority.crt of `security`, for a supervisor over https; $PINCETTE_AUTHORITY, else "
        f"that in ${PKI}, if not given",
    ),
]


@dataclass(frozen=True, slots=True)
class Address(Json):
    """For a command that asks a supervisor."""

    url: Annotated[
        str,
        Option(
            "--url",
            envvar="PINCETTE_URL",
            show_envvar=False,
            help="of the supervisor; $PINCETTE_URL if not given",
        ),
    ] = DEFAULT_URL
    key: Key = None
    authority: Authority = None

    def supervisor(self) -> "Supervisor":
        """The supervisor of ``--url``, with the key of ``--key``."""
        from pincette.client import Supervisor

        key = key_of(self.key)
        try:
            return Supervisor(
                self.url,
                patience_s=PATIENCE_S,
                operator=operator(),
                key=key,
                claim=os.environ.get(CLAIM) or None,
                authority=authority_of(self.authority, os.environ.get(PKI)),
            )
        except ValueError as error:
            raise CliError(f"{CLAIM}: {error}", Exit.USAGE) from error

    def guarded(self) -> AbstractContextManager[None]:
        """Turn a refusal or a missing answer into a CliError."""
        return refusals(self.url, as_json=self.json)


@dataclass(frozen=True, slots=True)
class Target(Address):
    """For a command that asks a supervisor about one of its rigs."""

    rig_name: Annotated[
        str | None,
        Option("--rig-name", metavar="RIG", help="name of the rig, if there are several"),
    ] = None

    def rig(self) -> "RigHandle":
        """The rig of ``--rig-name``, else the only one; raises CliError if there are several."""
        from pincette.client import WhichRigError

        try:
            return self.supervisor().rig(self.rig_name)
        except WhichRigError as error:
            raise CliError(f"{error} with --rig-name", Exit.USAGE) from error

    def job(self, name: str) -> "JobHandle":
        """A job by its id; ``last`` is the newest of the rig."""
        if name != "last":
            return self.supervisor().job(name)
        found = self.rig().jobs(1)
        if not found:
            raise CliError("there is no job yet; `pincette job grip` starts one")
        return found[0]


@contextmanager
def refusals(url: str, *, as_json: bool) -> Generator[None]:
    """Turn a refusal or a missing answer into a CliError; the problem goes to JSON if wanted."""
    from pincette.client import ClientError, NoAnswerError, ProblemError

    try:
        yield
    except NoAnswerError as error:
        if error.delivered:
            raise CliError(f"no answer has come: {error}", Exit.NO_ANSWER) from error
        how = (
            "`pincette up` starts a rig with one, and starts it again where it has died; "
            "`pincette run supervisor` starts one alone, and touches neither loop nor part; "
            "--url names another"
        )
        text = f"no supervisor answers at {url}: {error}; {how}"
        raise CliError(text, Exit.NO_ANSWER) from error
    except ProblemError as error:
        if as_json:
            emit(error.problem)
        raise CliError(str(error), STATUSES.get(error.code, Exit.FAILED)) from error
    except ClientError as error:
        raise CliError(str(error)) from error


def authority_of(given: Path | None, pki: str | None) -> Path | None:
    """The authority whose certificates are believed: as given, else that of a folder, if any."""
    if given is not None or not pki:
        return given
    return Path(pki) / "authority.crt"


def operator() -> str | None:
    """The user of this terminal, if the environment tells it."""
    from pincette.client.call import OPERATOR_MAX

    name = os.environ.get("USER", "")
    return name if name.isascii() and name.isprintable() and 0 < len(name) <= OPERATOR_MAX else None


def key_of(given: str | None) -> str | None:
    """The key of ``--key``, else of the environment, else of the user's file, else None."""
    from pincette.client.call import identity_headers

    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    usual = Path(config) / "pincette" / "key"
    key = given or os.environ.get(VARIABLE) or None
    if key is not None and key.startswith(FILE_MARK):
        key = _read(Path(key.removeprefix(FILE_MARK)))
    elif key is None and usual.is_file():
        key = _read(usual)
    try:
        identity_headers(None, key)
    except ValueError as error:
        raise CliError(str(error), Exit.USAGE) from error
    return key


def _read(path: Path) -> str:
    try:
        mode = path.stat().st_mode
        text = decoded(path.read_bytes()).strip()
    except (OSError, EncodingError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise CliError(f"key file {path} cannot be read: {why}", Exit.USAGE) from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        why = f"has mode {stat.S_IMODE(mode):04o}, so others may read it: chmod 600 {path}"
        raise CliError(f"key file {path} {why}", Exit.USAGE)
    if not text:
        raise CliError(f"key file {path} is empty: write the key into it", Exit.USAGE)
    return text


SCOPE_HELP = "; ".join(f"{name}: {text}" for name, text in MEANINGS.items())
SUPERVISOR = "supervisor"
SOON = "a supervisor that runs on this folder knows it within a second"
LONGEST_DAYS = 36_500.0

app = group()
key_app = group("key", "make, list and revoke keys of the REST interface, in a data folder")
app.add_typer(key_app)


class _Keys(Protocol):
    """The keys of a data folder, as the supervisor keeps them; a key itself is told once."""

    def add(self, name: str, scope: Scope, days: float | None) -> tuple[str, KeyView]: ...

    def add_user(self, name: str, scope: Scope, password: str) -> KeyView: ...

    def set_password(self, name: str, password: str) -> bool: ...

    def all(self, *, users: bool = False) -> list[KeyView]: ...

    def revoke(self, name: str) -> bool: ...


def key_name(text: str) -> str:
    """A name of a key or a user from the command line; raises BadParameter."""
    if re.fullmatch(KEY_NAME, text) is None:
        raise BadParameter(
            f"{text!r} is no name: a-z, 0-9, and behind the first . _ and -, 40 at most"
        )
    return text


@contextmanager
def opened_keys(data: Path, *refused: type[Exception]) -> Generator[_Keys]:
    """Open the keys of a data folder; raises CliError, also for errors ``refused``."""
    try:
        keys = plugins.load(plugins.KEYS, SUPERVISOR)(data)
        with cast("AbstractContextManager[_Keys]", keys) as opened:
            yield opened
    except (*refused, OSError, plugins.PluginError) as error:
        raise CliError(str(error)) from error


@command(key_app, "add")
def add_key(
    form: Json,
    name: Annotated[
        str, Argument(metavar="NAME", parser=key_name, help="whose it is; kept with each action")
    ],
    scope: Annotated[Scope, Option("--scope", help=SCOPE_HELP)] = SCOPES[0],
    days: Annotated[
        float | None,
        Option("--days", parser=number("days"), metavar="DAYS", help="after which it expires"),
    ] = None,
    data: DataFolder = DATA,
) -> None:
    """Make a key; it is shown once. From the first one on, keys are required."""
    if days is not None and not 0.0 < days <= LONGEST_DAYS:
        raise CliError(f"--days {days:g} is not above 0 and at most {LONGEST_DAYS:g}", Exit.USAGE)
    with opened_keys(data, ValueError) as keys:
        key, view = keys.add(name, scope, days)
    form.answer({**view.model_dump(mode="json"), "key": key}, key)
    if not form.json:
        may = f"key {view.name!r} may {MEANINGS[view.scope]}; it is shown this once."
        sys.stderr.write(f"{may} Kept as a digest in {data}: {SOON}\n")


@command(key_app, "list")
def list_keys(form: Json, data: DataFolder = DATA) -> None:
    """List the keys, without the keys themselves."""
    with opened_keys(data) as keys:
        found = keys.all()
    rows = [
        (one.name, one.scope, clock(one.made_at), clock(one.used_at) or "never", key_state(one))
        for one in found
    ]
    none = f"no key in {data}: unless its rig file requires keys, the supervisor is open"
    form.answer(found, table("key", "scope", "made", "last used", "state", rows=rows), none)


def key_state(one: KeyView) -> str:
    """Whether a key or a user is in force."""
    if one.revoked_at is not None:
        return f"revoked {clock(one.revoked_at)}"
    if one.expires_at is None:
        return "in force"
    return f"{'until' if one.usable else 'expired'} {clock(one.expires_at)}"


@command(key_app, "revoke")
def revoke(
    form: Json, name: Annotated[str, Argument(metavar="NAME")], data: DataFolder = DATA
) -> None:
    """Revoke a key, and sign out its pages."""
    with opened_keys(data) as keys:
        done = keys.revoke(name)
        there = ", ".join(one.name for one in keys.all() if one.revoked_at is None) or "none"
    if not done:
        raise CliError(f"no key {name!r} is in force in {data}; there are {there}")
    form.answer({"revoked": name}, f"key {name!r} is revoked; {SOON}. In force: {there}")
