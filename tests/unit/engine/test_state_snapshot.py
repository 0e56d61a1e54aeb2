"""State that a service carries into an epoch: a snapshot as JSON, restored to the last bit."""

import json
from typing import Any

import pytest
from msgspec.structs import replace

from pincette.config import RigFile, parse_rig
from pincette.control.response.free_response import LinearResponse
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.recorded_response import RecordedResponse
from pincette.control.response.reversal_memory import ReversalMemory
from pincette.control.response.stroke_check import StrokeChange
from pincette.core.service import AnyService
from pincette.engine.request_log import restored, snapshot
from pincette_actuator import SERVICE as ACTUATOR
from pincette_controller import SERVICE as CONTROLLER
from pincette_estimator import SERVICE as ESTIMATOR
from tests.support.rigs import demo_rig

STROKE: dict[str, Any] = {
    "bottom_V": 0.0,
    "bottom_um": 0.0,
    "top_V": 2.0,
    "top_um": 38.0,
    "ascending": [0.0, 0.4, 1.0],
    "descending": [0.0, 0.6, 1.0],
    "residual_um": 0.2,
}


def rig(**model: Any) -> RigFile:
    """The demo rig with another free response, or with none."""
    tree = demo_rig().model_dump(mode="json", exclude_unset=True)
    del tree["model"]["free_response"]
    tree["model"] |= model
    return parse_rig(tree)


RIGS: dict[type, RigFile] = {
    LinearResponse: rig(),
    RecordedResponse: rig(recorded_response=STROKE),
    IdentifiedResponse: demo_rig(),
}
SERVICES: tuple[AnyService, ...] = (ESTIMATOR, CONTROLLER, ACTUATOR)


def moved(config: Any, **others: Any) -> Any:
    """Return the state of an estimator that has followed an alternating voltage."""
    state = ESTIMATOR.start(config)
    response, memory = state.arms[0].response, ReversalMemory(0.0)
    for voltage_V in (0.3, 1.1, 0.7, 1.9, 0.1 + 0.2, 0.4):
        response, memory = response.updated(voltage_V, 0.02), memory.updated(voltage_V)
    response = response.begin(1.25)
    changes = {"response": response, "reversal_memory": memory, "highest_V": 1.9, "known_V": -0.0}
    return replace(state, arms=(replace(state.arms[0], **changes, **others),))


@pytest.mark.parametrize("kind", RIGS)
def test_the_memory_of_an_estimator_is_restored(kind: type) -> None:
    config = ESTIMATOR.configure(RIGS[kind])
    state = moved(config)
    assert type(state.arms[0].response) is kind
    text = snapshot(ESTIMATOR, config, state)
    back = restored(ESTIMATOR, config, ESTIMATOR.start(config), text)
    assert repr(back) == repr(state)
    assert back.arms[0].response.updated(0.9, 0.02) == state.arms[0].response.updated(0.9, 0.02)


def test_the_measured_change_of_a_stroke_is_restored() -> None:
    """A start has no table: the second arming after a comparison failed with a TypeError."""
    config = ESTIMATOR.configure(RIGS[IdentifiedResponse])
    state = moved(config, stroke=StrokeChange(0.1 + 0.2, 0.004))
    text = snapshot(ESTIMATOR, config, state)
    back = restored(ESTIMATOR, config, ESTIMATOR.start(config), text)
    assert back.arms[0].stroke == state.arms[0].stroke
    assert type(back.arms[0].stroke) is StrokeChange


def test_a_snapshot_has_the_memory_of_a_model_without_the_model() -> None:
    config = ESTIMATOR.configure(RIGS[RecordedResponse])
    (tree,) = json.loads(snapshot(ESTIMATOR, config, moved(config)))["arms"]
    assert tree["response"].keys() == {"turns", "furthest_V", "voltage_V", "offset_um", "zero_V"}
    assert str(tree["known_V"]) == "-0.0"


def test_after_a_start_the_snapshot_is_empty() -> None:
    for service in SERVICES:
        config = service.configure(demo_rig())
        assert snapshot(service, config, service.start(config)) == ""
        begun = service.start(config)
        assert restored(service, config, begun, "") == begun


def test_carried_fields_replace_the_fields_of_the_new_state() -> None:
    config = ACTUATOR.configure(demo_rig())
    start = ACTUATOR.start(config)
    arms = (replace(start.arms[0], voltage_V=1.5),)
    held = replace(start, arms=arms, part_held=True)
    assert restored(ACTUATOR, config, held, "") == start
    assert restored(ACTUATOR, config, start, snapshot(ACTUATOR, config, held)) == held


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1]", "is not a map"),
        ('{"watch": 1}', "the estimator does not carry watch"),
        ("{", "Expecting"),
    ],
)
def test_unknown_carried_fields_are_refused(text: str, words: str) -> None:
    config = ESTIMATOR.configure(demo_rig())
    with pytest.raises((TypeError, ValueError), match=words):
        restored(ESTIMATOR, config, ESTIMATOR.start(config), text)
