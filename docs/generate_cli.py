"""Write docs/reference/cli.md from the command line itself: ``python docs/generate_cli.py``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.core import TyperGroup

from pincette.cli import MEANINGS
from pincette.cli.job import JobKinds
from pincette.cli.main import COMMANDS, load

PAGE = Path(__file__).resolve().parent / "reference" / "cli.md"
HEAD = """\
# Command line

Generated from `pincette.cli`; a test compares the two. `pincette COMMAND --help` prints the same
text.

Every command that calls a supervisor takes `--url`, `--key`, `--authority`, `--rig-name` and
`--json`. With `--json`, standard output is exactly one JSON document. A refusal is then the problem
document (RFC 9457), and its text goes to standard error as always. `watch --json` prints one event
per line.
A progress bar appears only in a terminal; elsewhere a followed job prints one line for each phase.
`JOB` is the id of a job, or `last`. Options cannot be abbreviated.
`pincette --install-completion` lets the shell complete commands and options.

## Exit status

| status | meaning |
| --- | --- |
"""
LIKE_A_JOB = {
    "plan": "Kinds and options are those of `pincette job KIND`, without `--queue`, `--label` and "
    "`--no-wait`.\nFor a grip, a track or a move, `--plot FILE` draws the prediction "
    "as PNG.",
}
"""Commands whose options are listed in another section."""
COMMON = {"url", "key", "authority", "rig_name", "json", "help"}


def page() -> str:
    """Return the whole page as Markdown."""
    statuses = "".join(f"| {status.value} | {text} |\n" for status, text in MEANINGS.items())
    commands = (part for name in COMMANDS for part in _command(f"pincette {name}", load(name)))
    return HEAD + statuses + "".join(commands)


def _command(path: str, command: Any) -> Iterator[str]:
    depth = "##" if path.count(" ") == 1 else "###"
    heading = " ".join([path, *_arguments(command)])
    yield f"\n{depth} `{heading}`\n\n{_sentence(command.help)}\n"
    if not isinstance(command, TyperGroup):
        yield from _options(command)
        return
    name = path.split()[1]
    if name in LIKE_A_JOB:
        yield f"\n{LIKE_A_JOB[name]}\n"
        return
    if isinstance(command, JobKinds):
        command.complete()
    for below, one in command.commands.items():
        yield from _command(f"{path} {below}", one)


def _arguments(command: Any) -> Iterator[str]:
    for one in command.params:
        if one.param_type_name == "argument":
            name = one.metavar or one.name.upper()
            many = " ..." if one.nargs == -1 else ""
            yield f"{name}{many}" if one.required else f"[{name}{many}]"


def _options(command: Any) -> Iterator[str]:
    rows = [one for one in command.params if not (one.hidden or one.name in COMMON)]
    if rows:
        yield "\n| option | meaning |\n| --- | --- |\n"
    for one in rows:
        yield f"| `{_name(one)}` | {_meaning(one)} |\n"


def _name(one: Any) -> str:
    if one.param_type_name == "argument":
        return str(one.metavar or one.name.upper()).replace("|", "\\|")
    if one.is_flag:
        return str(one.opts[0])
    choices = one.type_descriptor.choices
    value = one.metavar or "|".join(map(str, choices or [one.name.upper()]))
    return f"{one.opts[0]} {value}".replace("|", "\\|")


def _meaning(one: Any) -> str:
    text = " ".join((one.help or "").split()).replace("|", "\\|")
    if one.default is None or one.is_flag or one.required or not one.show_default:
        return text
    return f"{text}; {one.default} if not given"


def _sentence(text: str | None) -> str:
    whole = (text or "").replace("|", "\\|").rstrip(".")
    return f"{whole[:1].upper()}{whole[1:]}."


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE.relative_to(PAGE.parents[2]))


if __name__ == "__main__":
    main()
