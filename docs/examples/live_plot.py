"""Plot position, force and voltage of a rig until Ctrl-C; needs zenoh, msgpack and matplotlib."""
# pyright: basic

import argparse
import queue
import signal
import threading

import matplotlib
import msgpack
import zenoh

PANELS = {
    "position in µm": {"x_um": "measured", "x_r_um": "reference"},
    "force in mN": {"force_mN": "estimated", "force_r_mN": "reference"},
    "voltage in V": {"voltage_V": "applied"},
}

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--router", default="tcp/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
parser.add_argument("--seconds", type=float, default=10.0, help="how much is shown")
parser.add_argument("--png", help="draw into this file, once, without a window")
given = parser.parse_args()
if given.png:
    matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (once the backend is chosen)

arrived, gap = queue.SimpleQueue(), float("nan")
rows = {}
"""Valid values from the messages of each sample, joined by its number."""

figure, axes = plt.subplots(len(PANELS), sharex=True, layout="constrained")
curves = {}
for panel, (label, fields) in zip(axes, PANELS.items(), strict=True):
    for field, name in fields.items():
        (curves[field],) = panel.plot([], [], label=name)
    panel.set_ylabel(label)
    panel.legend(loc="center left", bbox_to_anchor=(1, 0.5))
axes[-1].set_xlabel("time in s")


def draw():
    """Draw the newest seconds since the last arming; time 0 is that arming."""
    while not arrived.empty():
        message = msgpack.unpackb(arrived.get().payload.to_bytes())
        message |= message.pop("arms")[0]  # for two arms, the first is shown
        row = rows.setdefault((message["epoch"], message["seq"]), {})
        usable = message.get("valid", True) and not message.get("unconfirmed")  # otherwise a gap
        row.update(message if usable else {"t_s": message["t_s"]} if "t_s" in message else {})
    epoch = max(rows, default=(0, 0))[0]
    newest_s = max((row.get("t_s", 0.0) for (e, _), row in rows.items() if e == epoch), default=0.0)
    for number, row in list(rows.items()):
        if number[0] < epoch or row.get("t_s", newest_s) < newest_s - given.seconds:
            del rows[number]
    shown = []
    for epoch, seq in sorted(rows):  # a lost sample is a gap
        shown += [rows[epoch, seq]] if (epoch, seq - 1) in rows else [{}, rows[epoch, seq]]
    for field, curve in curves.items():
        points = [(row.get("t_s", gap), row.get(field, gap)) for row in shown]
        curve.set_data(*zip(*points, strict=True) if points else ((), ()))
    for panel in axes:
        panel.relim()
        panel.autoscale()


config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{given.router}"]}}}}')
interrupted = threading.Event()
signal.signal(signal.SIGINT, lambda *_: interrupted.set())  # so that no drawing is cut short
with zenoh.open(config) as session:
    for topic in ("position", "estimate", "telemetry", "applied"):
        session.declare_subscriber(f"pincette/v2/{given.rig}/{topic}", arrived.put)
    while not given.png and plt.fignum_exists(figure.number) and not interrupted.is_set():
        draw()
        plt.pause(0.1)
    if given.png:
        interrupted.wait(given.seconds)
        draw()
        figure.savefig(given.png)
