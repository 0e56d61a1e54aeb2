"""`pincette rig`: what a person does at the bench of a simulated rig, and faults that befall it."""

import argparse
import math
from dataclasses import asdict
from pathlib import Path

from pincette.bus.places import tool_place
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli.options import Words, does, machine, rigged
from pincette.cli.output import emit
from pincette.cli.readers import number
from pincette.cli.rest import CliError
from pincette.cli.rig_file import opened
from pincette.config.script import DEEDS, Deed, objection
from pincette.messages import Order
from pincette.security.identity import SecurityError
from pincette.topics import ORDER

ABOUT = "operate a simulated rig: its part, weights, faults; alone: list them"
EXAMPLES = """\
examples:
  pincette rig part remove
  pincette rig weight 5
  pincette rig sensor stuck --for-s 1
  pincette rig arm hysteresis 2
  pincette rig output heal

A rig takes orders where its file says `scripts = true` in [simulation].
"""


def add(word: Words) -> None:
    """Add ``rig``."""
    one = machine(rigged(word("rig", ABOUT)))
    one.epilog, one.formatter_class = listing(), argparse.RawDescriptionHelpFormatter
    one.add_argument("words", nargs="*", metavar="WORD", help="target, what, value")
    one.add_argument(
        "--after-s", type=number("s"), default=0.0, metavar="s", help="from now on, in s"
    )
    one.add_argument("--for-s", type=number("s"), metavar="s", help="how long a fault lasts, in s")
    does(one, _given)


def _given(given: argparse.Namespace) -> int:
    if not given.json:
        return order(given.rig, given.words, given.after_s, given.for_s)
    if not given.words:
        emit(
            [dict(zip(("target", "what", "value", "meaning"), row, strict=True)) for row in rows()]
        )
        return 0
    wanted = give(given.rig, given.words, given.after_s, given.for_s)
    emit(asdict(wanted))
    return 0


def order(rig_path: Path, words: list[str], after_s: float, for_s: float | None) -> int:
    """Give one order to a rig that is up; without words, list what there is."""
    if not words:
        print(listing())
        return 0
    give(rig_path, words, after_s, for_s)
    print(f"{' '.join(words)}: done" if not after_s else f"{' '.join(words)}: in {after_s:g} s")
    return 0


def give(rig_path: Path, words: list[str], after_s: float, for_s: float | None) -> Order:
    """Give an order to a rig that is up, and return it."""
    wanted = read(words, after_s, for_s)
    rig = opened(rig_path)
    if rig.simulation is None:
        raise CliError(f"rig {rig.rig.name!r} is real: do at its bench what you want done")
    try:
        bus = ZenohBus(tool_place(rig), rig.rig.name, "orders")
    except SecurityError as error:
        raise CliError(str(error)) from error
    except BusError as error:
        raise CliError(f"{error}\nIs the rig up? `pincette up` starts it") from error
    try:
        bus.ask(ORDER, wanted)
    except BusError as error:
        raise CliError(f"{' '.join(words)}: {error}") from error
    finally:
        bus.close()
    return wanted


def read(words: list[str], after_s: float, for_s: float | None) -> Order:
    """Make an order of words; a target that knows one thing needs no name for it."""
    target, *rest = words
    deeds = DEEDS.get(target, ())
    if len(deeds) == 1 and rest and rest[0] != deeds[0].what:
        rest = [deeds[0].what, *rest]
    if len(rest) > 2:
        raise CliError(f"{' '.join(words)}: {len(words)} words; TARGET WHAT VALUE at most")
    what, value = (*rest, "", "")[:2]
    wanted = Order(target, what, _number(value) if value else None, after_s, for_s)
    if trouble := objection(wanted):
        raise CliError(f"{trouble}; `pincette rig` lists what there is")
    return wanted


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CliError(f"{text!r} is no value: give a finite number, such as 5")
    return value


def rows() -> list[tuple[str, str, str, str]]:
    """Target, what, value and meaning of everything there is."""
    return [
        (target, deed.what, value_words(deed), deed.meaning)
        for target, deeds in DEEDS.items()
        for deed in deeds
    ]


def value_words(deed: Deed) -> str:
    """What the value of a deed is, and its bounds; empty where it takes none."""
    if not deed.valued:
        return ""
    kept = "" if deed.default is None else f"; {deed.default:g} if not given"
    return f"{deed.quantity} ({deed.least:g} to {deed.most:g}{kept})"


def listing() -> str:
    """The table of everything there is, a line each."""
    table = rows()
    widths = [max(len(row[column]) for row in table) for column in range(2)]
    lines = [
        f"  {target:<{widths[0]}}  {what:<{widths[1]}}  {meaning}{f'; {value}' if value else ''}"
        for target, what, value, meaning in table
    ]
    return "\n".join(["what can be done to a simulated rig:", *lines, "", EXAMPLES.rstrip()])
