"""The second driven arm of a rig: its instruments, model, limits and contact."""

from typing import Any, cast

from pydantic import ValidationError
from pydantic_core import InitErrorDetails

from pincette.config.instruments import Output, Sensor
from pincette.config.limits import Limits
from pincette.config.model import Model
from pincette.config.script import OF_SECOND
from pincette.config.simulation import Simulation
from pincette.config.tables import Positive, Table

Tree = dict[str, Any]
OWN_OF_AN_ARM = ("free_response", "recorded_response", "residuals")
"""Values of a model that are measured for one arm and do not apply to another."""


class Second(Table):
    """A second driven arm opposite the first, on the same part.

    x_1 and x_2 are both positive towards the part, so the gripper has closed by x_1 + x_2. Tables
    outside of this one apply to both arms.
    """

    sensor: Sensor
    """Sensor of this arm; its ``direction`` must make x_2 increase towards the part."""
    output: Output
    """Output of this arm: a module on a separate line, or, with the url of ``[output]``, another
    channel or another module on the same line. If the url is the same, driver, ``timeout_s`` and
    ``record`` must also be the same.
    """
    model: Model = Model()
    """Model of this arm. Omitted values are those of ``[model]``, except measured ones: each arm
    has its own free response.
    """
    limits: Limits
    """Limits of this arm; omitted values are those of ``[limits]``."""
    contact_um: float
    """Position of this arm at first contact; default: ``part.contact_um``."""
    gap_um: Positive | None = None
    """Distance between the two tips at x_1 = x_2 = 0. It is used to compute the position of first
    contact from a stated width of the part. Default: unknown.
    """


def completed(tables: Tree) -> Tree:
    """Return the tables of a rig file, with missing values of the second arm taken from the
    first.
    """
    second = tables.get("second")
    if not isinstance(second, dict):
        return tables
    own = cast(Tree, second)
    model = {
        name: value for name, value in _table(tables, "model").items() if name not in OWN_OF_AN_ARM
    }
    limits, part = _table(tables, "limits"), _table(tables, "part")
    whole = dict(own)
    for name, first in (("model", model), ("limits", limits)):
        given = own.get(name, {})
        if isinstance(given, dict):
            whole[name] = first | cast(Tree, given)
    if "contact_um" in part:
        whole.setdefault("contact_um", part["contact_um"])
    return tables | {"second": whole}


def _table(tables: Tree, name: str) -> Tree:
    found = tables.get(name, {})
    return cast(Tree, found) if isinstance(found, dict) else {}


def check_arms(
    sensor: Sensor, output: Output, second: Second | None, simulation: Simulation | None
) -> None:
    """Raise ValidationError if the tables of two arms contradict each other."""
    if second is None:
        for name in ("second", "pair"):
            if getattr(simulation, name, None) is not None:
                raise _refused(
                    ("simulation", name),
                    "given without [second]: this rig has one driven arm; add "
                    f"[second.sensor] and [second.output], or omit [simulation.{name}]",
                )
        for number, order in enumerate(() if simulation is None else simulation.script):
            if order.target in OF_SECOND:
                raise _refused(
                    ("simulation", "script", number, "target"),
                    f"this rig has one driven arm; name {order.target.removeprefix('second_')}",
                    order.target,
                )
        return
    for name, first, other in (
        ("sensor", sensor, second.sensor),
        ("output", output, second.output),
    ):
        _check_line(name, first, other)
        if (first.driver, first.url, first.options) == (other.driver, other.url, other.options):
            raise _refused(
                ("second", name, "url"),
                f"is [{name}] with the same options: give another url, or options that name "
                "another channel there",
                other.url,
            )


def _check_line(name: str, first: Sensor | Output, other: Sensor | Output) -> None:
    """Raise ValidationError if the same line is described in two different ways."""
    if first.url != other.url:
        return
    for key in ("driver", "timeout_s", "record"):
        wanted, given = getattr(first, key), getattr(other, key)
        if wanted != given:
            raise _refused(
                ("second", name, key),
                f"is {given!r} where [{name}] has {wanted!r}, and both are at {first.url!r}: "
                "use the same value, since they share the line, or another url",
                given,
            )


def _refused(loc: tuple[str | int, ...], text: str, value: object = "…") -> ValidationError:
    error = {"error": ValueError(text)}
    return ValidationError.from_exception_data(
        "second", [InitErrorDetails(type="value_error", loc=loc, input=value, ctx=error)]
    )
