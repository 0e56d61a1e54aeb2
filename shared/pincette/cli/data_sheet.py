"""``pincette data-sheet``: measures the data sheet of a gripper, and saves it."""

from pathlib import Path
from typing import Annotated, Any

from typer import Option

from pincette.cli import Exit
from pincette.cli.access import FOLLOWED_S, Target
from pincette.cli.records import Out
from pincette.cli.terminal import command, group, patience, screen
from pincette.cli.watch import follow_recorded, status_of

NAMES = ("datasheet.html", "datasheet.pdf", "datasheet.json")

app = group()


@command(app, "data-sheet")
def data_sheet(
    target: Target,
    force_mN: Annotated[
        float | None, Option("--force", metavar="MN", help="highest force on the part, in mN")
    ] = None,
    noise_s: Annotated[
        float | None, Option("--noise", metavar="S", help="duration of each noise measurement")
    ] = None,
    grips: Annotated[
        int | None, Option("--grips", metavar="N", help="number of grips for the zero return")
    ] = None,
    out: Out = None,
) -> int:
    """Measure the data sheet of a gripper with the part in place, and save its files."""
    members: dict[str, Any] = {"force_mN": force_mN, "noise_s": noise_s, "grips": grips}
    given = {name: value for name, value in members.items() if value is not None}
    job = target.rig().patient(FOLLOWED_S).start("characterise", **given)
    follow_recorded(job, screen())
    names = {file.name for file in job.artifacts()}
    with patience("downloading the data sheet"):
        paths = [job.download(name, out or Path(job.id)) for name in NAMES if name in names]
    shown = [str(path) for path in paths]
    target.answer(shown, "\n".join(shown))
    status = status_of(job.job)
    return Exit.FAILED if not paths and status == Exit.DONE else status
