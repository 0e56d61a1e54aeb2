"""Which rig is meant where none is named."""

from collections.abc import Sequence

from pincette.api.rig_models import Rig
from pincette.client.errors import WhichRigError


def only(rigs: Sequence[Rig]) -> str:
    """Name of the only rig; raises WhichRigError where there are others."""
    names = [rig.name for rig in rigs]
    if len(names) != 1:
        there = ", ".join(names) or "none"
        raise WhichRigError(
            f"which rig is meant? The supervisor serves {len(names)}: {there}. Name one of them"
        )
    return names[0]
