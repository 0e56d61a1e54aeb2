"""The certificates of a folder as a table, or as JSON."""

from datetime import datetime
from typing import Any

from pincette.cli.exit_status import Exit
from pincette.cli.output import emit
from pincette.security.certificates import Facts
from pincette.security.credentials import SOON
from pincette.security.folder import Folder


def show(folder: Folder, now: datetime, *, as_json: bool = False) -> int:
    """Print them; the exit status is 1 where one has ended."""
    found = [folder.authority(), *folder.all()]
    if as_json:
        emit([_tree(facts, now) for facts in found])
    else:
        width = max(len(facts.identity.name) for facts in found)
        for facts in found:
            row = _tree(facts, now)
            print(
                f"{facts.identity.name:<{width}}  {facts.identity.role:<10}  "
                f"{facts.ends:%Y-%m-%d}  {row['state']:<10}  {', '.join(facts.hosts)}".rstrip()
            )
    return Exit.FAILED if any(facts.ends <= now for facts in found) else Exit.DONE


def _tree(facts: Facts, now: datetime) -> dict[str, Any]:
    """One certificate as plain data."""
    return {
        "name": facts.identity.name,
        "role": facts.identity.role,
        "begins": facts.begins.isoformat(),
        "ends": facts.ends.isoformat(),
        "state": _state(facts, now),
        "hosts": list(facts.hosts),
    }


def _state(facts: Facts, now: datetime) -> str:
    if facts.ends <= now:
        return "ended"
    return "ends soon" if facts.ends - now < SOON else "good"
