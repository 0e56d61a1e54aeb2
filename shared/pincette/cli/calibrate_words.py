"""The words of the command line that start a calibration."""

import argparse
from collections.abc import Callable, Mapping
from typing import NamedTuple

from pincette.cli.options import Words
from pincette.cli.readers import list_of, number

TEXT = "calibrate one thing of the rig; what it finds is proposed, and used once it is accepted"


class Wish(NamedTuple):
    """An option of a calibration: its unit, its meaning, and whether it is a list."""

    unit: str
    meaning: str
    listed: bool = False


CALIBRATIONS: Mapping[str, tuple[str, Mapping[str, Wish]]] = {
    "noise": (
        "noise, resolution and drift of the sensor, the arm at rest",
        {"duration_s": Wish("s", "time to read")},
    ),
    "free_response": (
        "gain, loop and creep of the free arm, and the model of both; take the part away",
        {
            "low_V": Wish("V", "lowest voltage of a grip"),
            "high_V": Wish("V", "highest voltage of a grip"),
            "rate_V_per_s": Wish("V/s", "peak rate of the fastest moves"),
        },
    ),
    "compliance": (
        "compliance of the arm by known weights, hung as it asks for them; take the part away",
        {
            "weights_mN": Wish("mN", "weights, ascending from 0", listed=True),
            "weight_uncertainty": Wish("", "of the weights, standard, as a share"),
        },
    ),
    "contact_stiffness": (
        "stiffness and place of the contact with the part, by a press at several levels",
        {
            "levels_V": Wish("V", "levels, peak to peak", listed=True),
            "load_s": Wish("s", "time to press"),
            "contact_force_mN": Wish("mN", "force that counts as a contact"),
        },
    ),
    "frequency_response": (
        "natural frequency and damping of the arm, by a sweep; take the part away",
        {
            "from_hz": Wish("Hz", "lowest frequency"),
            "to_hz": Wish("Hz", "highest frequency"),
            "duration_s": Wish("s", "time of the sweep"),
            "amplitude_V": Wish("V", "amplitude of the sweep"),
            "capture_hz": Wish("Hz", "rate of acquisition"),
        },
    ),
}
"""Every calibration with its meaning and its options; a test holds them to the requests."""
WISHES = tuple(
    dict.fromkeys(
        ["calibration", *(name for _, wishes in CALIBRATIONS.values() for name in wishes)]
    )
)


def add(word: Words, finish: Callable[[argparse.ArgumentParser], object]) -> None:
    """Add every calibration; ``finish`` adds what belongs to the command they stand in."""
    for name, (text, wishes) in CALIBRATIONS.items():
        one = word(name, text)
        for wish, (unit, meaning, listed) in wishes.items():
            read = number(unit)
            one.add_argument(
                f"--{wish.replace('_', '-')}",
                type=list_of(read) if listed else read,
                dest=wish,
                metavar=f"{unit},{unit},..." if listed else unit or "SHARE",
                help=f"{meaning}, in {unit}" if unit else meaning,
            )
        finish(one)
