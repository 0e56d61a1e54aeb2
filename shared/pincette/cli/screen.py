"""Text and tables on a terminal of any width: lines are broken between words only."""

from collections.abc import Collection, Sequence
from typing import IO, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

UNLIMITED = 10_000
"""Width of an output that is not a terminal, in characters."""


def broken_between_words(text: Text, console: Console, width: int) -> Text:
    """Return a text broken into lines between words; a word longer than a line is not broken."""
    text.overflow = "ignore"
    return Text("\n").join(text.wrap(console, width))


class Screen(Console):
    """Console that breaks lines between words, and only in a terminal."""

    def __init__(self, file: IO[str]) -> None:
        """Create a console that writes to ``file``."""
        super().__init__(highlight=False, file=file, width=None if file.isatty() else UNLIMITED)

    def print(self, *objects: Any, **settings: Any) -> None:
        """Print as Rich does, but do not break words that are longer than a line."""
        shown: list[Any] = []
        for one in objects:
            text = (
                self.render_str(one, markup=settings.get("markup")) if isinstance(one, str) else one
            )
            is_text = isinstance(text, Text)
            shown.append(broken_between_words(text, self, self.width) if is_text else text)
        wanted: dict[str, Any] = {"overflow": "ignore", "crop": False, **settings}
        super().print(*shown, **wanted)


class Rows(Table):
    """Table without a frame. If the terminal is too narrow, each row is printed as several
    lines.
    """

    def __init__(self, names: Sequence[str], right: Collection[str]) -> None:
        """Create a table; ``right`` names the right-aligned columns."""
        super().__init__(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
        self._names, self._cells = tuple(names), list[tuple[str, ...]]()
        for name in names:
            self.add_column(name, justify="right" if name in right else "left")

    def add_row(self, *cells: str) -> None:  # type: ignore[override]
        """Add a row of cells, which may contain markup."""
        self._cells.append(cells)
        super().add_row(*cells)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the table, or one line for each cell that is not empty."""
        if self._fit(console, options):
            yield from super().__rich_console__(console, options)
            return
        for place, row in enumerate(self._cells):
            if place:
                yield Text()
            for name, cell in zip(self._names, row, strict=True):
                if cell:
                    text = Text.from_markup(f"{name}: {cell}" if name else cell)
                    yield broken_between_words(text, console, options.max_width)

    def _fit(self, console: Console, options: ConsoleOptions) -> bool:
        """Set the widths of the columns so that no word is broken; return whether that is
        possible.

        Rich alone makes the widest columns narrower than their longest word before it takes the
        spare width of the others.
        """
        for column in self.columns:
            column.width = None
        unlimited = options.update_width(UNLIMITED)
        whole = self.__rich_measure__(console, unlimited).maximum
        texts = [
            [Text(name), *(Text.from_markup(row[place]) for row in self._cells)]
            for place, name in enumerate(self._names)
        ]
        sizes = [[Measurement.get(console, unlimited, text) for text in column] for column in texts]
        needed = [max(size.minimum for size in column) for column in sizes]
        wanted = [max(size.maximum for size in column) for column in sizes]
        between = whole - sum(wanted)
        spare = options.max_width - between - sum(needed)
        if spare < 0:
            return False
        growth = {place: wanted[place] - needed[place] for place in range(len(needed))}
        smallest_first = sorted(growth, key=lambda place: growth[place])
        for rank, place in enumerate(smallest_first):
            added = min(growth[place], spare // (len(smallest_first) - rank))
            self.columns[place].width = needed[place] + added
            spare -= added
        return True
