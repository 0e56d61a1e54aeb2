"""Write the samples of a rig as CSV until Ctrl-C; needs zenoh and msgpack.

A row is one sample. Messages of the programs are joined to it by its number, not by their order of
arrival. A cell is empty if the value is not valid, if the output has not confirmed the voltage, or
if the message was lost.
"""
# pyright: basic

import argparse
import csv
import signal
import sys
import threading

import msgpack
import zenoh

FIELDS = ("epoch", "seq", "t_s", "x_um", "force_mN", "force_uncertainty_mN", "voltage_V")
WAITING = 50  # number of samples that may wait for their messages

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--router", default="tcp/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
parser.add_argument("--count", type=int, help="rows to write; without it, until Ctrl-C")
parser.add_argument("--file", type=argparse.FileType("w", encoding="utf-8"), default=sys.stdout)
given = parser.parse_args()


def cells(topic, message):
    """Return the cells that a message adds to its row, for the first arm: only valid values."""
    arm = message["arms"][0]
    if topic == "position":
        return {"t_s": message["t_s"], "x_um": arm["x_um"] if arm["valid"] else None}
    if topic == "estimate":
        names = ("force_mN", "force_uncertainty_mN")
        return {name: arm[name] if message["valid"] else None for name in names}
    return {"voltage_V": None if message["unconfirmed"] else arm["voltage_V"]}


def write(number, topics):
    """Write the row of a sample, and count it."""
    epoch, seq = number
    row = {name: value for found in topics.values() for name, value in found.items()}
    table.writerow({"epoch": epoch, "seq": seq, **row})
    given.file.flush()
    counts["rows"] += 1
    counts["incomplete"] += len(topics) < len(TOPICS)


TOPICS = ("position", "estimate", "applied")
config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{given.router}"]}}}}')
table = csv.DictWriter(given.file, FIELDS)
table.writeheader()
waiting, counts = {}, {"rows": 0, "incomplete": 0}
interrupted = threading.Event()
signal.signal(signal.SIGINT, lambda *_: interrupted.set())  # so that a row is never truncated
with zenoh.open(config) as session, given.file:
    samples = session.declare_subscriber(f"pincette/v2/{given.rig}/*")
    begun = None
    while not interrupted.is_set() and counts["rows"] != given.count:
        sample = samples.try_recv()
        if sample is None:
            interrupted.wait(0.01)
        if sample is None or (topic := str(sample.key_expr).rsplit("/", 1)[1]) not in TOPICS:
            continue
        message = msgpack.unpackb(sample.payload.to_bytes())
        number = message["epoch"], message["seq"]
        begun = begun or number  # their other messages may be past
        if number <= begun:
            continue
        waiting.setdefault(number, {})[topic] = cells(topic, message)
        while waiting and counts["rows"] != given.count:
            oldest, found = next(iter(waiting.items()))
            if len(found) < len(TOPICS) and len(waiting) <= WAITING:
                break
            write(oldest, waiting.pop(oldest))
    for number, found in waiting.items() if interrupted.is_set() else ():
        write(number, found)
print(f"{counts['rows']} rows, {counts['incomplete']} of them incomplete", file=sys.stderr)
