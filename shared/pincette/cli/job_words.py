"""The words of the command line that start a job or act on one."""

import argparse
import math
from collections.abc import Callable
from typing import Any, get_args

from pincette.cli import calibrate_words
from pincette.control.laws.law import ParameterSet, Scheme
from pincette.control.planning.paths import Shape

JOB_ACTIONS = {
    "stop": "stop a job; a held part stays held",
    "abort": "abort a job: the actuator goes to its safe state and latches",
    "release": "let the part of a job go",
    "continue": "go on with a job that waits for you",
}
GRIP_TEXT = "grip the part of the rig file; what is not given is as the file says"
TRACK_TEXT = (
    "grip the part of the rig file and let position and force follow a path; "
    "what is not given is as the file says"
)
UNITS = {
    "_um_per_s": "µm/s",
    "_um_per_s2": "µm/s²",
    "_mN": "mN",
    "_um": "µm",
    "_hz": "Hz",
    "_s": "s",
}
GRIP = {"force_mN": "force to hold", "hold_s": "time to hold it", "load_s": "time to load"}
TRACK = {
    "force_mean_mN": "mean force of a swing",
    "force_pp_mN": "its force, peak to peak",
    "x_pp_um": "its position, peak to peak, instead of the force",
    "frequency_hz": "its frequency",
    "dwell_s": "time to stay at each level",
    "load_s": "time to load",
    "rate_um_per_s": "highest speed along the path",
    "acceleration_um_per_s2": "highest acceleration along the path",
}
GAINS = ("K_P", "K_I", "K_S", "delta", "M", "B", "K", "K_f")
WISHES = (
    *dict.fromkeys((*GRIP, *TRACK, *calibrate_words.WISHES)),
    *("shape", "cycles", "levels_mN", "points", "scheme", "set", "gains"),
)


def number(unit: str) -> Callable[[str], float]:
    """Reader of an argument that must be a finite number of a unit, or of none."""
    value_of, number_of = (f" {unit}", f" of {unit}") if unit else ("", "")

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise argparse.ArgumentTypeError(
                f"{text!r}{value_of} cannot be used: give a finite number{number_of}, such as 15"
            )
        return value

    return read


def levels(text: str) -> list[float]:
    """Forces in mN, with commas between."""
    return [number("mN")(level) for level in text.split(",")]


def points(text: str) -> list[dict[str, float]]:
    """Times and forces as s:mN, with commas between."""
    found: list[dict[str, float]] = []
    for point in text.split(","):
        t_s, colon, force_mN = point.partition(":")
        if not colon:
            raise argparse.ArgumentTypeError(
                f"{point!r} is no point: give s:mN, such as 0:5,1.5:12,3:5"
            )
        found.append({"t_s": number("s")(t_s), "force_mN": number("mN")(force_mN)})
    return found


def add(jobs: argparse.ArgumentParser, address: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add every kind of job and every action; ``address`` adds where the supervisor is."""
    kinds = jobs.add_subparsers(dest="kind", required=True, metavar="KIND")
    grip = kinds.add_parser("grip", help=GRIP_TEXT, description=GRIP_TEXT)
    address(grip)
    _numbers(grip, GRIP)
    _law(grip)
    _dry_run(grip)
    track = kinds.add_parser("track", help=TRACK_TEXT, description=TRACK_TEXT)
    address(track)
    track.add_argument("--shape", choices=get_args(Shape), help="of the path")
    _numbers(track, TRACK)
    track.add_argument("--cycles", type=int, metavar="N", help="cycles at full amplitude")
    track.add_argument(
        "--levels-mN",
        type=levels,
        dest="levels_mN",
        metavar="mN,mN,...",
        help="forces of a step path",
    )
    track.add_argument(
        "--points", type=points, metavar="s:mN,...", help="times and forces of waypoints, from 0 s"
    )
    _law(track)
    _dry_run(track)
    text = calibrate_words.TEXT
    calibrate = kinds.add_parser("calibrate", help=text, description=text)
    calibrate_words.add(calibrate, address, number)
    for action, meaning in JOB_ACTIONS.items():
        word = kinds.add_parser(action, help=meaning, description=meaning)
        word.add_argument("name", metavar="JOB", help="its id")
        address(word)


def _numbers(word: argparse.ArgumentParser, wishes: dict[str, str]) -> None:
    for name, meaning in wishes.items():
        unit = next(unit for suffix, unit in UNITS.items() if name.endswith(suffix))
        word.add_argument(
            f"--{name.replace('_', '-')}",
            type=number(unit),
            dest=name,
            metavar=unit,
            help=f"{meaning}, in {unit}",
        )


def gains(text: str) -> dict[str, float] | str:
    """Gains as K_P=0.5,K_f=4000, or the word ``tuned``."""
    if text == "tuned":
        return text
    found: dict[str, float] = {}
    for gain in text.split(","):
        name, equals, value = gain.partition("=")
        if not equals or name not in GAINS:
            raise argparse.ArgumentTypeError(
                f"{gain!r} is no gain: give tuned, or some of {', '.join(GAINS)} "
                "such as K_P=0.5,K_f=4000"
            )
        found[name] = number("")(value)
    return found


def _law(word: argparse.ArgumentParser) -> None:
    word.add_argument("--scheme", choices=get_args(Scheme), help="of the law")
    word.add_argument(
        "--set", choices=get_args(ParameterSet), help="whose m, b, k, d the law works with"
    )
    word.add_argument(
        "--gains", type=gains, metavar="tuned|K_P=...", help="searched for, or given one by one"
    )


def _dry_run(word: argparse.ArgumentParser) -> None:
    word.add_argument("--dry-run", action="store_true", help="plan and predict only")


def wishes(given: argparse.Namespace) -> dict[str, Any]:
    """Members of the request that were given."""
    values = vars(given)
    return {name: values[name] for name in WISHES if values.get(name) is not None}
