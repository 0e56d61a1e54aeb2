"""``pincette audit``: who did what over REST, and whether the log of it is whole."""

from typing import Annotated

from rich.markup import escape
from typer import Argument, BadParameter, Option

from pincette.api.access import AuditChain, AuditEntry
from pincette.cli import CliError
from pincette.cli.access import Address
from pincette.cli.options import Limit, integer
from pincette.cli.terminal import clock, command, emit, group, table

VERIFY = "verify"

app = group()


def _verify(text: str) -> str:
    if text != VERIFY:
        raise BadParameter(f"{text!r}: wanted {VERIFY} or nothing")
    return text


@command(app, "audit")
def audit(
    address: Address,
    what: Annotated[
        str | None,
        Argument(metavar=f"[{VERIFY}]", parser=_verify, help="check that no entry was changed"),
    ] = None,
    limit: Limit = 50,
    before: Annotated[
        int | None,
        Option("--before", parser=integer, metavar="NUMBER", help="entries below this number"),
    ] = None,
    link: Annotated[
        str | None,
        Option("--link", metavar="LINK", help="noted earlier: is it still in the log?"),
    ] = None,
) -> None:
    """List entries of the audit log, the newest first; or verify that it is whole."""
    if what == VERIFY:
        chain = address.supervisor().audit_chain(link)
        if chain.broken is not None or chain.found is False:
            if address.json:
                emit(chain)
            raise CliError(_chain_words(chain))
        address.answer(chain, _chain_words(chain))
        return
    found = address.supervisor().audit(limit, before)
    names = ("number", "time", "who", "from", "what", "answer")
    address.answer(found, table(*names, rows=map(_audit_row, found), right=("number", "answer")))


def _chain_words(chain: AuditChain) -> str:
    if chain.newest is None:
        return "the audit log is empty"
    if chain.broken is not None:
        return f"entry {chain.broken} was changed, or one before it is missing"
    if chain.found is False:
        return "the log follows from itself, but the link is none of its: it was written anew"
    noted = "" if chain.found is None else "; the link is one of them"
    return (
        f"{chain.entries} entries, {chain.first} to {chain.newest}, each follows from the one "
        f"before it{noted}. Note the newest link elsewhere: {chain.link}"
    )


def _audit_row(one: AuditEntry) -> tuple[str, ...]:
    what = " ".join([one.action.replace("/api/v1", "", 1), one.detail]).strip()
    times = f" ({one.count} times)" if one.count > 1 else ""
    cells = (clock(one.at), escape(one.who), one.address, escape(what + times))
    return (str(one.number), *cells, str(one.status))
