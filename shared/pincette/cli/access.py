"""Options for the supervisor that a command uses, and the key for it."""

import os
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from pincette.cli import PKI, CliError, Exit
from pincette.cli.credentials import (
    AUTHORITY,
    AUTHORITY_HELP,
    DEFAULT_URL,
    KEY_HELP,
    authority_of,
    find_key,
    operator,
)
from pincette.cli.terminal import Json, emit

if TYPE_CHECKING:
    from pincette.client import JobHandle, RigHandle, Supervisor

CLAIM = "PINCETTE_CLAIM"
"""Environment variable with the secret of a claim; every command sends it."""
TRACEPARENT = "TRACEPARENT"
"""Environment variable with the caller's trace context (W3C), which is stored with jobs and
series.
"""
PATIENCE_S = 0.5
"""Time for which commands retry until they report an unreachable supervisor, in s."""
FOLLOWED_S = 30.0
"""Time for which a command keeps following a job while the supervisor does not reply, as during a
restart, in s.
"""
STATUSES = {  # exit status by the code of a refusal
    **dict.fromkeys(("estop-engaged", "rig-latched", "rig-not-ready"), Exit.NOT_READY),
    "limit-violation": Exit.LIMIT,
}
REMEDIES = (
    "`pincette up` starts a rig with one, and restarts it if it dies",
    "`pincette run supervisor` starts only a supervisor; loop and part are not affected",
    "--url names another",
)
"""Remedies for an address at which no supervisor replies."""
SILENT_REMEDIES = (
    "try again: the supervisor may be busy",
    "`pincette rigs` shows whether it replies at all; `pincette estop` stops the rig without it",
)
"""Remedies for a connection without a reply."""
Key = Annotated[str | None, Option("--key", metavar="KEY", help=KEY_HELP)]
Authority = Annotated[
    Path | None,
    Option("--authority", metavar="FILE", envvar=AUTHORITY, show_envvar=False, help=AUTHORITY_HELP),
]


@dataclass(frozen=True, slots=True)
class Address(Json):
    """Options of commands that send requests to a supervisor."""

    url: Annotated[
        str,
        Option(
            "--url",
            envvar="PINCETTE_URL",
            show_envvar=False,
            help="URL of the supervisor; $PINCETTE_URL if not given",
        ),
    ] = DEFAULT_URL
    key: Key = None
    authority: Authority = None

    def supervisor(self) -> "Supervisor":
        """Return the supervisor at ``--url``, used with the key of ``--key``."""
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
        """Turn a refused request or a missing reply into a CliError."""
        return refusals(self.url, as_json=self.json)


@dataclass(frozen=True, slots=True)
class Target(Address):
    """Options of commands that send requests about one rig of a supervisor."""

    rig_name: Annotated[
        str | None,
        Option("--rig-name", metavar="RIG", help="name of the rig, if there are several"),
    ] = None

    def rig(self) -> "RigHandle":
        """Return the rig named by ``--rig-name``, else the only one.

        Raises CliError if there are several.
        """
        from pincette.client import WhichRigError

        try:
            return self.supervisor().rig(self.rig_name)
        except WhichRigError as error:
            raise CliError(f"{error} with --rig-name", Exit.USAGE) from error

    def job(self, name: str) -> "JobHandle":
        """Return a job by its id; the id ``last`` means the newest job of the rig."""
        if name != "last":
            return self.supervisor().job(name)
        found = self.rig().jobs(1)
        if not found:
            raise CliError("there is no job yet; `pincette job grip` starts one")
        return found[0]


@contextmanager
def refusals(url: str, *, as_json: bool) -> Generator[None]:
    """Turn a refused request or a missing reply into a CliError; print it as JSON if requested."""
    from pincette.client import ClientError, NoAnswerError, ProblemError

    try:
        yield
    except NoAnswerError as error:
        if error.delivered:
            raise CliError(f"no answer: {error}", Exit.NO_ANSWER) from error
        if error.silent:
            what, remedies = f"no reply came in time from {url}", SILENT_REMEDIES
        else:
            what, remedies = f"no supervisor answers at {url}", REMEDIES
        text = "\n  ".join((what, f"why: {error}", *(f"remedy: {one}" for one in remedies)))
        raise CliError(text, Exit.NO_ANSWER) from error
    except ProblemError as error:
        if as_json:
            emit(error.problem)
        raise CliError(str(error), STATUSES.get(error.code, Exit.FAILED)) from error
    except ClientError as error:
        raise CliError(str(error)) from error


def key_of(given: str | None) -> str | None:
    """Return the key found by ``find_key``; also raises CliError if the key cannot be sent in a
    header.
    """
    from pincette.client.call import identity_headers

    key = find_key(given)
    try:
        identity_headers(None, key)
    except ValueError as error:
        raise CliError(str(error), Exit.USAGE) from error
    return key
