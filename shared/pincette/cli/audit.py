"""``pincette audit``: who did what over REST."""

import argparse

from rich.markup import escape

from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, machine, url
from pincette.cli.output import emit, screen
from pincette.cli.rest import reached
from pincette.cli.tables import clock, table

ABOUT = "list who did what over REST, and who was refused; needs scope admin"
LIMIT = 50


def add(word: Words) -> None:
    """Add ``audit``."""
    one = word("audit", ABOUT)
    one.add_argument("--limit", type=int, default=LIMIT, help="no more; %(default)s if not given")
    one.add_argument("--before", type=int, metavar="NUMBER", help="entries below this number")
    does(machine(url(one)), audit)


def audit(given: argparse.Namespace) -> int:
    """List entries, the newest first."""
    found = reached(given).audit(given.limit, given.before)
    if given.json:
        emit(found)
        return Exit.DONE
    rows = table("number", "time", "who", "from", "what", "answer", right=("number", "answer"))
    for one in found:
        what = " ".join([one.action.replace("/api/v1", "", 1), one.detail]).strip()
        times = f" ({one.count} times)" if one.count > 1 else ""
        rows.add_row(
            str(one.number),
            clock(one.at),
            escape(one.who),
            one.address,
            escape(what + times),
            str(one.status),
        )
    screen().print(rows)
    return Exit.DONE
