"""``pincette claim``: claim a rig for a while, give it back, break the claim of another."""

import os
import secrets
from typing import TYPE_CHECKING, Annotated

from typer import Option

from pincette.cli.access import CLAIM, Target
from pincette.cli.readers import number
from pincette.cli.terminal import command, group

if TYPE_CHECKING:
    from pincette.api.access import Claim


app = group()
claim_app = group("claim", "claim a rig for a while, give it back, break the claim of another")
app.add_typer(claim_app)


def claimed(claim: "Claim | None") -> str:
    """Return who has claimed a rig, for how long, and what for, as text."""
    if claim is None:
        return "nobody has claimed the rig"
    more = f": {claim.note}" if claim.note else ""
    return f"claimed by {claim.by} for another {claim.left_s:.0f} s{more}"


@command(claim_app, "take")
def take_claim(
    target: Target,
    lease_s: Annotated[
        float,
        Option("--lease-s", parser=number("seconds"), help="how long it lasts unless renewed"),
    ] = 600.0,
    note: Annotated[str, Option("--note", help="what for; others read it")] = "",
) -> None:
    """Claim a rig, or renew the claim: others begin nothing there, and everybody may stop.

    It prints what your shell needs to know: eval "$(pincette claim take)"
    """
    secret = os.environ.get(CLAIM) or secrets.token_urlsafe(24)
    os.environ[CLAIM] = secret
    claim = target.rig().claim(lease_s, note)
    answer = {**claim.model_dump(mode="json"), "claim": secret}
    target.answer(answer, f"export {CLAIM}={secret}")


@command(claim_app, "give-back")
def give_back(target: Target) -> None:
    """End the claim of this shell, which is that of PINCETTE_CLAIM."""
    rig = target.rig().give_back()
    target.answer(rig.claim, claimed(rig.claim))


@command(claim_app, "break")
def break_claim(target: Target) -> None:
    """End the claim of somebody else; the audit log and an event say who did."""
    before = target.rig().state().claim
    target.rig().give_back(force=True)
    target.answer(
        before, "nobody had claimed it" if before is None else f"broken: {claimed(before)}"
    )
