"""``pincette init``: asks for the data of a bench, and writes its rig file."""

import json
import os
import sys
from collections.abc import Callable, Iterator
from inspect import Parameter
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

from typer import Argument, BadParameter, Option

from pincette.cli import CliError, Exit
from pincette.cli.catalogue import options_of
from pincette.cli.options import text_option
from pincette.cli.readers import literal, number
from pincette.cli.terminal import command, group, named
from pincette.config.bench_form import NUMBERED, Question, Value
from pincette.core import plugins
from pincette.core.files import sync_folder

FIRST_PORT = "/dev/ttyUSB0"
"""Port of an instrument if its driver states no typical url."""


SIDES = {
    "sensor": (plugins.POSITION_SENSORS, "the position sensor"),
    "output": (plugins.VOLTAGE_OUTPUTS, "the voltage output"),
}
app = group()
Answer = Callable[[Question], Value]


def pair(text: str) -> tuple[str, Value]:
    """Read a driver option in the form NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise BadParameter(f"{text!r} is not an option: give NAME=VALUE, such as baud=9600")
    return name, _value(name, value)


def _value(name: str, text: str) -> Value:
    found = literal(name, text)
    return found if isinstance(found, str | float | int | bool) else text


def _answers(given: dict[str, Any], *, ask: bool) -> Answer:
    """Return the function that answers a question: from its option, from a person, or by its
    default.
    """

    def answer(asked: Question) -> Value:
        value = given.get(asked.name)
        if value is not None:
            return value
        return _asked(asked) if ask else asked.default

    return answer


def _asked(asked: Question) -> Value:
    """Ask until the answer is valid; Enter selects the default."""
    unit = f" in {asked.unit}" if asked.unit else ""
    shown = f"{asked.words}{unit} ({asked.where})\n  [{asked.default}] "
    while True:
        try:
            text = input(shown).strip()
        except EOFError as error:
            raise CliError("the terminal was closed; nothing is written") from error
        if not text:
            return asked.default
        try:
            if not _numeric(asked):
                return _value_like(asked, text)
            value = number(asked.unit)(text)
        except BadParameter as error:
            print(f"  {error.message}")
            continue
        print(f"  = {value:g} {asked.unit}".rstrip())
        return value


def _numeric(asked: Question) -> bool:
    return isinstance(asked.default, float)


def _value_like(asked: Question, text: str) -> Value:
    return text if isinstance(asked.default, str) else _value(asked.name.split()[-1], text)


def _side(side: str, answer: Answer, given: dict[str, Any], values: dict[str, Value]) -> list[str]:
    """Ask for an instrument: driver, url, and the driver's own options; return those options."""
    from pincette.config.bench_form import SENSOR

    group_name, words = SIDES[side]
    there = plugins.names(group_name)
    choices = f"one of {', '.join(there)}; `pincette doctor --drivers` describes them"
    driver = str(answer(Question(side, f"driver of {words}", "", there[0], choices)))
    try:
        module = sys.modules[plugins.load(group_name, driver).__module__]
    except plugins.PluginError as error:
        raise CliError(f"--{side}: {error}", Exit.USAGE) from error
    values[side] = driver
    usual = str(getattr(module, "URL", FIRST_PORT))
    ports = ", ".join(str(port) for port in sorted(Path("/dev/serial/by-id").glob("*")))
    where = f"here: {ports}" if ports else "a device, or socket://HOST:PORT; see the driver's page"
    values[f"{side}_url"] = answer(Question(f"{side}_url", f"where {words} is", "", usual, where))
    if side == "sensor":
        values |= {one.name: answer(one) for one in SENSOR}
    own = dict(given.get(f"{side}_options") or [])
    options = list(_options(module, answer, own))
    if own:
        raise CliError(f"driver {driver} has no option {', '.join(own)}", Exit.USAGE)
    if side == "output":
        values["on_silence"] = _on_silence(dict(options), answer)
        values["step_V"] = getattr(module, "STEP_V", 0.0)
    return [f"{name} = {json.dumps(value, ensure_ascii=False)}" for name, value in options]


def _options(
    module: ModuleType, answer: Answer, own: dict[str, Value]
) -> Iterator[tuple[str, Value]]:
    """Yield the options of a driver with their values."""
    from pincette.asyncapi.schemas import notes

    for table, option, field in options_of(module):
        if option in own:
            yield option, own.pop(option)
            continue
        required = field.is_required()
        default: Value = "" if required else field.default
        about = notes(table).get(option, option).rstrip(".").lower()
        text = answer(Question(f"option {option}", f"{option}: {about}", "", default, "instrument"))
        if required and text == "":
            raise CliError(
                f"the driver needs its option {option} ({about}): give it as NAME=VALUE", Exit.USAGE
            )
        yield option, _value(option, str(text)) if required else text


def _on_silence(options: dict[str, Value], answer: Answer) -> Value:
    """Return the behaviour of the output if its host stops sending; the output is safe if it has a
    watchdog.
    """
    default = "safe" if options.get("watchdog_s") else "holds"
    words = "what the output does if its host sends nothing: safe, or holds"
    value = answer(Question("on_silence", words, "", default, "manual of the output"))
    if value not in ("safe", "holds"):
        raise CliError(f"on_silence = {value!r}: give safe or holds", Exit.USAGE)
    return value


def _options_of_side(side: str, words: str) -> list[Parameter]:
    """Return the command-line parameters of an instrument: driver, url, and the driver's own
    options.
    """
    about = f"option of the driver of {words}; repeatable"
    own = Option(f"--{side}-option", metavar="NAME=VALUE", parser=pair, help=about)
    return [
        text_option(side, "DRIVER", f"of {words}"),
        text_option(f"{side}_url", "URL", f"where {words} is"),
        named(f"{side}_options", Annotated[list[Any] | None, own]),
    ]


def _option(asked: Question) -> Parameter:
    unit = f", in {asked.unit}" if asked.unit else ""
    shown = Option(
        asked.flag,
        parser=number(asked.unit) if _numeric(asked) else str,
        metavar=asked.unit or "TEXT",
        help=f"{asked.words}{unit}; {asked.default} if not given",
        show_default=False,
    )
    return named(asked.name, Annotated[Any, shown])


@command(
    app,
    "init",
    [
        *(one for side, (_, words) in SIDES.items() for one in _options_of_side(side, words)),
        text_option("on_silence", "safe|holds", "what the output does without its host"),
        *map(_option, NUMBERED),
    ],
)
def init(
    path: Annotated[Path, Argument(metavar="FILE", help="rig file to write, such as bench.toml")],
    yes: Annotated[
        bool, Option("--yes", help="ask nothing: defaults where no option is given")
    ] = False,
    **given: Any,
) -> int:
    """Ask for the data of a bench, and write its rig file; nothing is overwritten."""
    from pincette.config import ConfigError
    from pincette.config.bench_form import ARM, PART, RIG, bench_file

    if path.exists():
        raise CliError(f"{path} exists already: name another file, or move it away")
    if not yes and not sys.stdin.isatty():
        raise CliError("no terminal for questions: --yes uses the defaults", Exit.USAGE)
    answer = _answers(given, ask=not yes)
    values: dict[str, Value] = {one.name: answer(one) for one in RIG}
    options = {side: _side(side, answer, given, values) for side in SIDES}
    values |= {one.name: answer(one) for one in (*ARM, *PART)}
    try:
        text = bench_file(values, options)
    except ConfigError as error:
        raise CliError(f"{error}\nnothing is written: answer again", Exit.USAGE) from error
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        sync_folder(path.absolute().parent)
    except OSError as error:
        raise CliError(f"{path} cannot be written ({error.strerror}): name another") from error
    print(f"{path} is written. Next:\n  export PINCETTE_RIG={path}\n  pincette doctor")
    return Exit.DONE
