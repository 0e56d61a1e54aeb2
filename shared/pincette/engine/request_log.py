"""Data that a replay needs besides samples: the requests that a service accepted, and its state.

Each request is noted with its position among the steps. Only those parts of the state that differ
from the state at a start are noted, as JSON. The coefficients of a model are omitted, since they
follow from the rig file and the calibration. Floats are stored exactly.
"""

import json
from collections.abc import Mapping
from typing import Any, cast, get_args, get_origin, get_type_hints

import msgspec

from pincette.control.quantities import Document
from pincette.control.record import field_names, replace
from pincette.core.messages import Action, Arm, Load, Message, RequestLog, Reset, Sample, Trip
from pincette.core.service import AnyService
from pincette.core.topics import TOPIC_OF


def snapshot(service: AnyService, config: Any, state: Any) -> Document:
    """Return JSON of the snapshot fields that differ from the state at a start; empty if none
    does.
    """
    changes = _changes(state, service.start(config), service.state_snapshot)
    return Document(json.dumps(changes, separators=(",", ":")) if changes else "")


def restored(service: AnyService, config: Any, state: Any, text: str) -> Any:
    """Return a state with the fields of a snapshot; raises TypeError or ValueError."""
    start_state = service.start(config)
    tree: Any = json.loads(text) if text else {}
    if not isinstance(tree, dict):
        raise TypeError(f"carried: {text[:60]!r} is not a map")
    changes = cast("dict[str, Any]", tree)
    if odd := changes.keys() - set(service.state_snapshot):
        raise ValueError(f"carried: the {service.name} does not carry {', '.join(sorted(odd))}")
    whole = _changed(start_state, changes)
    return replace(state, **{name: getattr(whole, name) for name in service.state_snapshot})


def _changes(value: Any, start_state: Any, names: tuple[str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in names:
        one, other = getattr(value, name), getattr(start_state, name)
        inner = field_names(one)
        if inner is not None and type(one) is type(other):
            change: Any = _changes(one, other, inner)
            if change:
                found[name] = change
        elif _are_records(one) and _are_records(other) and len(one) == len(other):
            each = [
                _changes(item, start, field_names(item) or ())
                for item, start in zip(one, other, strict=True)
            ]
            if any(each):
                found[name] = each
        elif one is not other and repr(one) != repr(other):  # equal numbers may differ in sign
            found[name] = msgspec.to_builtins(one) if isinstance(one, msgspec.Struct) else one
    return found


def _are_records(value: Any) -> bool:
    if type(value) is not tuple:
        return False
    return all(field_names(item) is not None for item in cast("tuple[Any, ...]", value))


def _changed(start_value: Any, changes: Mapping[str, Any]) -> Any:
    hints = get_type_hints(start_value.__class__)
    return replace(
        start_value,
        **{
            name: _made(hints[name], getattr(start_value, name), value)
            for name, value in changes.items()
        },
    )


def _made(hint: Any, start_value: Any, value: Any) -> Any:
    if value is None:
        return None
    if field_names(start_value) is not None:
        return _changed(start_value, dict(value))
    if get_origin(hint) is tuple:
        (inner, *_), items = get_args(hint), cast("list[Any]", value)
        starts = start_value if len(start_value or ()) == len(items) else (None,) * len(items)
        return tuple([_made(inner, start, item) for start, item in zip(starts, items, strict=True)])
    for kind in (hint, *get_args(hint)):  # a record whose initial value is None
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            return msgspec.convert(value, kind)
    if isinstance(hint, type) and issubclass(hint, tuple):  # a NamedTuple
        return cast(Any, hint)(*value)
    return value


class RequestRecorder:
    """Logs the requests that one service accepts."""

    def __init__(self, service: AnyService) -> None:
        self._service = service
        self._load: Load | None = None
        """Program of the next arming."""

    def taken(
        self, request: Message, config: Any, state: Any, newest: Sample | None
    ) -> tuple[RequestLog, ...]:
        """Log an accepted request; a program is logged with the arming of its epoch.

        ``newest`` is the sample of the service's newest step.
        """
        match request:
            case Load():
                self._load = request
                return ()
            case Arm():
                carried = snapshot(self._service, config, state)
                armed = self._entry(state, newest, arm=request, state_snapshot=carried)
                loaded = (
                    () if self._load is None else (self._entry(state, newest, load=self._load),)
                )
                return *loaded, armed
            case Action():
                return (self._entry(state, newest, action=request),)
            case Trip():
                return (self._entry(state, newest, trip=request),)
            case Reset():
                return (self._entry(state, newest, reset=request),)
            case _:
                return ()

    def _entry(self, state: Any, sample: Sample | None, **request: Any) -> RequestLog:
        if sample is not None and sample.epoch != state.epoch:
            sample = None  # it belongs to the previous epoch
        return RequestLog(
            epoch=state.epoch,
            seq=-1 if sample is None else sample.seq,
            service=self._service.name,
            topic="" if sample is None else TOPIC_OF[type(sample)].name,
            **request,
        )
