"""Write what a rig does as CSV until Ctrl-C; needs zenoh and msgpack.

A row is one sample. What the programs say of it is joined by its number, never by what came last.
"""
# pyright: basic

import argparse
import csv
import sys

import msgpack
import zenoh

TOPICS = ("position", "estimate", "applied")
FIELDS = ("epoch", "seq", "t_s", "x_um", "force_mN", "force_uncertainty_mN", "voltage_V")
WAITING = 50
"""Samples that may wait for a topic; what waits longer has lost it and is left out."""

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--router", default="tcp/127.0.0.1:7447")
parser.add_argument("--rig", default="demo")
parser.add_argument("--count", type=int, help="rows to write; without it, until Ctrl-C")
parser.add_argument("--file", type=argparse.FileType("w", encoding="utf-8"), default=sys.stdout)
given = parser.parse_args()

config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{given.router}"]}}}}')
table = csv.DictWriter(given.file, FIELDS, extrasaction="ignore")
table.writeheader()
rows, parts = {}, {}
written = left_out = 0
with zenoh.open(config) as session, given.file:
    samples = session.declare_subscriber(f"pincette/v1/{given.rig}/*")
    try:
        for sample in samples:
            topic = str(sample.key_expr).rsplit("/", 1)[1]
            if topic not in TOPICS:
                continue
            message = msgpack.unpackb(sample.payload.to_bytes())
            number = message["epoch"], message["seq"]
            rows.setdefault(number, {}).update(message)
            parts.setdefault(number, set()).add(topic)
            if len(parts[number]) == len(TOPICS):
                table.writerow(rows.pop(number))
                del parts[number]
                given.file.flush()
                written += 1
            elif len(rows) > WAITING:
                oldest = next(iter(rows))
                del rows[oldest], parts[oldest]
                left_out += 1
            if written == given.count:
                break
    except KeyboardInterrupt:
        pass
print(f"{written} rows, {left_out} incomplete ones left out", file=sys.stderr)
