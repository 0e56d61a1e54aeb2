"""Selection of tests: those that tests/full.txt names, and those that start before the time
limit."""

import time
from pathlib import Path

import pytest

FULL = Path(__file__).parents[1] / "full.txt"
LEFT_OUT = "left out: the time of the session is used up"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--until",
        type=float,
        metavar="EPOCH_S",
        help="skip tests that have not started by this time",
    )


def ranks() -> dict[str, int]:
    """Return the positions in the order of `make test-full`, by the entries of ``full.txt``."""
    lines = FULL.read_text(encoding="utf-8").splitlines()
    return {line: place for place, line in enumerate(lines) if line and not line.startswith("#")}


def rank(nodeid: str, known: dict[str, int]) -> int:
    """Return the rank of a test's case, its name, or its file; -1 if `make test` runs it."""
    name, file = nodeid.partition("[")[0], nodeid.partition("::")[0]
    return max(known.get(one, -1) for one in (nodeid, name, file))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that `make test` leaves out, and sort them in the order of the list."""
    known = ranks()
    places = {item.nodeid: rank(item.nodeid, known) for item in items}
    for item in items:
        if places[item.nodeid] >= 0:
            item.add_marker("full")
    items.sort(key=lambda item: places[item.nodeid])


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test if its session's time is used up."""
    until_s = item.config.getoption("--until")
    if until_s is not None and time.time() > until_s:
        pytest.skip(LEFT_OUT)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Report which tests were skipped."""
    skipped = terminalreporter.stats.get("skipped", [])
    left = [report.nodeid for report in skipped if LEFT_OUT in str(report.longrepr)]
    files = [name.partition("::")[0] for name in left]
    if files:
        terminalreporter.section(f"{len(files)} tests {LEFT_OUT}")
        for file in dict.fromkeys(files):
            terminalreporter.write_line(f"{file}: {files.count(file)}")
