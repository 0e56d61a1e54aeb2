"""Words of the command line, and what each calls."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from pincette import __version__
from pincette.cli import doctor, job, teach, topics, up
from pincette.cli.rest import DEFAULT_URL, CliError
from pincette.runtime.process import Options, programs, run_program

DEMO_RIG = Path("deploy/rigs/demo.toml")


def _number(text: str) -> float:
    value = float(text)
    if not value == value or value in (float("inf"), float("-inf")):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number")
    return value


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    top = argparse.ArgumentParser(prog="pincette", description=__doc__)
    top.add_argument("--version", action="version", version=f"pincette {__version__}")
    words = top.add_subparsers(dest="word", required=True, metavar="COMMAND")

    def rigged(name: str, text: str) -> argparse.ArgumentParser:
        word = words.add_parser(name, help=text, description=text)
        word.add_argument("--rig", type=Path, default=DEMO_RIG, metavar="FILE", help="rig file")
        word.add_argument("--data", type=Path, default=Path("data"), metavar="FOLDER")
        return word

    rigged("up", "start every program of a rig on this machine; Ctrl-C ends them")
    rigged("demo", "start the demo rig, grip its bead, show the result, end")
    rigged("doctor", "say what is missing for this rig, and how to get it")
    rigged("topics", "list the keys of a rig and who publishes them")

    teaching = rigged("teach", "identify the free response of a rig's arm, nothing in its way")
    teaching.add_argument("--write", type=Path, metavar="OUT", help="write the table there too")

    run = rigged("run", "run one program of a rig in the foreground")
    run.add_argument("name", choices=programs(), metavar="NAME", help=", ".join(programs()))
    run.add_argument("--leash", action="store_true", help="end when standard input closes")
    run.add_argument("--delay-ms", type=_number, default=0.0, help=argparse.SUPPRESS)
    run.add_argument("--delay-seed", type=int, default=0, help=argparse.SUPPRESS)

    stop = rigged("estop", "stop the rig at once: REST first, then straight to the actuator")
    stop.add_argument("--url", default=None, help="of the supervisor")
    reset = words.add_parser("reset", help="clear a latched rig, acknowledging the cause")
    reset.add_argument("--url", default=DEFAULT_URL)

    jobs = words.add_parser("job", help="start a job and follow it")
    kinds = jobs.add_subparsers(dest="kind", required=True, metavar="KIND")
    grip = kinds.add_parser("grip", help="grip the part of the rig file")
    grip.add_argument("--url", default=DEFAULT_URL, help="of the supervisor")
    grip.add_argument("--force-mN", type=_number, dest="force_mN")
    grip.add_argument("--hold-s", type=_number, dest="hold_s")
    grip.add_argument("--load-s", type=_number, dest="load_s")
    grip.add_argument("--dry-run", action="store_true", help="plan and predict only")
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    given = parser().parse_args(arguments)
    try:
        return _call(given)
    except CliError as error:
        sys.stderr.write(f"pincette: {error}\n")
        return 1
    except KeyboardInterrupt:
        return 130


def _call(given: argparse.Namespace) -> int:
    match given.word:
        case "run":
            options = Options(given.data, given.leash, given.delay_ms / 1e3, given.delay_seed)
            return run_program(given.name, given.rig, options)
        case "up":
            return up.up(given.rig, given.data)
        case "demo":
            return up.demo(given.rig, given.data)
        case "doctor":
            return doctor.doctor(given.rig)
        case "topics":
            return topics.topics(given.rig)
        case "teach":
            return teach.teach(given.rig, given.write)
        case "estop":
            return job.estop(given.rig, given.url)
        case "reset":
            return job.reset(given.url)
        case _:
            wishes = {name: getattr(given, name) for name in ("force_mN", "hold_s", "load_s")}
            return job.grip(
                given.url,
                {name: value for name, value in wishes.items() if value is not None},
                dry_run=given.dry_run,
            )
