"""Commands to a simulated rig: the table of all operations, and the commands in the rig file.

The rig, the command line and docs/how-to/scripted-faults.md use this table.
"""

from dataclasses import dataclass

from pydantic import model_validator

from pincette.config.tables import NotNegative, Positive, Table
from pincette.core.messages import SimCommand

LONGEST_DELAY_S = 5.0


@dataclass(frozen=True, slots=True)
class Operation:
    """An action or fault that can be applied to a target."""

    what: str
    meaning: str
    quantity: str = ""
    """Name of the operation's value, with the unit; empty: the operation has no value."""
    least: float = 0.0
    most: float = 0.0
    default: float | None = None
    """Default of the value; None: a value must be given."""
    lasts: bool = True
    """True if the operation is a fault, which lasts for a time and can be healed."""

    @property
    def valued(self) -> bool:
        """Return whether the operation takes a value."""
        return bool(self.quantity)


def _link_faults(quantity: str, limit: float) -> tuple[Operation, ...]:
    """Return the faults of an instrument or its line; ``quantity`` names their values, with
    unit.
    """
    late = ("s", 0.0, LONGEST_DELAY_S)
    return (
        Operation(
            "off", "is silent, as if unplugged", "1: its socket is closed too", 0.0, 1.0, 0.0
        ),
        Operation("garbage", "answers random bytes"),
        Operation("wrong", "is wrong by an offset", quantity, -limit, limit),
        Operation("slow", "answers late", *late),
        Operation("delayed", "shows, or puts out, an old value", *late),
        Operation("intermittent", "loses exchanges", "share of them", 0.0, 1.0),
        Operation("heal", "ends every fault of this target", lasts=False),
    )


SENSOR = (
    *_link_faults("µm", 1e4),
    Operation("stuck", "shows the same reading"),
    Operation(
        "over_range",
        "shows that the position is beyond its range",
        "1 above, -1 below",
        -1.0,
        1.0,
        1.0,
    ),
)
OUTPUT = (*_link_faults("V", 20.0), Operation("stuck", "accepts, and does not move"))
OPERATIONS: dict[str, tuple[Operation, ...]] = {
    "part": (
        Operation("remove", "is removed", lasts=False),
        Operation(
            "place",
            "is put between the arms",
            "position of the arm at first touch, in µm; that of the last part if not given",
            -1e4,
            1e4,
            lasts=False,
        ),
        Operation("lose", "falls out of the gripper", lasts=False),
        Operation("slip", "gives way, away from the driven arm", "µm", -100.0, 100.0, lasts=False),
    ),
    "weight": (
        Operation(
            "hang",
            "hangs on the tip and pulls against closing",
            "weight in mN; 0 removes it",
            -1e3,
            1e3,
            lasts=False,
        ),
    ),
    "arm": (
        Operation(
            "stiffen", "scales the stiffness of the contact", "factor", 0.01, 100.0, lasts=False
        ),
        Operation(
            "hysteresis",
            "scales the hysteretic part of the motion",
            "factor",
            0.01,
            10.0,
            lasts=False,
        ),
    ),
    "sensor": SENSOR,
    "output": OUTPUT,
    "second_sensor": SENSOR,
    "second_output": OUTPUT,
}
"""Actions and faults by target."""
OF_SECOND = frozenset({"second_sensor", "second_output"})
"""Targets that exist only on rigs with two driven arms."""
OPTIONAL = frozenset({("part", "place")})
"""Operations whose value may be omitted; without a value they have a separate meaning."""


def operation_of(target: str, what: str) -> Operation | None:
    """Return the operation with a target and a name; None if there is none."""
    return next((one for one in OPERATIONS.get(target, ()) if one.what == what), None)


def objection(order: SimCommand) -> str:
    """Return why a command cannot be executed, with the possible commands; empty if it can be."""
    if order.target not in OPERATIONS:
        return f"no target {order.target!r}; targets are {', '.join(OPERATIONS)}"
    operation = operation_of(order.target, order.what)
    if operation is None:
        known = ", ".join(operation.what for operation in OPERATIONS[order.target])
        return f"{order.target} has no operation {order.what!r}; it has {known}"
    name = f"{order.target} {order.what}"
    if not 0.0 <= order.after_s < float("inf"):
        return f"{name}: after_s = {order.after_s} s is not a future time"
    if order.for_s is not None and not operation.lasts:
        return f"{name} happens once: for_s = {order.for_s} s has no meaning"
    if order.for_s is not None and not 0.0 < order.for_s < float("inf"):
        return f"{name}: for_s = {order.for_s} s is not a duration"
    return _value_objection(name, operation, order)


def _value_objection(name: str, operation: Operation, order: SimCommand) -> str:
    value = order.value
    if not operation.valued:
        return "" if value is None else f"{name} takes no value, {value} was given"
    if value is None:
        optional = operation.default is not None or (order.target, order.what) in OPTIONAL
        return "" if optional else f"{name} needs a value: {operation.quantity}"
    if operation.least <= value <= operation.most:
        return ""
    return f"{name} {value}: beyond {operation.least:g}..{operation.most:g} ({operation.quantity})"


class ScriptedOrder(Table):
    """An entry of [[simulation.script]]."""

    at_s: NotNegative
    """Time of the command in s, counted in the rig's time from the first written voltage."""
    target: str
    """``part``, ``weight``, ``arm``, ``sensor`` or ``output``; with two arms also ``second_sensor``
    and ``second_output``."""
    what: str
    """Name of the action or fault, as listed by ``pincette rig``."""
    value: float | None = None
    """Value in the unit of the action; None: its default."""
    for_s: Positive | None = None
    """Duration of a fault; None: until it is healed."""

    @model_validator(mode="after")
    def _known(self) -> "ScriptedOrder":
        if words := objection(self.order()):
            raise ValueError(words)
        return self

    def order(self) -> SimCommand:
        """Return the command in the form that is sent over the bus."""
        return SimCommand(self.target, self.what, self.value, self.at_s, self.for_s)
