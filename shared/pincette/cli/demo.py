"""``pincette demo``: one complete grip on a simulated rig, with its record."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from pincette.cli import opened
from pincette.cli.access import authority_of, key_of, refusals
from pincette.cli.options import DATA, DataFolder, Everything
from pincette.cli.results import show_result
from pincette.cli.safety import cleared
from pincette.cli.terminal import Json, RigOption, command, emit, group, lasting_screen
from pincette.cli.up import NewArm, forget_arm, running
from pincette.cli.watch import follow_recorded, status_of
from pincette.core.faults import Cause, FaultCode

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.jobs import Job
    from pincette.client import RigHandle
    from pincette.config import RigFile

app = group()


@command(app, "demo")
def demo(
    rig: RigOption,
    form: Json,
    data: DataFolder = DATA,
    secure: Annotated[
        bool, Option("--secure", help="over mutual TLS, with temporary certificates")
    ] = False,
    new_arm: NewArm = False,
    everything: Everything = False,
) -> int:
    """Grip the part of a rig once, from start to end."""
    path = rig.path
    file = opened(path)
    if new_arm:
        forget_arm(file, data)
    with lasting_screen(machine=form.json) as console:
        job = _gripped(file, path, data, console, form, secure=secure)
        if not form.json:
            more = "report.html in the record; `pincette demo --all` prints them"
            show_result(job, console, everything=everything, more=more)
    if form.json:
        emit(job)
    return status_of(job)


def _gripped(
    file: "RigFile", path: Path, data: Path, console: "Console", form: Json, *, secure: bool
) -> "Job":
    """Start the rig, grip its part, end the rig, and return the job."""
    from pincette.client import Supervisor

    with ExitStack() as stack:
        if secure:
            from pincette.cli import security

            file = file.secured(stack.enter_context(security.temporary_certificates(file)))
        stack.enter_context(running(file, path, data, console))
        stack.enter_context(refusals(file.supervisor.url, as_json=form.json))
        authority = authority_of(None, file.bus.pki)
        supervisor = stack.enter_context(
            Supervisor(file.supervisor.url, key=key_of(None), authority=authority)
        )
        handle = supervisor.rig(file.rig.name)
        if file.simulation is None:
            job = follow_recorded(handle.start("grip"), console)
        else:
            job = grip_simulated(handle, console)
    return job


def grip_simulated(rig: "RigHandle", console: "Console") -> "Job":
    """Grip on a simulated rig; its latch is cleared without a person.

    A latch or a held part left by an earlier demo is cleared. The grip is repeated once if this
    machine stalled during the first one, which delays a command so that the actuator trips.
    """
    if rig.state().latch.state in ("latched", "ramping"):
        clear(rig, console)
    job = follow_recorded(rig.start("grip"), console)
    if not tripped_by_age(job):
        return job
    console.print(f"{job.cause}\nthis rig is simulated: the demo tries again", style="yellow")
    clear(rig, console)
    return follow_recorded(rig.start("grip"), console)


def clear(rig: "RigHandle", console: "Console") -> None:
    """Clear the latch of a simulated rig, and print a line that states this."""
    _, cause = cleared(rig)
    console.print(f"this rig is simulated: its latch is cleared ({cause})", style="yellow")


def tripped_by_age(job: "Job") -> bool:
    """Return True if a late command is the only reason why the actuator tripped."""
    ending = job.ending
    return (
        ending is not None
        and ending.trip == Cause.COMMAND_AGE
        and [one.code for one in ending.faults] == [FaultCode.NO_COMMAND]
    )
