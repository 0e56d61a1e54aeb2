"""Punctuality reported by the programs, as stored in a record."""

import json

from pincette.core.messages import Ack, Recorded, Telemetry, Timing
from pincette.records import mcap_reading
from tests.support.recorded import loop, timing

from .conftest import Bench


def test_the_last_timing_of_each_program_is_a_separate_file(bench: Bench) -> None:
    assert bench.begin() == Ack(0)
    bench.feed([timing("estimator", 10, 0.001), timing("sensor", 12, 0.003), *loop(30)])
    bench.feed([timing("estimator", 20, 0.001, 0.004)])
    bench.finish(29)
    content = json.loads((bench.jobs / "j-1" / "timing.json").read_text(encoding="utf-8"))
    assert [(one["program"], one["seq"]) for one in content["programs"]] == [
        ("sensor", 12),
        ("estimator", 20),
    ]
    late = content["programs"][1]["lateness"]
    assert (late["count"], late["max_s"]) == (2, 0.004)
    assert content["programs"][1]["age"]["max_s"] is None
    manifest = json.loads((bench.jobs / "j-1" / "manifest.json").read_text(encoding="utf-8"))
    files = {file["name"] for file in manifest["files"]}
    assert {"timing.json", "samples.parquet"} <= files


def test_a_loop_in_lockstep_leaves_no_timing_file(bench: Bench) -> None:
    assert bench.begin() == Ack(0)
    bench.feed(loop(30))
    bench.finish(29)
    assert not (bench.jobs / "j-1" / "timing.json").exists()


def test_timing_messages_do_not_keep_a_record_open(bench: Bench) -> None:
    assert bench.begin() == Ack(0)
    bench.feed([message for message in loop(30) if not isinstance(message, Telemetry)])
    assert bench.finish(29) is None
    for seq in range(29, 33):
        bench.feed([timing("sensor", seq, 0.001)])
        bench.wait(0.1)
    assert isinstance(bench.reply, Recorded)


def test_timing_messages_are_written_only_if_they_contain_new_counts(bench: Bench) -> None:
    assert bench.begin() == Ack(0)
    bench.feed(loop(30)[:-1])
    for second in range(25):
        bench.feed([timing("sensor", second, *[0.001] * (second + 1))])
        bench.wait(1.0)
        bench.feed([message for message in loop(30)[:-1] if isinstance(message, Telemetry)])
    bench.feed(loop(30)[-1:])
    bench.finish(29)
    bench.wait(5.0)
    read = mcap_reading.read(bench.jobs / "j-1" / "job.mcap").messages
    kept = [message for message in read if isinstance(message, Timing)]
    assert len(kept) == 3
    assert kept[-1] == timing("sensor", 24, *[0.001] * 25)
