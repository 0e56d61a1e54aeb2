"""Every path of the layout is an existing topic and field, of a rig and of its records."""

import json
from typing import Any

from pincette.core.messages.arms import ArmApplied, ArmEstimate, ArmTelemetry
from pincette.core.topics import APPLIED, TOPICS
from pincette_foxglove.layout import PLOTS, STATES, shown_path, text
from pincette_foxglove.program import ESTOP
from tests.support.checkout import ROOT

FILE = ROOT / "contrib/foxglove/pincette.json"


def test_the_file_equals_the_generated_layout() -> None:
    assert FILE.read_text(encoding="utf-8") == text()


RECORDS = {"estimate": ArmEstimate, "telemetry": ArmTelemetry, "applied": ArmApplied}
"""Record of one arm in the messages of a topic."""


def test_every_path_is_a_topic_and_a_field() -> None:
    fields = {
        f"{topic.name}.{name}" for topic in TOPICS for name in topic.message.__struct_fields__
    }
    fields |= {
        f"{name}.arms[0].{field}"
        for name, record in RECORDS.items()
        for field in record.__struct_fields__
    }
    assert {*STATES, *(path for paths in PLOTS.values() for path in paths)} <= fields


def test_every_voltage_that_is_shown_was_confirmed_by_the_output() -> None:
    shown = [shown_path(path) for paths in PLOTS.values() for path in paths]
    assert [path for path in shown if path.endswith("voltage_V")] == [
        "applied{unconfirmed==false}.arms[0].voltage_V"
    ]
    assert "unconfirmed" in APPLIED.message.__struct_fields__


def test_the_button_calls_an_existing_service() -> None:
    def panels(tree: Any) -> list[dict[str, Any]]:
        if tree.get("type") == "panel":
            return [tree]
        inner = [one["content"] for one in tree.get("items", [])]
        return [panel for one in inner for panel in panels(one)]

    (button,) = (
        panel
        for panel in panels(json.loads(text())["content"])
        if panel["panelType"] == "ServiceCall"
    )
    assert button["config"]["serviceName"] == ESTOP
