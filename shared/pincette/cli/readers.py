"""Readers of arguments: numbers with units, levels, points, gains, labels and programs."""

import argparse
import math
from collections.abc import Callable

from pincette.service import composed_name

GAINS = ("K_P", "K_I", "K_S", "delta", "M", "B", "K", "K_f")


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


def list_of(read: Callable[[str], float]) -> Callable[[str], list[float]]:
    """Reader of several, with commas between."""
    return lambda text: [read(item) for item in text.split(",")]


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


def label(text: str) -> tuple[str, str]:
    """A label as NAME=TEXT."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"{text!r} is no label: give NAME=TEXT, such as part=b12")
    return name, value


def composed_program(text: str) -> str:
    """A program that composes services of the loop, by the name that it is known by."""
    try:
        return composed_name(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
