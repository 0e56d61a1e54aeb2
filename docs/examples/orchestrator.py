"""Pick parts one after the other, hold each while the cell works on it, and release it.

    python docs/examples/orchestrator.py --parts 3 --force-mN 15

The exit status is 0 if every part was gripped and released, 1 if one was not, 4 if a person must
inspect the rig first, and 130 after Ctrl-C, which stops the job and keeps its part held.
"""

import argparse
import sys
import time
from uuid import uuid4

from pincette.client import ClientError, JobHandle, ProblemError, RigHandle, Supervisor

DONE, FAILED, PERSON_NEEDED, INTERRUPTED = 0, 1, 4, 130
BUSY_S = 2.0
"""Time to wait while another job uses the rig, in s."""


class PartError(Exception):
    """Error for a part that was not gripped, or was lost.

    The rig can continue with the next one.
    """


def start(rig: RigHandle, part: str, force_mN: float) -> JobHandle:
    """Start a grip that holds until it is released.

    The idempotency key makes a retry safe: a second request for the same part returns the same job.
    """
    while True:
        try:
            return rig.start("grip", force_mN=force_mN, until_released=True, idempotency_key=part)
        except ProblemError as problem:
            if problem.code not in ("job-active", "part-held"):
                raise
            print(f"{part}: waits, {problem.detail}")
            time.sleep(BUSY_S)


def await_hold(job: JobHandle) -> None:
    """Follow a job until its hold begins; a lost connection is opened again."""
    for event in job.events():
        if event.kind == "phase":
            print(f"{job.id}: {event.body['phase']}")
            if event.body["phase"] == "hold":
                return
    raise PartError(f"ended before its hold: {job.refresh().cause or job.state}")


def work(part: str, duration_s: float) -> None:
    """Simulate the work of the cell on a held part."""
    print(f"{part}: held; the cell works for {duration_s:g} s")
    time.sleep(duration_s)


def let_go(job: JobHandle) -> None:
    """Release the part and wait for the end; the job of a lost part has ended already."""
    try:
        job.release()
    except ProblemError as problem:
        if problem.code != "invalid-transition":
            raise
    job.wait(timeout_s=60.0)


def handle(rig: RigHandle, part: str, force_mN: float, work_s: float) -> str:
    """Pick, hold and release one part; return the result as text."""
    job = start(rig, part, force_mN)
    try:
        await_hold(job)
        work(part, work_s)
        let_go(job)
    except KeyboardInterrupt:
        job.stop()  # a held part stays held: a person decides what to do with it
        raise
    if job.state != "succeeded":
        raise PartError(f"{job.state}: {job.job.cause}")
    found = job.job.result or {}
    return f"{found['outcome']}, peak force {found['peak_force_mN']:.2f} mN, job {job.id}"


def handle_all(rig: RigHandle, parts: int, force_mN: float, work_s: float) -> int:
    """Handle parts one after the other; return how many were not gripped, or were lost."""
    failed, run = 0, uuid4().hex[:8]
    for number in range(1, parts + 1):
        part = f"{run}-part-{number}"
        try:
            print(f"{part}: {handle(rig, part, force_mN, work_s)}")
        except PartError as error:
            failed += 1
            print(f"{part}: {error}", file=sys.stderr)
    return failed


def main() -> int:
    """Handle some parts; the exit status is for the cell's controller."""
    words = argparse.ArgumentParser()
    words.add_argument("--url", default="http://127.0.0.1:8000")
    words.add_argument("--parts", type=int, default=1)
    words.add_argument("--force-mN", type=float, default=15.0, dest="force_mN")
    words.add_argument("--work-s", type=float, default=1.0)
    words.add_argument("--patience-s", type=float, default=30.0)
    given = words.parse_args()
    try:
        with Supervisor(given.url, patience_s=given.patience_s, operator="cell 1") as supervisor:
            rig = supervisor.rig()
            failed = handle_all(rig, given.parts, given.force_mN, given.work_s)
    except KeyboardInterrupt:
        return INTERRUPTED
    except ClientError as error:
        print(f"a person is needed: {error}", file=sys.stderr)
        return PERSON_NEEDED
    return FAILED if failed else DONE


if __name__ == "__main__":
    sys.exit(main())
