"""``pincette security``: certificates of programs and people."""

import argparse
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from pincette.cli import rig_file
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, machine, words
from pincette.cli.readers import composed_program, number
from pincette.cli.rest import CliError
from pincette.cli.security_show import show
from pincette.security.establishing import DAYS, due, enrol, enrol_upstream, establish
from pincette.security.folder import Folder
from pincette.security.identity import OPERATOR, PEOPLE, Identity, SecurityError, person

ABOUT = "certificates: who is who on the bus, and so what each may do there"
INIT = "make an authority, and certificates of a rig's programs, a viewer and an operator"
ADD = "make certificates of another rig's programs, or of one that composes several of a rig's"
UPSTREAM = "make a certificate of a laboratory server's router, which the rig's connects to"
ISSUE = "make a certificate of another person or tool"
RENEW = "make certificates anew, before they end"
REVOKE = "take a person's certificate out, so that the router lets it do nothing more"
SHOW = "every certificate with its end and its hosts"


def add(word: Words) -> None:
    """Add ``security`` and the words below it."""
    below = words(word("security", ABOUT), "words", "WORD")
    one = _composing(_lasting(_hosted(_in_folder(below("init", INIT), _init))))
    one.add_argument(
        "--rig",
        dest="rigs",
        action="append",
        default=[],
        metavar="RIG",
        help="its name, once for each rig; that of the rig file if not given",
    )
    one = _composing(_lasting(_hosted(_in_folder(below("add", ADD), _add))))
    one.add_argument("name", metavar="RIG", help="its name")
    _lasting(_hosted(_in_folder(below("upstream", UPSTREAM), _upstream)))
    one = _lasting(_in_folder(below("issue", ISSUE), _issue))
    one.add_argument("name", metavar="PERSON", help="a name, all lower case")
    one.add_argument("--role", choices=PEOPLE, required=True, help="what it may do")
    one = _lasting(_in_folder(below("renew", RENEW), _renew))
    one.add_argument(
        "names", nargs="*", metavar="WHO", help="as shown; all that end soon if not given"
    )
    one = _in_folder(below("revoke", REVOKE), _revoke)
    one.add_argument("name", metavar="PERSON", help="as shown")
    machine(_in_folder(below("show", SHOW), _show))


def _in_folder(
    word: argparse.ArgumentParser, call: Callable[[argparse.Namespace, Folder], int]
) -> argparse.ArgumentParser:
    """Let a word be told the folder; what cannot be done ends the command with its reason."""
    word.add_argument("folder", type=Path, metavar="FOLDER", help="where certificates are")

    def guarded(given: argparse.Namespace) -> int:
        try:
            return call(given, Folder(given.folder))
        except SecurityError as error:
            raise CliError(str(error)) from error

    return does(word, guarded)


def _hosted(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    word.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="HOST",
        help="name or address at which programs are reached, once for each; loopback if not given",
    )
    return word


def _composing(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    word.add_argument(
        "--composed",
        type=composed_program,
        action="append",
        default=[],
        metavar="PROGRAM",
        help="one that composes services too, as loop or estimator+controller, once for each",
    )
    return word


def _lasting(word: argparse.ArgumentParser) -> argparse.ArgumentParser:
    word.add_argument(
        "--days",
        type=number("days"),
        default=DAYS,
        metavar="N",
        help="how long they hold; %(default)g if not given",
    )
    return word


def _init(given: argparse.Namespace, folder: Folder) -> int:
    rigs, composed = given.rigs, given.composed
    if not rigs:
        rig = rig_file.opened(rig_file.chosen(None)).rig
        rigs, composed = [rig.name], [*dict.fromkeys([*rig.composed, *composed])]
    establish(folder, rigs, given.hosts, _now(), _days(given), composed)
    show(folder, _now())
    print(
        f"\n{folder.path}/README.txt says what each file is for. Take authority.key to a safe "
        f'place.\nIn the rig file: [bus] pki = "{folder.path.resolve()}"'
    )
    return Exit.DONE


def _add(given: argparse.Namespace, folder: Folder) -> int:
    made = enrol(folder, given.name, given.hosts, _now(), _days(given), given.composed)
    _say("made", made, "restart the router: it knows them from then on")
    return Exit.DONE


def _upstream(given: argparse.Namespace, folder: Folder) -> int:
    made = enrol_upstream(folder, given.hosts, _now(), _days(given))
    _say("made", (made,), "it and the router of the rig read each other's when they start")
    return Exit.DONE


def _issue(given: argparse.Namespace, folder: Folder) -> int:
    who = person(given.name, given.role)
    folder.issue(who, (), _now(), _days(given))
    _say("made", (who,), _restarts(who))
    return Exit.DONE


def _renew(given: argparse.Namespace, folder: Folder) -> int:
    now = _now()
    wanted = tuple(map(folder.named, given.names)) or tuple(due(folder, now))
    for who in wanted:
        folder.renew(who, now, _days(given))
    if wanted:
        _say("renewed", wanted, "restart each of them, while its rig is idle")
    else:
        print("none ends within 30 days")
    return Exit.DONE


def _revoke(given: argparse.Namespace, folder: Folder) -> int:
    who = folder.named(given.name)
    if who.role not in PEOPLE:
        raise SecurityError(
            f"{who.name} is a program: as long as there is one of that name, its old key is good. "
            "Where a program's key is lost, begin a new folder with `pincette security init`"
        )
    folder.remove(who)
    _say("taken out", (who,), _restarts(who))
    return Exit.DONE


def _show(given: argparse.Namespace, folder: Folder) -> int:
    return show(folder, _now(), as_json=given.json)


def _restarts(who: Identity) -> str:
    """What has to be started anew before a change in the list of people takes effect."""
    also = " and, while its rig is idle, each actuator" if who.role == OPERATOR else ""
    return f"restart the router{also}: access lists are read at the start"


def _say(done: str, who: tuple[Identity, ...], then: str) -> None:
    print(f"{done}: {', '.join(one.name for one in who)}\n{then}")


def _days(given: argparse.Namespace) -> float:
    if given.days <= 0.0:
        raise SecurityError(f"--days {given.days:g}: wanted more than 0 days")
    return given.days


def _now() -> datetime:
    return datetime.now(UTC)
