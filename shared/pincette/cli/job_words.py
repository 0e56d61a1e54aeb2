"""The words that say what a job shall do: every kind with its options."""

import argparse
from collections.abc import Callable, Mapping
from typing import Any, get_args

from pincette.cli import calibrate_words
from pincette.cli.options import Words, words
from pincette.cli.readers import gains, label, list_of, number, points
from pincette.control.laws.law import ParameterSet, Scheme
from pincette.control.planning.paths import Shape

UNITS = {
    "_um_per_s": "µm/s",
    "_um_per_s2": "µm/s²",
    "_V_per_s": "V/s",
    "_mN": "mN",
    "_um": "µm",
    "_hz": "Hz",
    "_V": "V",
    "_s": "s",
}
TEXTS = {
    "grip": "grip the part of the rig file; what is not given is as the file says",
    "track": "grip the part of the rig file and let position and force follow a path; "
    "what is not given is as the file says",
    "move": "move the free arm to a position or a voltage, and let it rest there",
    "hold": "go on holding what is in the gripper, after a stop or a reset",
    "release": "let go of what is in the gripper",
}
NUMBERS: Mapping[str, Mapping[str, str]] = {
    "grip": {"force_mN": "force to hold", "hold_s": "time to hold it", "load_s": "time to load"},
    "track": {
        "force_mean_mN": "mean force of a swing",
        "force_pp_mN": "its force, peak to peak",
        "x_pp_um": "its position, peak to peak, instead of the force",
        "frequency_hz": "its frequency",
        "dwell_s": "time to stay at each level",
        "load_s": "time to load",
        "rate_um_per_s": "highest speed along the path",
        "acceleration_um_per_s2": "highest acceleration along the path",
    },
    "move": {
        "to_um": "where to, by the law",
        "by_um": "how far from here, by the law",
        "to_V": "voltage to go to, without a law",
        "by_V": "voltage to go on by, without a law",
        "speed_um_per_s": "highest speed",
        "warm_up_s": "time to cycle the voltage before, to warm up",
        "low_V": "lowest voltage of the cycles",
        "high_V": "highest voltage of the cycles",
        "rate_V_per_s": "highest rate of the cycles",
    },
    "hold": {"hold_s": "time to hold", "release_s": "time to let go"},
    "release": {"release_s": "time to let go"},
}
OTHERS = ("shape", "cycles", "levels_mN", "points", "scheme", "set", "gains")
MOVES = ("conditioning_cycles", "zero", "teach")
POLICIES = ("until_released", "on_stop", "on_abort", "recipe", "queue", "labels")
WISHES = (
    *dict.fromkeys(name for numbers in NUMBERS.values() for name in numbers),
    *(name for name in calibrate_words.WISHES),
    *(*OTHERS, *MOVES, *POLICIES),
)


def add(word: Words, finish: Callable[[argparse.ArgumentParser], object]) -> None:
    """Add every kind of job; ``finish`` adds what belongs to the command they stand in."""
    for kind, text in TEXTS.items():
        one = word(kind, text)
        one.set_defaults(kind=kind)
        _numbers(one, NUMBERS[kind])
        if kind == "track":
            _path(one)
        if kind in ("grip", "track"):
            _law(one)
            one.add_argument(
                "--recipe", metavar="NAME[@N]", help="part recipe that completes the request"
            )
        if kind == "move":
            _move(one)
        if kind in ("grip", "track", "hold"):
            _policies(one)
        if kind in ("grip", "hold"):
            one.add_argument(
                "--until-released",
                action="store_true",
                default=None,
                help="hold until the action release",
            )
        finish(one)
    calibrate = word("calibrate", calibrate_words.TEXT)
    calibrate.set_defaults(kind="calibrate")
    add_calibrations(calibrate, finish)


def add_calibrations(
    word: argparse.ArgumentParser, finish: Callable[[argparse.ArgumentParser], object]
) -> None:
    """Add every calibration below a word."""
    calibrate_words.add(words(word, "calibration", "CALIBRATION"), finish)


def wishes(given: argparse.Namespace) -> dict[str, Any]:
    """Members of the request that were given."""
    values = vars(given)
    found = {name: values[name] for name in WISHES if values.get(name) is not None}
    if "labels" in found:
        found["labels"] = dict(found["labels"])
    return found


def _numbers(word: argparse.ArgumentParser, wishes: Mapping[str, str]) -> None:
    for name, meaning in wishes.items():
        unit = next(unit for suffix, unit in UNITS.items() if name.endswith(suffix))
        word.add_argument(
            f"--{name.replace('_', '-')}",
            type=number(unit),
            dest=name,
            metavar=unit,
            help=f"{meaning}, in {unit}",
        )


def _path(word: argparse.ArgumentParser) -> None:
    word.add_argument("--shape", choices=get_args(Shape), help="of the path")
    word.add_argument("--cycles", type=int, metavar="N", help="cycles at full amplitude")
    word.add_argument(
        "--levels-mN",
        type=list_of(number("mN")),
        dest="levels_mN",
        metavar="mN,mN,...",
        help="forces of a step path",
    )
    word.add_argument(
        "--points", type=points, metavar="s:mN,...", help="times and forces of waypoints, from 0 s"
    )


def _law(word: argparse.ArgumentParser) -> None:
    word.add_argument("--scheme", choices=get_args(Scheme), help="of the law")
    word.add_argument(
        "--set", choices=get_args(ParameterSet), help="whose m, b, k, d the law works with"
    )
    word.add_argument(
        "--gains", type=gains, metavar="tuned|K_P=...", help="searched for, or given one by one"
    )


def _move(word: argparse.ArgumentParser) -> None:
    word.add_argument(
        "--conditioning-cycles", type=int, metavar="N", help="full cycles of voltage before"
    )
    word.add_argument(
        "--no-zero", dest="zero", action="store_false", default=None, help="do not zero the force"
    )
    word.add_argument("--teach", metavar="NAME", help="state the pose that is reached by this name")


def _policies(word: argparse.ArgumentParser) -> None:
    word.add_argument(
        "--on-stop", choices=("hold", "release", "retract"), help="what a stop does to a held part"
    )
    word.add_argument(
        "--on-abort", choices=("freeze", "ramp"), help="what an abort does to a held part"
    )


def taking(word: argparse.ArgumentParser) -> None:
    """Say how a job is taken: at once or in its turn, and with which labels."""
    word.add_argument(
        "--queue", action="store_true", default=None, help="wait for the job that has the rig"
    )
    word.add_argument(
        "--label",
        type=label,
        action="append",
        dest="labels",
        metavar="NAME=TEXT",
        help="kept with the job; may be given again",
    )
