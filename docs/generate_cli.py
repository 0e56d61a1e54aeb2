"""Write docs/reference/cli.md from the command line itself: ``python docs/generate_cli.py``."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

from pincette.cli.exit_status import MEANINGS
from pincette.cli.main import parser

PAGE = Path(__file__).resolve().parent / "reference" / "cli.md"
HEAD = """\
# Command line

Generated from `pincette.cli`; a test compares the two. `pincette COMMAND --help` says the same.

Every command that asks a supervisor takes `--url`, `--key`, `--at` and `--json`. With `--json`
there is one JSON document on standard output and nothing else; a refusal is then the problem
document (RFC 9457), and its words go to standard error as always. `watch --json` prints an event a
line.
A bar is drawn in a terminal alone; elsewhere a job that is followed prints a line for each phase.
`JOB` is the id of a job, or `last`.

## Exit status

| status | meaning |
| --- | --- |
"""
LIKE_A_JOB = {
    "plan": "Kinds and options are those of `pincette job KIND`, without `--queue`, `--label` and "
    "`--no-wait`.\nOf a grip, a track and a move, `--plot FILE` draws what is foretold, as PNG.",
    "calibrate": "Calibrations and options are those of `pincette job calibrate`.",
}
"""Commands whose words stand elsewhere already."""
COMMON = ("--url", "--key", "--at", "--json", "--help")


def page() -> str:
    """The whole page, as Markdown."""
    statuses = "".join(f"| {status.value} | {text} |\n" for status, text in MEANINGS.items())
    top = _below(parser()) or {}
    commands = (part for name, word in top.items() for part in _command(f"pincette {name}", word))
    return HEAD + statuses + "".join(commands)


def _command(path: str, word: argparse.ArgumentParser) -> Iterator[str]:
    below = _below(word)
    kept = path.split()[1] if " " in path else ""
    depth = "##" if path.count(" ") == 1 else "###"
    yield f"\n{depth} `{' '.join([path, *_places(word)])}`\n\n{_sentence(word.description)}\n"
    if below is None:
        yield from _options(word)
        return
    if kept in LIKE_A_JOB:
        yield f"\n{LIKE_A_JOB[kept]}\n"
        return
    for name, one in below.items():
        yield from _command(f"{path} {name}", one)


def _actions(word: argparse.ArgumentParser) -> list[argparse.Action]:
    # argparse has no other way to ask a parser what it knows.
    return word._actions  # pyright: ignore[reportPrivateUsage]


def _below(word: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser] | None:
    for action in _actions(word):
        choices: Any = action.choices
        if isinstance(choices, dict):
            return cast("dict[str, argparse.ArgumentParser]", choices)
    return None


def _places(word: argparse.ArgumentParser) -> Iterator[str]:
    for action in _actions(word):
        if not action.option_strings:
            name = str(action.metavar or action.dest)
            yield {"?": f"[{name}]", "*": f"[{name} ...]", "+": f"{name} ..."}.get(
                str(action.nargs), name
            )


def _options(word: argparse.ArgumentParser) -> Iterator[str]:
    rows = [
        action
        for action in _actions(word)
        if action.help != argparse.SUPPRESS and not set(action.option_strings) & set(COMMON)
    ]
    if rows:
        yield "\n| option | meaning |\n| --- | --- |\n"
    for action in rows:
        yield f"| `{_name(action)}` | {_meaning(action)} |\n"


def _name(action: argparse.Action) -> str:
    if not action.option_strings:
        return str(action.metavar or action.dest)
    if action.nargs == 0:
        return action.option_strings[0]
    if action.choices is not None and action.metavar is None:
        value = "\\|".join(str(choice) for choice in action.choices)
    else:
        value = str(action.metavar or action.dest.upper()).replace("|", "\\|")
    return f"{action.option_strings[0]} {value}"


def _meaning(action: argparse.Action) -> str:
    return ((action.help or "") % {"default": action.default}).replace("|", "\\|")


def _sentence(text: str | None) -> str:
    said = (text or "").replace("|", "\\|")
    return f"{said[:1].upper()}{said[1:]}."


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE.relative_to(PAGE.parents[2]))


if __name__ == "__main__":
    main()
