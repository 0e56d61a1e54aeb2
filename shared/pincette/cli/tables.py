"""Tables and marks that all commands show alike."""

from collections.abc import Collection, Iterable, Mapping
from datetime import datetime

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

LABEL_WIDTH = 19
"""Width of the names of figures."""

STATE_COLOURS: Mapping[str, str] = {
    "succeeded": "green",
    "running": "cyan",
    "paused": "yellow",
    "stopped": "yellow",
    "aborted": "red",
    "failed": "red",
    "interrupted": "red",
}


def table(*names: str, right: Collection[str] | None = None) -> Table:
    """A table without frame; all columns but the first stand right where none are named."""
    made = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for place, name in enumerate(names):
        to_right = place > 0 if right is None else name in right
        made.add_column(name, justify="right" if to_right else "left", overflow="fold")
    return made


def figures(
    lines: Iterable[tuple[str, str]], console: Console, label_width: int = LABEL_WIDTH
) -> None:
    """Print names with what is known of each; a terminal that is narrow breaks what is known."""
    if not console.is_terminal:
        for label, text in lines:
            console.print(f"{label:<{label_width}} {text}", markup=False, soft_wrap=True)
        return
    grid = Table.grid(padding=(0, 1))
    grid.add_column(min_width=label_width, no_wrap=True)
    grid.add_column(overflow="fold")
    for label, text in lines:
        grid.add_row(Text(label), Text(text))
    console.print(grid)


def clock(stamp: str | None) -> str:
    """A time stamp in UTC as a person at the bench reads it."""
    if not stamp:
        return ""
    return datetime.fromisoformat(stamp).astimezone().strftime("%Y-%m-%d %H:%M:%S")


def size(count: int) -> str:
    """A number of bytes."""
    amount = float(count)
    for unit in ("B", "kB", "MB"):
        if amount < 1000.0:
            return f"{amount:.0f} {unit}" if unit == "B" else f"{amount:.1f} {unit}"
        amount /= 1000.0
    return f"{amount:.2f} GB"
