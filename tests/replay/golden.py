"""Make the record that is stored in the tree: a second grip of the demo rig, released by hand.

python -m tests.replay.golden

Run it again only if a service is meant to give other numbers, or a record to contain other data;
older records must remain readable.
"""

import sys
from pathlib import Path

from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.replay.desk import Desk, at, recorded
from tests.support.rigs import demo_rig

FOLDER = Path(__file__).parent / "golden"
EPOCH = 2


def make(folder: Path) -> None:
    """Play the job and write ``job.mcap``."""
    desk = Desk(demo_rig(time="lockstep"))
    short = GripJobRequest(kind="grip", profile="gentle", hold_s=0.2, load_s=0.3)
    desk.play(plan_job(short, desk.rig).program, 1)
    held = GripJobRequest(kind="grip", profile="gentle", until_released=True, load_s=0.3)
    let_go = at("hold", 5, lambda desk: desk.act("release"))
    messages = desk.play(plan_job(held, desk.rig).program, EPOCH, let_go)
    recorded(folder, desk.rig, messages, EPOCH)


if __name__ == "__main__":
    (FOLDER / "job.mcap").unlink(missing_ok=True)
    make(FOLDER)
    sys.stdout.write(f"{FOLDER / 'job.mcap'}\n")
