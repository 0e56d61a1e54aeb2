"""The words of the command line, and what each calls."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from pincette import __version__
from pincette.cli import (
    doctor,
    drivers,
    job,
    job_words,
    model,
    rig_file,
    rig_orders,
    stop,
    teach,
    topics,
    up,
)
from pincette.cli.job_words import JOB_ACTIONS, number
from pincette.cli.rest import DEFAULT_URL, CliError
from pincette.runtime.process import Options, programs, run_program

ABOUT = "Control position and contact force of a piezoelectric microgripper."
EXAMPLES = f"""\
to begin with:
  pincette demo                     a simulated rig grips a bead; nothing else is needed
  pincette up                       start a rig; then, in another terminal:
  pincette job grip --force-mN 15   grip its part, and follow it
  pincette job track --cycles 3     let position and force follow a path
  pincette job calibrate noise      find out what the rig is; `pincette model` shows the result
  pincette estop                    stop the rig at once; `pincette reset` clears the latch
  pincette doctor                   what is missing, and how to get it

The rig file is that of --rig, else of the environment variable {rig_file.VARIABLE},
else {rig_file.IN_A_CHECKOUT} in a checkout. `pincette COMMAND --help` says more of each.
"""


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    top = argparse.ArgumentParser(
        prog="pincette",
        description=ABOUT,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"pincette {__version__}")
    words = top.add_subparsers(dest="word", required=True, metavar="COMMAND")

    def rigged(name: str, text: str, *, records: bool = False) -> argparse.ArgumentParser:
        word = words.add_parser(name, help=text, description=text)
        word.add_argument("--rig", type=Path, metavar="FILE", help="rig file")
        if records:
            word.add_argument(
                "--data",
                type=Path,
                default=Path("data"),
                metavar="FOLDER",
                help="where records and logs go; %(default)s if not given",
            )
        return word

    rigged("up", "start every program of a rig on this machine; Ctrl-C ends them", records=True)
    rigged("demo", "start a rig, grip its part, show the result, end", records=True)
    ill = rigged("doctor", "say what is missing for a rig, and how to get it", records=True)
    ill.add_argument(
        "--move", action="store_true", help="ask, then move the arm a little: which way does it go"
    )
    rigged("topics", "list the keys of a rig and what goes over them")
    listing = "list the drivers of position sensors and voltage outputs, and their options"
    words.add_parser("drivers", help=listing, description=listing)
    jobs = words.add_parser("job", help="start a job and follow it, or act on one")
    job_words.add(jobs, _addressed)

    model.add(words.add_parser("model", help=model.ABOUT, description=model.ABOUT), _addressed)

    estop = rigged("estop", "stop the rig at once: REST first, then straight to the actuator")
    estop.add_argument("--url", help="of the supervisor; as the rig file says if not given")
    reset = words.add_parser("reset", help="clear the latch; its cause has been seen to")
    _addressed(reset)

    teaching = rigged("teach", "identify the free response of a rig's arm, nothing in its way")
    teaching.add_argument("--write", type=Path, metavar="OUT", help="write the table there too")
    teaching.add_argument(
        "--source",
        choices=("identified", "recorded"),
        default="identified",
        help="a model of hysteresis and creep, or the branches as recorded; %(default)s",
    )

    bench = rigged("rig", "operate a simulated rig: its part, weights, faults; alone: list them")
    bench.epilog, bench.formatter_class = (
        rig_orders.listing(),
        argparse.RawDescriptionHelpFormatter,
    )
    bench.add_argument("words", nargs="*", metavar="WORD", help="target, what, value")
    bench.add_argument(
        "--after-s", type=number("s"), default=0.0, metavar="s", help="from now on, in s"
    )
    bench.add_argument(
        "--for-s", type=number("s"), metavar="s", help="how long a fault lasts, in s"
    )

    study = rigged("paper", "repeat the paper's experiments on a simulated rig; some minutes")
    study.add_argument(
        "--out", type=Path, default=Path("data/paper"), metavar="FOLDER", help="%(default)s"
    )
    study.add_argument(
        "--rigs", type=int, default=20, metavar="N", help="drawn at random; %(default)s"
    )

    run = rigged("run", "run one program of a rig in the foreground", records=True)
    run.add_argument("name", choices=programs(), metavar="NAME", help=", ".join(programs()))
    run.add_argument("--leash", action="store_true", help="end when standard input closes")
    run.add_argument("--delay-ms", type=number("ms"), default=0.0, help=argparse.SUPPRESS)
    run.add_argument("--delay-seed", type=int, default=0, help=argparse.SUPPRESS)
    return top


def _addressed(word: argparse.ArgumentParser) -> None:
    word.add_argument(
        "--url", default=DEFAULT_URL, help="of the supervisor; %(default)s if not given"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    reconfigure = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        # A terminal that cannot show µ is no reason to fail.
        reconfigure(errors="replace")
    given = parser().parse_args(arguments)
    try:
        if "rig" in given:
            given.rig = rig_file.chosen(given.rig)
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
            return doctor.doctor(given.rig, given.data, move=given.move)
        case "topics":
            return topics.topics(given.rig)
        case "drivers":
            return drivers.drivers()
        case "teach":
            return teach.teach(given.rig, given.write, given.source)
        case "rig":
            return rig_orders.order(given.rig, given.words, given.after_s, given.for_s)
        case "paper":
            # It draws: nothing else waits for the drawing library.
            from pincette.cli import paper

            return paper.paper(given.rig, given.out, given.rigs)
        case "model":
            return model.model(given)
        case "estop":
            return stop.estop(given.rig, given.url)
        case "reset":
            return stop.reset(given.url)
        case _:
            return _job(given)


def _job(given: argparse.Namespace) -> int:
    if given.kind in JOB_ACTIONS:
        return job.act(given.url, given.kind, given.name)
    return job.start(given.url, given.kind, job_words.wishes(given), dry_run=given.dry_run)
