"""Every way to distribute the services of the loop over programs."""

from collections.abc import Iterator

from pincette.config import RigFile
from pincette.core.service import canonical_name
from pincette.core.topics import LOOP

Programs = tuple[str, ...]
"""Programs of one loop; see the rig file's ``[rig] composed``."""


def _groups(services: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], ...]]:
    if not services:
        yield ()
        return
    first, rest = services[0], services[1:]
    for groups in _groups(rest):
        yield ((first,), *groups)
        for place, group in enumerate(groups):
            yield (*groups[:place], (first, *group), *groups[place + 1 :])


def partitions() -> list[Programs]:
    """Return every value of ``composed``: the programs of more than one service, of every
    partition."""
    return [
        tuple(canonical_name("+".join(group)) for group in groups if len(group) > 1)
        for groups in _groups(LOOP)
    ]


def composing(rig: RigFile, *programs: str) -> RigFile:
    """Return the same rig with some services composed into programs."""
    together = rig.rig.model_copy(update={"composed": programs})
    return rig.model_copy(update={"rig": together})
