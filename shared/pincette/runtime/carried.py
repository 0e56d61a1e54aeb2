"""What a service carries from one epoch into the next, as JSON, and back again; pure.

Told is only what differs from a start, so that a model with its many coefficients, which the rig
file and the calibration give, does not travel with what it remembers. A float keeps every bit.
"""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, cast, get_args, get_origin, get_type_hints

from pincette.messages import Document
from pincette.service import AnyService


def told(service: AnyService, config: Any, state: Any) -> Document:
    """What ``carried`` of the service has become since a start; empty where that is nothing.

    Raises
    ------
    TypeError
        Where the state holds what JSON has no words for.
    """
    begun = service.start(config)
    changes = _changes(state, begun, service.carried)
    return Document(json.dumps(changes, separators=(",", ":")) if changes else "")


def recalled(service: AnyService, config: Any, state: Any, text: str) -> Any:
    """A state with what was told of another one put in.

    Raises
    ------
    TypeError, ValueError
        Where the text is not of a state of this service.
    """
    begun = service.start(config)
    told: Any = json.loads(text) if text else {}
    if not isinstance(told, dict):
        raise TypeError(f"carried: {text[:60]!r} is not a map")
    changes = cast("dict[str, Any]", told)
    if odd := changes.keys() - set(service.carried):
        raise ValueError(f"carried: the {service.name} carries no {', '.join(sorted(odd))}")
    whole = _changed(begun, changes)
    return replace(state, **{name: getattr(whole, name) for name in service.carried})


def _changes(value: Any, begun: Any, names: tuple[str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in names:
        one, other = getattr(value, name), getattr(begun, name)
        if is_dataclass(one) and type(one) is type(other):
            change: Any = _changes(one, other, tuple(field.name for field in fields(one)))
            if change:
                found[name] = change
        elif one is not other and repr(one) != repr(other):  # equal numbers may differ in sign
            found[name] = one
    return found


def _changed(begun: Any, changes: Mapping[str, Any]) -> Any:
    hints = get_type_hints(begun.__class__)
    return replace(
        begun,
        **{name: _made(hints[name], getattr(begun, name), told) for name, told in changes.items()},
    )


def _made(hint: Any, begun: Any, told: Any) -> Any:
    if is_dataclass(begun):
        return _changed(begun, dict(told))
    if get_origin(hint) is tuple:
        (inner, *_) = get_args(hint)
        return tuple([_made(inner, None, item) for item in cast("list[Any]", told)])
    if isinstance(hint, type) and issubclass(hint, tuple):  # with names
        return cast(Any, hint)(*told)
    return told
