"""``pincette security``: certificates of programs and people."""

from collections.abc import Generator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, BadParameter, Option

from pincette.cli import CliError, Exit, chosen, opened
from pincette.cli.readers import number
from pincette.cli.terminal import Function, Json, command, emit, group
from pincette.core.files import temporary_folder
from pincette.core.service import canonical_name
from pincette.security.certificates import Facts
from pincette.security.establishing import DAYS, due, enrol, enrol_upstream, establish
from pincette.security.folder import SOON, Folder
from pincette.security.identity import OPERATOR, PEOPLE, Identity, SecurityError, person, program
from pincette.security.revocation import REVOKED, begin_revoked, read_revoked

if TYPE_CHECKING:
    from pincette.config import RigFile


IN_DATA = "pki"
"""Folder of the certificates of ``up --secure``, relative to ``--data``."""


def _composed_program(text: str) -> str:
    """Return the usual name of a program that runs several services of the loop."""
    try:
        return canonical_name(text)
    except ValueError as error:
        raise BadParameter(str(error)) from error


def _positive_days(text: str) -> float:
    days = number("days")(text)
    if days <= 0.0:
        raise CliError(f"--days {days:g}: must be above 0")
    return days


Place = Annotated[Path, Argument(metavar="FOLDER", help="where certificates are")]
Hosts = Annotated[
    list[str] | None,
    Option(
        "--host",
        metavar="HOST",
        help="name or address at which programs can be reached; repeatable; loopback if not given",
    ),
]
Composed = Annotated[
    list[Any] | None,
    Option(
        "--composed",
        parser=_composed_program,
        metavar="PROGRAM",
        help="also for a composed program, such as loop or estimator+controller; repeatable",
    ),
]
Days = Annotated[
    float, Option("--days", parser=_positive_days, metavar="N", help="how long they are valid")
]
Person = Annotated[str, Argument(metavar="PERSON", help="a name, all lower case")]

app = group()
security_app = group(
    "security", "make, list and revoke certificates, which state who may do what on the bus"
)
app.add_typer(security_app)


def _guarded(function: Function) -> Function:
    """Return the function with SecurityError turned into a command error."""

    @wraps(function)
    def call(*args: Any, **given: Any) -> int | None:
        try:
            return function(*args, **given)
        except SecurityError as error:
            raise CliError(str(error)) from error

    return call


@command(security_app, "init")
@_guarded
def init(
    path: Place,
    rigs: Annotated[
        list[str] | None,
        Option(
            "--rig",
            metavar="RIG",
            help="name of a rig; repeatable; that of the rig file if not given",
        ),
    ] = None,
    hosts: Hosts = None,
    composed: Composed = None,
    days: Days = DAYS,
) -> None:
    """Create an authority, and certificates for a rig's programs, a viewer and an operator."""
    folder, names, together = Folder(path), rigs or [], composed or []
    if not names:
        rig = opened(chosen(None)).rig
        names, together = [rig.name], [*dict.fromkeys([*rig.composed, *together])]
    establish(folder, names, hosts or [], _now(), days, together)
    show_certificates(folder, _now())
    print(
        f"\n{folder.path}/README.txt says what each file is for. Take authority.key to a safe "
        f'place.\nIn the rig file: [bus] pki = "{folder.path.resolve()}"'
    )


@command(security_app, "add")
@_guarded
def add(
    path: Place,
    name: Annotated[str, Argument(metavar="RIG", help="its name")],
    hosts: Hosts = None,
    composed: Composed = None,
    days: Days = DAYS,
) -> None:
    """Create certificates for another rig's programs, or for one program that runs several services
    of a rig.
    """
    made = enrol(Folder(path), name, hosts or [], _now(), days, composed or [])
    _print("made", made, "restart the router, which then accepts them")


@command(security_app, "upstream")
@_guarded
def upstream(path: Place, hosts: Hosts = None, days: Days = DAYS) -> None:
    """Create a certificate for a laboratory server's router, to which the rig's router connects."""
    made = enrol_upstream(Folder(path), hosts or [], _now(), days)
    _print(
        "made",
        (made,),
        "it and the router of the rig read each other's certificate when they start",
    )


@command(security_app, "issue")
@_guarded
def issue(
    path: Place,
    name: Person,
    role: Annotated[
        Literal["viewer", "operator"], Option("--role", help="what it may do", show_default=False)
    ],
    days: Days = DAYS,
) -> None:
    """Create a certificate for another person or tool."""
    who = person(name, role)
    Folder(path).issue(who, (), _now(), days)
    _print("made", (who,), _restarts(who))


@command(security_app, "renew")
@_guarded
def renew(
    path: Place,
    names: Annotated[
        list[str] | None,
        Argument(metavar="WHO", help="name as listed; all that expire soon if not given"),
    ] = None,
    days: Days = DAYS,
) -> None:
    """Renew certificates before they expire."""
    folder, now = Folder(path), _now()
    wanted = tuple(map(folder.named, names or ())) or tuple(due(folder, now))
    for who in wanted:
        folder.renew(who, now, days)
    if wanted:
        _print("renewed", wanted, "restart each of these programs while its rig is idle")
    else:
        print("none expires within 30 days")


@command(security_app, "revoke")
@_guarded
def revoke(
    path: Place,
    name: Annotated[str | None, Argument(metavar="[NAME]", help="as shown")] = None,
    anew: Annotated[
        bool, Option("--anew", help="start an empty list instead of one that is lost or damaged")
    ] = False,
) -> None:
    """Revoke the certificate of a person or a program; its links end within 2 s."""
    if anew == (name is not None):
        raise CliError("revoke: give either the NAME of a certificate or --anew")
    folder = Folder(path)
    if name is None:
        _start_empty_list(folder)
        return
    who = folder.named(name)
    rest = f"copy {path / REVOKED} to the other machines of the rig"
    if who.role in PEOPLE:
        folder.revoke(who)
    else:
        folder.replace(who, _now(), DAYS)
        rest = f"its certificate has changed: restart it with the new one; {rest}"
    _print("revoked", (who,), rest)


def _start_empty_list(folder: Folder) -> None:
    """Write an empty revocation list, unless a valid one exists."""
    folder.authority()
    with suppress(SecurityError):
        raise CliError(
            f"{folder.path / REVOKED} is in order, with {len(read_revoked(folder.path))} "
            "certificates; it is not overwritten"
        )
    begin_revoked(folder.path)
    print(
        f"{folder.path / REVOKED} is empty: certificates that were on the list before are "
        "accepted again"
    )


@command(security_app, "show")
@_guarded
def show(path: Place, form: Json) -> int:
    """Show every certificate with its expiry and its hosts."""
    return show_certificates(Folder(path), _now(), as_json=form.json)


def _restarts(who: Identity) -> str:
    """Return what must be restarted before a change of the list of people takes effect."""
    also = " and, while its rig is idle, each actuator" if who.role == OPERATOR else ""
    return f"restart the router{also}: programs read their access lists at the start"


def _print(done: str, who: tuple[Identity, ...], then: str) -> None:
    print(f"{done}: {', '.join(one.name for one in who)}\n{then}")


def show_certificates(folder: Folder, now: datetime, *, as_json: bool = False) -> int:
    """Print certificates; the exit status is 1 if one has expired."""
    found = [folder.authority(), *folder.all()]
    if as_json:
        emit([_tree(facts, now) for facts in found])
    else:
        width = max(len(facts.identity.name) for facts in found)
        for facts in found:
            row = _tree(facts, now)
            print(
                f"{facts.identity.name:<{width}}  {facts.identity.role:<10}  "
                f"{facts.ends:%Y-%m-%d}  {row['state']:<10}  {', '.join(facts.hosts)}".rstrip()
            )
    return Exit.FAILED if any(facts.ends <= now for facts in found) else Exit.DONE


def _tree(facts: Facts, now: datetime) -> dict[str, Any]:
    """Return one certificate as a dictionary."""
    return {
        "name": facts.identity.name,
        "role": facts.identity.role,
        "begins": facts.begins.isoformat(),
        "ends": facts.ends.isoformat(),
        "state": _state(facts, now),
        "hosts": list(facts.hosts),
    }


def _state(facts: Facts, now: datetime) -> str:
    if facts.ends <= now:
        return "ended"
    return "expires soon" if facts.ends - now < SOON else "good"


def _now() -> datetime:
    return datetime.now(UTC)


@contextmanager
def temporary_certificates(rig: "RigFile") -> Generator[Path]:
    """Provide a folder of certificates that is deleted at the end of the block."""
    with temporary_folder() as folder:
        yield made_certificates(rig, folder)


def made_certificates(rig: "RigFile", data: Path) -> Path:
    """Return the folder of certificates beside the records.

    Create the folder, and add a rig to it, if they do not exist.
    """
    folder, now = Folder(data / IN_DATA), datetime.now(UTC)
    hosts = tuple(dict.fromkeys((rig.bus.host, rig.supervisor.host, *rig.supervisor.names)))
    name, composed = rig.rig.name, rig.rig.composed
    try:
        if not folder.path.exists():
            establish(folder, [name], hosts, now, composed=composed)
        else:
            known = {facts.identity.name for facts in folder.all()}
            missing = [one for one in composed if program(one, name).name not in known]
            if missing or name not in folder.rigs():
                enrol(folder, name, hosts, now, composed=missing)
    except SecurityError as error:
        raise CliError(str(error)) from error
    return folder.path
