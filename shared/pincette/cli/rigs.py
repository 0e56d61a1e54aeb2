"""``pincette rigs``, ``queue`` and ``claim``: states of rigs, waiting jobs, and claims."""

import os
import secrets
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

from rich.markup import escape
from typer import Argument, Option

from pincette.cli import Exit
from pincette.cli.access import CLAIM, Address, Target
from pincette.cli.readers import integer, number
from pincette.cli.terminal import clock, command, group, screen, table

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.access import Claim
    from pincette.api.checks import Check
    from pincette.api.live import LoopTiming
    from pincette.api.places import PlaceList
    from pincette.api.rigs import Certainty, Rig
    from pincette.cli.screen import Rows
    from pincette.client import RigHandle

NO_DECIMALS_FROM = 1000.0
QUANTILES = ("p50_s", "p99_s", "p999_s", "max_s")

app = group()
queue_app = group("queue", "resume, move or clear the jobs in the queue")
app.add_typer(queue_app)
claim_app = group("claim", "claim a rig for a while, give it back, end the claim of another")
app.add_typer(claim_app)


@command(app, "rigs")
def show_rigs(
    address: Address,
    name: Annotated[
        str | None, Argument(metavar="[RIG]", help="its checks, claim and queue; all if not given")
    ] = None,
) -> int:
    """List the rigs, or show one. The exit status is 1 if a required check fails."""
    if name is None:
        rigs = address.supervisor().rigs()
        address.answer(rigs, lambda: screen().print(_rig_table(rigs)))
        return Exit.DONE
    handle = address.supervisor().rig(name)
    rig = handle.state()
    address.answer(rig, lambda: _show_rig(handle, rig, screen()))
    return Exit.DONE if all(one.ok or not one.needed for one in rig.checks) else Exit.FAILED


def _show_rig(handle: "RigHandle", rig: "Rig", console: "Console") -> None:
    """Print a rig, its checks, its claim, and its waiting jobs."""
    console.print(_rig_table([rig]))
    rows = [
        (one.name, mark(one), figure(one.value), figure(one.limit, one.unit), escape(one.words))
        for one in rig.checks
    ]
    names = ("check", "", "value", "limit", "in words")
    console.print(table(*names, rows=rows, right=("value", "limit")))
    console.print(claimed(rig.claim), markup=False)
    _show_queue(handle, rig, console)


def _rig_table(rigs: "Sequence[Rig]") -> "Rows":
    shown = table("rig", "latch", "part", "job", "claimed by", "a job can start", right=())
    for rig in rigs:
        why = "yes" if rig.can_start else "; ".join(rig.reasons)
        stands = rig.standing
        state = _trusted(stands.state, stands.state_certainty, stands.state_age_s)
        part = _trusted(stands.part, stands.part_certainty, stands.part_age_s)
        shown.add_row(rig.name, state, part, rig.active_job or "", *_holder(rig), escape(why))
    return shown


def _holder(rig: "Rig") -> tuple[str]:
    return ("" if rig.claim is None else escape(rig.claim.by),)


def _trusted(shown: str, certainty: "Certainty", age_s: float | None) -> str:
    """Return a value as text; if its certainty is ``believed``, mark it so and add its age."""
    if certainty != "believed":
        return shown
    return f"{shown}, believed" if age_s is None else f"{shown}, believed ({age_s:.1f} s old)"


def timing_table(timing: "LoopTiming") -> "Rows":
    """Return a line for each program and quantity, in ms."""
    from pincette.records.timings import rows

    names = ("program", "quantity", "count", "p50 ms", "p99 ms", "p99.9 ms", "max ms", "missed")
    shown = table(*names, right=names[2:])
    for row in rows(timing):
        missed = "" if row["missed"] is None else str(row["missed"])
        spread = [milliseconds(row[name]) for name in QUANTILES]
        shown.add_row(row["program"], row["quantity"], str(row["count"]), *spread, missed)
    return shown


def milliseconds(duration_s: float | None) -> str:
    """Return a duration in ms, to 1 µs."""
    return "–" if duration_s is None else f"{1e3 * duration_s:.3f}"


def mark(one: "Check") -> str:
    """Return the result of a check in one word: ok, fails, or look."""
    if one.ok:
        return "[green]ok[/]"
    return "[red]fails[/]" if one.needed else "[yellow]look[/]"


def figure(value: float | str | None, unit: str = "") -> str:
    """Return a rounded value with its unit as text."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    digits = f"{value:.0f}" if abs(value) >= NO_DECIMALS_FROM else f"{value:.3g}"
    return f"{digits} {unit}".rstrip()


@command(app, "places")
def show_places(target: Target) -> None:
    """Show the places that vision clients have published, and their differences from where the
    parts were found.
    """
    found = target.rig().places()
    target.answer(found, lambda: _show_places(found, screen()))


def _show_places(found: "PlaceList", console: "Console") -> None:
    rows = [
        (
            escape(one.source),
            f"{one.x_um:.2f} ± {one.u_um:.2g} µm",
            "–" if one.width_um is None else f"{one.width_um:.2f} ± {one.u_width_um:.2g} µm",
            f"{one.age_s:.1f} s",
        )
        for one in found.newest
    ]
    console.print(table("source", "place", "width", "age", rows=rows, right=("place", "age")))
    rows = [
        (
            escape(one.source),
            str(one.count),
            f"{one.mean_um:+.3f} µm",
            "–" if one.deviation_um is None else f"{one.deviation_um:.3f} µm",
        )
        for one in found.biases
    ]
    names = ("source", "jobs", "found minus given, mean", "standard deviation")
    console.print(table(*names, rows=rows, right=names[1:]))
    console.print(f"key on the bus: {found.key}", markup=False)
    if found.refused:
        console.print(f"the last message was refused: {found.refused}", markup=False)


@command(queue_app, "resume")
def resume_queue(target: Target) -> None:
    """Resume a halted queue; the next job starts."""
    handle = target.rig()
    _queue(target, handle, handle.queue("resume"))


@command(queue_app, "move")
def move_queued(
    target: Target,
    job: Annotated[str, Argument(metavar="JOB", help="the id of a waiting job")],
    place: Annotated[
        Any, Argument(metavar="PLACE", parser=integer, help="its new position; 1 is the next")
    ],
) -> None:
    """Move a waiting job to another position in the queue."""
    handle = target.rig()
    _queue(target, handle, handle.move(job, place))


@command(queue_app, "clear")
def clear_queue(target: Target) -> None:
    """Stop all waiting jobs."""
    handle = target.rig()
    _queue(target, handle, handle.queue("clear"))


def _queue(target: Target, handle: "RigHandle", rig: "Rig") -> None:
    target.answer(rig.queue, lambda: _show_queue(handle, rig, screen()))


def _show_queue(handle: "RigHandle", rig: "Rig", console: "Console") -> None:
    if rig.queue.halted:
        console.print(f"[yellow]halted[/yellow]: {rig.queue.halted}")
        console.print(
            "`pincette queue resume` goes on, `pincette queue clear` stops all waiting jobs"
        )
    if not rig.queue.length:
        console.print("no job waits")
        return
    waiting = [one.job for one in handle.jobs(100, state="queued")]
    rows = [
        (job.id, job.kind, str(job.position or ""), clock(job.created_at))
        for job in sorted(waiting, key=lambda one: one.position or 0)
    ]
    console.print(table("job", "kind", "place", "requested", rows=rows, right=("place",)))


def claimed(claim: "Claim | None") -> str:
    """Return, as text, the holder, the remaining time and the purpose of a claim on a rig."""
    if claim is None:
        return "the rig is not claimed"
    more = f": {claim.note}" if claim.note else ""
    return f"claimed by {claim.by} for another {claim.left_s:.0f} s{more}"


@command(claim_app, "take")
def take_claim(
    target: Target,
    lease_s: Annotated[
        float,
        Option(
            "--lease-s", parser=number("seconds"), help="how long it lasts if it is not renewed"
        ),
    ] = 600.0,
    note: Annotated[str, Option("--note", help="its purpose, shown to others")] = "",
) -> None:
    """Claim a rig, or renew the claim: other clients cannot start anything there, but anyone may
    stop it.

    The command prints the variables for your shell: eval "$(pincette claim take)"
    """
    secret = os.environ.get(CLAIM) or secrets.token_urlsafe(24)
    os.environ[CLAIM] = secret
    claim = target.rig().claim(lease_s, note)
    answer = {**claim.model_dump(mode="json"), "claim": secret}
    target.answer(answer, f"export {CLAIM}={secret}")


@command(claim_app, "give-back")
def give_back(
    target: Target,
    force: Annotated[
        bool,
        Option(
            "--force",
            help="end the claim of another client; the audit log and an event state who did",
        ),
    ] = False,
) -> None:
    """End the claim of this shell; PINCETTE_CLAIM contains its secret."""
    rig = target.rig()
    if not force:
        now = rig.give_back().claim
        target.answer(now, claimed(now))
        return
    before = rig.state().claim
    rig.give_back(force=True)
    words = "it was not claimed" if before is None else f"ended: {claimed(before)}"
    target.answer(before, words)
