"""Messages with changed records of one arm."""

from typing import Any, TypeVar, cast

from msgspec.structs import replace

from pincette.core.messages import Applied, Command, Estimate, GroundTruth, Position, Telemetry

M = TypeVar("M")
OF_ARMS = Position | Estimate | Command | Applied | Telemetry | GroundTruth


def with_arm(message: M, arm: int = 0, /, **changes: Any) -> M:
    """Return a message with changed fields, those of an arm in the record of this arm."""
    if not isinstance(message, OF_ARMS):
        raise TypeError(f"{type(message).__name__} has no arms")
    own = {name: value for name, value in changes.items() if name in message.__struct_fields__}
    of_arm = {name: value for name, value in changes.items() if name not in own}
    arms: list[Any] = [*message.arms]
    arms[arm] = replace(arms[arm], **of_arm)
    return cast(M, replace(message, **own, arms=tuple(arms)))
