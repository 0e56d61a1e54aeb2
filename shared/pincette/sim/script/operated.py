"""What a person does at the bench of a simulated rig."""

from typing import Protocol

from pincette.messages import Order


class Operated(Protocol):
    """What can be done to a simulated rig."""

    def now_s(self) -> float:
        """Time as the rig counts it."""
        ...

    def place_part(self, contact_um: float | None = None) -> None:
        """Put a part between the arms."""
        ...

    def remove_part(self) -> None:
        """Take the part away."""
        ...

    def lose_part(self) -> None:
        """Let the part fall."""
        ...

    def hang(self, weight_mN: float) -> None:
        """Hang a weight on the tip."""
        ...

    def scale_stiffness(self, factor: float) -> None:
        """Change the stiffness of the contact."""
        ...

    def scale_hysteresis(self, factor: float) -> None:
        """Change the hysteretic part of the motion."""
        ...


def carry_out(rig: Operated, order: Order) -> None:
    """Do what is ordered; raises ValueError where the rig cannot bear it."""
    value = order.value
    match order.target, order.what:
        case "part", "remove":
            rig.remove_part()
        case "part", "place":
            rig.place_part(value)
        case "part", _:
            rig.lose_part()
        case "weight", _:
            rig.hang(value or 0.0)
        case _, "stiffen":
            rig.scale_stiffness(1.0 if value is None else value)
        case _:
            rig.scale_hysteresis(1.0 if value is None else value)
