"""Foxglove layout for contrib/foxglove/pincette.json; it shows a running rig or its records."""

import json
import sys

from foxglove.layouts import (
    Layout,
    PlotConfig,
    PlotPanel,
    PlotSeries,
    ServiceCallConfig,
    ServiceCallPanel,
    SplitContainer,
    SplitItem,
    StateTransitionsConfig,
    StateTransitionsPanel,
    StateTransitionsSeries,
)

PLOTS = {
    "force, mN": (
        "estimate.arms[0].force_mN",
        "telemetry.force_r_mN",
        "estimate.arms[0].force_uncertainty_mN",
    ),
    "position, µm": ("estimate.arms[0].x_um", "telemetry.arms[0].x_r_um"),
    "voltage, V": ("applied.arms[0].voltage_V",),
    "sliding function, µm": ("telemetry.sliding_um", "telemetry.band_um"),
}
"""Plots by title, each with its message paths. A path is a topic and a field, which ends in the
unit.
"""
ONLY_IF = {"applied.arms[0].voltage_V": "unconfirmed==false"}
"""Conditions for paths: a voltage is not shown unless the output has confirmed it."""
STATES = ("telemetry.phase", "applied.state", "job.state")
RED = "#c8102e"


def layout() -> Layout:
    """Return the layout: plots one below another, phases and states, and the emergency stop."""
    rows = [SplitItem(proportion=3.0, content=_plot(title)) for title in PLOTS]
    states = StateTransitionsPanel(
        title="phase and states",
        config=StateTransitionsConfig(
            paths=[StateTransitionsSeries(value=path, label=path) for path in STATES],
            is_synced=True,
        ),
    )
    stop = ServiceCallPanel(
        title="emergency stop",
        config=ServiceCallConfig(
            service_name="estop", request_payload="{}", button_text="E-STOP", button_color=RED
        ),
    )
    below = SplitContainer(
        direction="row",
        items=[SplitItem(proportion=3.0, content=states), SplitItem(content=stop)],
    )
    items = [*rows, SplitItem(proportion=2.0, content=below)]
    return Layout(content=SplitContainer(direction="column", items=items))


def _plot(title: str) -> PlotPanel:
    series = [PlotSeries(value=shown_path(path), label=path, enabled=True) for path in PLOTS[title]]
    return PlotPanel(title=title, config=PlotConfig(paths=series, is_synced=True))


def shown_path(path: str) -> str:
    """Return a path in the viewers' syntax, with the condition on its messages."""
    topic, _, field = path.partition(".")
    return f"{topic}{{{ONLY_IF[path]}}}.{field}" if path in ONLY_IF else path


def text() -> str:
    """Return the text of the layout file."""
    tree = json.loads(layout().to_json())
    return json.dumps(tree, indent=2, ensure_ascii=False, sort_keys=True) + "\n"


if __name__ == "__main__":
    sys.stdout.write(text())
