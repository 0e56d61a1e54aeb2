"""Write the page of the fault table from the register of the fault tests: `make docs`."""

import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
HEAD = """\
# Fault table

Generated from `tests/support/fault_table.toml` by `make docs`; a test checks that every test named
here exists. T is the control period, 20 ms on the demo rig. A command has the age of the sample it
is based on, and is refused beyond 2.5 T. *Safe* means that the actuator accepts no more commands.
If the arm is free, it ramps to the safe voltage. If a part is held, it freezes the voltage for a
bounded time and then ramps. In both cases it latches, and stays latched until a person resets it.

*Virtual time* is the real loop with the same services and the same bytes, on a simulated clock
(`tests/support/virtual_loop.py`). It tests every fault in every state of a job and at any phase of
the period, with the same numbers in every run. *Real processes* are programs on real links, on a
machine that stalls now and then; see [what is guaranteed](../explanations/safety.md). Every row has
a *twin*: the same fault just below the limit, which must not trip.

| # | fault | noticed by | what must happen |
| --- | --- | --- | --- |
"""
TESTS = """\

## Tests

"""


def fault_table_page() -> str:
    """Return the page as Markdown."""
    from tests.support.fault_table import ROWS

    rows = [f"| {row.number} | {row.fault} | {row.noticed_by} | {row.must} |" for row in ROWS]
    lines = [HEAD + "\n".join(rows), TESTS.rstrip("\n")]
    for row in ROWS:
        lines.append(f"\n**{row.number}. {row.fault}**\n")
        for title, tests in (
            ("virtual time", row.virtual),
            ("real processes", row.real),
            ("twin", row.twin),
        ):
            if tests:
                lines.append(f"- {title}: " + ", ".join(_named(test) for test in tests))
        if row.open:
            lines.append(f"- open: {row.open}")
    return "\n".join(lines) + "\n"


def _named(test: str) -> str:
    """Return the name of a test as a link to the test file."""
    path, _, name = test.partition("::")
    return f"[`{name or Path(path).stem}`](../../{path})"


PAGES: dict[str, Any] = {"reference/fault-table.md": fault_table_page}
"""Pages by path below docs."""

if str(ROOT) not in sys.path:
    sys.path.append(str(ROOT))  # the tests are not an installed package
