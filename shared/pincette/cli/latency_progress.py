"""How far a measurement is: a bar in a terminal, a line for each part elsewhere."""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from time import monotonic

from rich.progress import BarColumn, Progress, TextColumn

from pincette.cli.output import screen
from pincette.runtime.measuring.machine import Progress as Told

LOOK_S = 0.5


@contextmanager
def shown(for_s: float) -> Generator[Told]:
    """Show on standard error what is measured, for about so long in all."""
    console = screen(machine=True)
    if not console.is_terminal:
        yield lambda what, part_s: console.print(f"{what}: {part_s:.1f} s")
        return
    name, share = TextColumn("{task.description:<24}"), TextColumn("{task.percentage:>3.0f} %")
    # It refreshes itself seldom: what draws takes the time of what is measured.
    with Progress(
        name, BarColumn(), share, console=console, auto_refresh=False, transient=True
    ) as bar:
        task, over = bar.add_task("", total=for_s), threading.Event()
        begin_s = monotonic()

        def draw() -> None:
            while not over.wait(LOOK_S):
                bar.update(task, completed=min(for_s, monotonic() - begin_s), refresh=True)

        drawing = threading.Thread(target=draw, daemon=True)
        drawing.start()
        try:
            yield lambda what, _part_s: bar.update(task, description=what, refresh=True)
        finally:
            over.set()
            drawing.join()
