"""``pincette bring-up``: guides a person through the calibrations of a rig in checklist order."""

import sys
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from pincette.api.checklist import StepState
from pincette.cli import CliError, Exit
from pincette.cli.access import FOLLOWED_S, Target
from pincette.cli.model import show_proposal
from pincette.cli.results import measured
from pincette.cli.terminal import command, group, screen, table, tree
from pincette.cli.watch import follow

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.calibrations import Proposal
    from pincette.api.checklist import BenchNeed, Checklist, ChecklistStep
    from pincette.api.rigs import Rig
    from pincette.client import JobHandle, RigHandle, Supervisor


COLOURS: dict[StepState, str] = {"done": "green", "next": "cyan", "unsupported": "yellow"}
GRIP = "`pincette plan grip` predicts a grip, `pincette job grip` grips"

app = group()


@command(app, "bring-up")
def bring_up(
    target: Target,
    show: Annotated[bool, Option("--list", help="only list the calibrations")] = False,
    yes: Annotated[
        bool,
        Option(
            "--yes",
            help="confirm that the bench is ready for the next step: run it, accept it, and "
            "continue until the bench must be changed again",
        ),
    ] = False,
    skip: Annotated[
        list[str] | None,
        Option("--skip", metavar="CALIBRATION", help="calibration to skip; repeatable"),
    ] = None,
) -> int:
    """Guide through the calibrations of a rig: the next one, its requirements, its result."""
    rig = target.rig().patient(FOLLOWED_S)
    found = rig.checklist()
    if show or target.json:
        if not target.json:
            _show_exchanges(rig.state(), screen())
        target.answer(found, lambda: show_checklist(found, screen()))
        return Exit.DONE
    if not (yes or sys.stdin.isatty()):
        raise CliError(
            "no terminal for questions: --yes continues without them, --list only lists", 2
        )
    console, left_out, ready = screen(), {*(skip or [])}, None
    _show_exchanges(rig.state(), console)
    if unknown := left_out - {step.calibration for step in found.steps}:
        raise CliError(f"--skip: unknown calibration {', '.join(sorted(unknown))}", Exit.USAGE)
    show_checklist(found, console)
    while (step := _next(rig.checklist(), left_out)) is not None:
        needs = [need.code for need in step.needs]
        if yes and ready not in (None, needs):
            console.print(f"\nnext: {step.label}: {_needs(step.needs)}")
            console.print("then `pincette bring-up --yes` again")
            return Exit.FAILED
        ready = needs
        if not _made(target, step, console, yes=yes):
            left_out.add(step.calibration)
    show_checklist(rig.checklist(), console)
    console.print(f"\nskipped: {', '.join(sorted(left_out))}" if left_out else "\nall done")
    for text in path_warnings(rig):
        console.print(f"[yellow]{text}[/yellow]")
    console.print(GRIP)
    return Exit.DONE


def path_warnings(rig: "RigHandle") -> list[str]:
    """Return the warnings about the path in the rig file, for example steps that excite the mode.

    Empty if the rig file contains no path.
    """
    from pincette.client.errors import ProblemError

    try:
        plan = rig.plan("track")
    except ProblemError:
        return []
    return list(getattr(plan, "warnings", ()))


def _show_exchanges(rig: "Rig", console: "Console") -> None:
    """Show the exchange times that the programs measured at their instruments.

    In lockstep nothing is shown.
    """
    from pincette.diagnostics.hops import hop_findings

    for program in rig.programs:
        for arm, took in enumerate(program.exchanges, start=1):
            name = f"{program.name}, arm {arm}" if len(program.exchanges) > 1 else program.name
            console.print(
                f"exchanges of the {name}: {1e3 * took.minimum_s:.1f}/{1e3 * took.median_s:.1f}/"
                f"{1e3 * took.worst_s:.1f} ms (minimum/median/worst of {took.count})",
            )
            for finding in hop_findings(name, took.held_s, took.line_baud):
                console.print(finding.what, markup=False)
                console.print(f"  what to do: {finding.remedy}", markup=False)


def _next(found: "Checklist", left_out: set[str]) -> "ChecklistStep | None":
    """Return the first step that has neither been completed nor skipped."""
    return next(
        (
            step
            for step in found.steps
            if step.state in ("next", "later") and step.calibration not in left_out
        ),
        None,
    )


def _made(target: Target, step: "ChecklistStep", console: "Console", *, yes: bool) -> bool:
    """Run a step, or decide about its proposal; returns False if a person skips it."""
    console.print(f"\n[bold]{step.label}[/bold]: {step.summary}")
    for reason in step.reasons:
        console.print(f"  {reason.text}", markup=False)
    if any(reason.code == "refused" for reason in step.reasons):
        raise CliError("it would be refused: correct what is named, or skip it with --skip")
    name = step.proposal
    if name is None:
        if not yes and not _agreed(f"{_needs(step.needs)}, then press Enter (or s to skip it)"):
            return False
        fields = {name: value for name, value in step.request.items() if name != "rig"}
        handle = target.rig().patient(FOLLOWED_S).start(fields.pop("kind"), **fields)
        _run(handle, console)
        name = handle.id
    supervisor = target.supervisor().patient(FOLLOWED_S)
    return _decided(supervisor, supervisor.proposal(name), console, yes=yes)


def _run(job: "JobHandle", console: "Console") -> None:
    """Follow the job of a calibration; raises CliError if it does not succeed."""
    ended = follow(job, console)
    if ended.state != "succeeded":
        raise CliError(
            f"job {job.id} {ended.state}: {ended.cause}\n`pincette bring-up` tries again"
        )


def _decided(
    supervisor: "Supervisor", proposal: "Proposal", console: "Console", *, yes: bool
) -> bool:
    """Show the proposal, and accept it if a person agrees; otherwise discard it."""
    shown = tree(proposal)
    show_proposal(shown, console)
    console.print(f"  {proposal.statement}", markup=False)
    for one in proposal.figures:
        console.print(f"  {one.name} {one.value:.4g} {one.unit}: {one.meaning}", markup=False)
    for text in proposal.warnings:
        console.print(f"  [yellow]{text}[/yellow]")
    accepted = yes or _agreed("Enter accepts these values (s discards them and skips this step)")
    supervisor.decide(proposal.id, "accept" if accepted else "discard")
    return accepted


def _agreed(words: str) -> bool:
    """Return True if a person presses Enter, False for ``s``, which skips the step."""
    try:
        return input(f"  {words}: ").strip().lower() not in ("s", "skip", "n", "no")
    except EOFError as error:
        raise CliError(
            "the terminal was closed; `pincette bring-up` continues from here"
        ) from error


def _needs(needs: "list[BenchNeed]") -> str:
    return "; ".join(need.text for need in needs)


def show_checklist(found: "Checklist", console: "Console") -> None:
    """Print the calibrations in their order: their state, and their result or requirement."""
    rows: list[tuple[Any, ...]] = []
    for place, step in enumerate(found.steps, 1):
        colour = COLOURS.get(step.state, "default")
        rows.append((f"{place}", step.calibration, f"[{colour}]{step.state}[/]", _said(step)))
    console.print(table("", "calibration", "state", "found, or needed", rows=rows, right=()))


def _said(step: "ChecklistStep") -> str:
    if step.state == "done":
        return "; ".join(f"{one.quantity} {measured(tree(one))}" for one in step.gained)
    if step.state == "unsupported":
        return step.reasons[-1].text
    return _needs(step.needs)
