"""``pincette job``, ``plan``, ``stop`` and ``learning``: start, follow and control jobs."""

import os
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, get_args

from typer import Argument, Context, Option, Typer
from typer.main import get_group

from pincette.api.states import ActionType
from pincette.cli import CliError, Exit
from pincette.cli.access import FOLLOWED_S, TRACEPARENT, Target
from pincette.cli.found import ID, JobName, Labels, add_to
from pincette.cli.options import (
    ALL,
    Everything,
    Picture,
    given_fields,
    help_text,
    request_parameters,
    stated_fields,
)
from pincette.cli.output_file import write_output
from pincette.cli.results import show_plan, show_result
from pincette.cli.terminal import (
    Group,
    clock,
    command,
    emit,
    fitted,
    group,
    named,
    patience,
    screen,
    table,
    tree,
)
from pincette.cli.watch import followed

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.job_kinds import JobKind
    from pincette.api.jobs import Artifact, Job
    from pincette.client import JobHandle


ACTIONS: Mapping[ActionType, str] = {
    "pause": "pause a job at its next safe point; a held part stays held with its force",
    "resume": "resume a paused job",
    "stop": "stop a job; a held part stays held",
    "abort": "abort a job: the actuator goes to its safe state and latches",
    "continue": "continue a job that waits for a person",
    "start": "start a job that was created and is ready",
    "retry": "repeat a job that waits for a decision, as a new job",
    "accept": "accept the result of a job that waits for a decision",
    "approve": "approve a proposed job, which is planned again and then queued or started",
    "reject": "reject a proposed job",
    "give_up": "give up a job that waits for a decision",
}
STOPPED_S = 60.0
"""Time limit for the rig to confirm ``stop``, in s."""


NoWait = Annotated[
    bool, Option("--no-wait", help="print the id of the job, and do not wait for its end")
]
Queue = Annotated[bool, Option("--queue", help="wait in the queue if another job uses the rig")]
Asked = Annotated[
    str | None,
    Argument(metavar="JOB", help="the job to act on; a new one if not given"),
]
"""Argument of the command for a kind of job that has the same name as an action."""


def _add_start(below: Typer, name: str, about: str, kind: "JobKind", fixed: dict[str, Any]) -> None:
    """Add the command that starts a job of a kind or of one of its variants."""
    request = kind.request_of(fixed.get(kind.variant_field, ""))
    asked = [named("asked", Asked)] if kind.name in get_args(ActionType) else []
    more = [*asked, *request_parameters(request, tuple(fixed))]

    def start(
        target: Target,
        queue: Queue = False,
        labels: Labels = None,
        no_wait: NoWait = False,
        everything: Everything = False,
        **given: Any,
    ) -> int | None:
        if (asked := given.get("asked")) is not None:
            return _act(target, asked, kind.name)  # pyright: ignore[reportArgumentType]
        fields = {**fixed, **given_fields(given)}
        if queue:
            fields["queue"] = True
        if labels:
            fields["labels"] = dict(labels)
        rig = target.rig()
        if fields and not target.json:
            sys.stderr.write(fitted(f"requested: {stated_fields(fields)}\n", sys.stderr))
        with patience("planning, predicting and starting"):
            job = rig.start(kind.name, traceparent=os.environ.get(TRACEPARENT), **fields)
        if not no_wait:
            return followed(job.patient(FOLLOWED_S), machine=target.json, everything=everything)
        target.answer(job.job, job.id)
        return None

    command(below, name, more, help=about)(start)


def _add_plan(below: Typer, name: str, about: str, kind: "JobKind", fixed: dict[str, Any]) -> None:
    request = kind.request_of(fixed.get(kind.variant_field, ""))
    more = request_parameters(request, tuple(fixed))

    def plan(target: Target, **given: Any) -> int:
        fields, rig = {**fixed, **given_fields(given)}, target.rig()
        with patience("planning and predicting"):
            planned = rig.plan(kind.name, **fields)
        if not target.json and fields:
            print(fitted(f"requested: {stated_fields(fields)}\n", sys.stdout))
        target.answer(planned, lambda: show_plan(planned, screen()))
        if (plot := given.get("plot")) is not None:
            with patience("drawing"):
                write_output(plot, rig.plot(kind.name, **fields))
            if not target.json:
                print(f"plot: {plot}")
        return Exit.DONE if planned.feasible else Exit.LIMIT

    pictured = [named("plot", Picture)] if kind.predicted else []
    command(below, name, [*pictured, *more], help=about)(plan)


class JobKinds(Group):
    """Commands of the group ``job``. The commands for the kinds of job are created on demand.

    They need the models of all requests; importing these takes longer than listing jobs.
    """

    add = staticmethod(_add_start)
    """Function that adds the command for a kind of job or for one of its variants."""

    def resolve_command(self, ctx: Context, args: list[str]) -> Any:  # type: ignore[override]
        """Find a command by its name."""
        if args[0] not in self.commands:
            self.complete()
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: Context) -> list[str]:  # type: ignore[override]
        """Return the names of all commands."""
        self.complete()
        return super().list_commands(ctx)

    def complete(self) -> None:
        """Add a command for each kind of job."""
        from pincette.api.job_kinds import job_kinds

        kinds = group()
        for kind in job_kinds().values():
            about = help_text(kind.summary)
            if not kind.variants:
                self.add(kinds, kind.name, about, kind, {})
                continue
            below = group(kind.name, about)
            for variant in kind.variants.values():
                fixed, about = {kind.variant_field: variant.name}, help_text(variant.summary)
                self.add(below, variant.name, about, kind, fixed)
            kinds.add_typer(below)
        own = self.commands
        self.commands = {**get_group(kinds).commands, **own}


class PlanKinds(JobKinds):
    """Commands of the group ``plan``, one for each kind of job."""

    add = staticmethod(_add_plan)


app = group()
job_app = group("job", "start a job and follow it, act on one, list them", JobKinds)
plan_app = group("plan", "predict a job, and list every limit that it would break", PlanKinds)
for one in (job_app, plan_app):
    app.add_typer(one)


def _act(target: Target, name: str, action: ActionType, **members: Any) -> None:
    """Send an action to a job."""
    job = target.job(name)
    answer = job.act(action, **members)
    target.answer(answer, f"job {job.id}: {action} accepted; it is {answer.state}")


def _add_action(action: ActionType, about: str) -> None:
    def act(target: Target, job: JobName) -> None:
        _act(target, job, action)

    command(job_app, action.replace("_", "-"), help=about)(act)


@command(job_app, "retry-at")
def retry_at(
    target: Target,
    job: JobName,
    x_um: Annotated[float, Option("--x-um", help="place of the part, in µm")],
    u_um: Annotated[float, Option("--u-um", help="expanded uncertainty (k = 2), in µm")] = 1.0,
    source: Annotated[str, Option("--source", help="what has measured the place")] = "person",
) -> None:
    """Repeat a job that waits for a decision, as a new job at another place."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    place = {"x_um": x_um, "u_um": u_um, "measured_at": now, "source": source}
    _act(target, job, "retry_at", place=place)


@command(app, "stop")
def stop(
    target: Target,
    name: Annotated[
        str | None, Argument(metavar="JOB", help=f"{ID}; the running one if not given")
    ] = None,
) -> None:
    """Stop a job, and wait for its end."""
    from pincette.client import WaitTimeoutError

    job = target.job(name) if name else target.rig().active_job()
    if job is None:
        target.answer(None, "no job runs")
        return
    job.stop()
    try:
        with patience(f"waiting for the rig to stop job {job.id}"):
            job.wait(STOPPED_S)
    except WaitTimeoutError as error:
        raise CliError(f"{error}; `pincette estop` stops the rig at once") from error
    text = f"job {job.id} is {job.state}"
    if "release" in job.job.allowed_actions:
        text += f"\nits part is still held: `pincette job release {job.id}` releases it"
    target.answer(job.job, text)


def show_job(job: "Job", console: "Console", *, everything: bool = False) -> None:
    """Print the result, the request and the allowed actions of a job."""
    from pincette.api.jobs import DESCRIPTION

    show_result(job, console, everything=everything)
    said = {name: str(getattr(job, name)) for name in DESCRIPTION} | job.labels
    stated = {n: value for n, value in job.request.items() if n not in (*DESCRIPTION, "labels")}
    given = [stated_fields(stated), *(f"{name}: {value}" for name, value in said.items() if value)]
    console.print(f"\nrequested: {', '.join(given)}", markup=False)
    times = {"requested": job.created_at, "started": job.started_at, "ended": job.ended_at}
    known = [f"{name} {clock(at)}" for name, at in times.items() if at]
    console.print(", ".join(known), markup=False)
    for action in job.actions:
        at = "" if action.seq is None else f", took effect at sample {action.seq}"
        console.print(
            f"{clock(action.requested_at)}  {action.type} by {action.by}{at}", markup=False
        )
    if job.allowed_actions:
        console.print(f"allowed actions: {', '.join(job.allowed_actions)}", markup=False)


@command(job_app, "show")
def show(target: Target, job: JobName, everything: Everything = False) -> None:
    """Show a job: its request, its result, its actions, and the files of its record."""
    handle = target.job(job)
    found = handle.job
    files = handle.artifacts() if found.record else []
    if target.json:
        emit({**tree(found), "files": tree(files)})
        return
    console = screen()
    show_job(found, console, everything=everything)
    if files:
        _show_record(handle, files, console)


def _show_record(job: "JobHandle", files: "list[Artifact]", console: "Console") -> None:
    """Print the files of a job's record, and the timing of the loop."""
    from pincette.api.live import LoopTiming
    from pincette.cli.rigs import timing_table
    from pincette.core.files import temporary_folder
    from pincette.records.folder import TIMING

    rows = [(file.name, size(file.bytes), file.sha256[:16]) for file in files]
    console.print()
    console.print(table("file", "size", "SHA-256", rows=rows, right=("size",)))
    if TIMING in [file.name for file in files]:
        with temporary_folder() as folder:
            timing = LoopTiming.model_validate_json(job.download(TIMING, folder).read_bytes())
        console.print(timing_table(timing))
    if job.job.record_detail:
        console.print(job.job.record_detail, markup=False)


def size(count: int) -> str:
    """Return a number of bytes as text with a suitable unit."""
    amount = float(count)
    for unit in ("B", "kB", "MB"):
        if amount < 1000.0:
            return f"{amount:.0f} {unit}" if unit == "B" else f"{amount:.1f} {unit}"
        amount /= 1000.0
    return f"{amount:.2f} GB"


add_to(job_app)
for _action, _about in ACTIONS.items():
    _add_action(_action, _about)


@command(app, "learning")
def learning(
    target: Target,
    erase: Annotated[
        str | None,
        Option(
            "--erase",
            metavar=f"PROGRAM|{ALL}",
            help=(
                "delete what this motion program has learned, or all; its next job starts "
                "without it"
            ),
        ),
    ] = None,
) -> None:
    """Show every motion program that has learned, with its error over the cycles; or erase what was
    learned.
    """
    if erase is not None:
        erased = target.rig().erase_learning(None if erase == ALL else erase)
        target.answer(erased, f"{erased.erased} erased")
        return
    found = target.rig().learning()
    rows = [
        (
            one.program,
            ", ".join(f"{name} {value}" for name, value in one.motion.items()),
            clock(one.learned_at),
            str(one.cycles) + (", over" if one.over else ""),
            " ".join(f"{error:.3f}" for error in one.errors_um),
        )
        for one in found.programs
    ]
    shown = table("program", "motion", "learned", "cycles", "error by cycle / µm", rows=rows)
    target.answer(found, shown if rows else "no motion program has learned anything yet")
