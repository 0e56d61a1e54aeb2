"""The examples of the documents, each run as by a reader: in a separate process."""

import csv
import json
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from math import isnan
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import matplotlib.image
import pyarrow.parquet as parquet
import pytest

from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.messages import Applied, Estimate, Position
from pincette.core.topics import LOOP, POSITION, TOPICS, key
from tests.support.arms import with_arm
from tests.support.checkout import ROOT, await_text, environment, run, until_interrupted
from tests.support.foreign import declared, outsider
from tests.support.played import RIG, Played, played_rig
from tests.support.rigs import demo_rig
from tests.support.routed import router
from tests.support.served import served
from tests.unit.supervisor import samples
from tests.unit.supervisor.harness import Harness

EXAMPLES = ROOT / "docs/examples"
FREE_OF_US = ("csv_export", "latest", "live_plot", "place", "record_csv", "subscribe")
OF_THEIR_OWN = {"orchestrator", "ros2_bridge", "tray"}
"""Examples with a separate page and test."""
FOREIGN = {"matplotlib", "msgpack", "zenoh"}
LONGEST = 80
PATIENCE_S = 30.0
UNKNOWN_V = 55.5
"""Voltage of messages that state that the output has not confirmed it."""
COLOURED = 0.3
"""Smallest difference between the colour channels of a curve; grey has none."""


@pytest.fixture(scope="module")
def played() -> Generator[Played]:
    with played_rig() as rig:
        yield rig


def command(name: str, *arguments: str) -> list[str]:
    return [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments]


def listening(name: str, played: Played, *arguments: str) -> list[str]:
    return command(name, "--router", played.router, "--rig", RIG, *arguments)


def done(words: list[str], folder: Path) -> str:
    """Return the output of a command that succeeds."""
    ended = run(words, folder, PATIENCE_S)
    assert ended.returncode == 0, ended.stdout
    return ended.stdout


@pytest.mark.parametrize("name", FREE_OF_US)
def test_an_example_is_short_and_does_not_import_pincette(name: str) -> None:
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < LONGEST
    needed = set(re.findall(r"^(?:import|from) (\w+)", text, re.MULTILINE))
    assert needed - sys.stdlib_module_names <= FOREIGN


def test_every_example_is_tested() -> None:
    text = (ROOT / "docs/how-to/listen.md").read_text(encoding="utf-8")
    assert {path.stem for path in EXAMPLES.glob("*.py")} - OF_THEIR_OWN == set(FREE_OF_US)
    assert all(f"examples/{name}.py" in text for name in FREE_OF_US)


@pytest.mark.parametrize("kind", ["", "store"])
def test_the_example_named_latest_prints_every_topic_once(
    played: Played, tmp_path: Path, kind: str
) -> None:
    with ExitStack() as stack:
        if kind:
            tool = stack.enter_context(outsider("client", played.router))
            stack.enter_context(declared(tool, kind))
        output = done(listening("latest", played), tmp_path)
    reported = output.splitlines()[-1].removeprefix("no message: ").split(", ")
    assert set(reported) == {
        "burst",
        "job",
        *(f"{topic}/{service}" for topic in ("request_log", "timing") for service in LOOP),
    }
    seen = re.findall(r"^(\w+) +(\w+) +", output, re.MULTILINE)
    assert len(seen) == len(set(seen))
    assert {topic for topic, _ in seen} == {
        "position",
        "estimate",
        "command",
        "telemetry",
        "applied",
        "ground_truth",
    }
    assert ("estimate", "arm_1_force_uncertainty_mN") in seen
    root = key("demo", POSITION).removesuffix(POSITION.name)
    known = {key("demo", topic, one).removeprefix(root) for topic in TOPICS for one in LOOP}
    assert set(reported) | {topic for topic, _ in seen} == known


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def assert_is_what_was_played(rows: list[dict[str, str]], played: Played) -> None:
    for row in rows:
        tick = played.ticks[int(row["seq"])]
        assert float(row["t_s"]) == tick.position.t_s
        assert float(row["x_um"]) == tick.estimate.arms[0].x_um
        assert float(row["force_mN"]) == tick.estimate.arms[0].force_mN
        assert float(row["voltage_V"]) == tick.applied.arms[0].voltage_V


def test_csv_contains_every_sample_with_all_columns(played: Played, tmp_path: Path) -> None:
    output = done(listening("csv_export", played, "--count", "60", "--file", "rig.csv"), tmp_path)
    assert output == "60 rows, 0 of them incomplete\n"
    rows = rows_of(tmp_path / "rig.csv")
    assert len(rows) == 60
    assert_is_what_was_played(rows, played)
    numbers = [(int(row["epoch"]), int(row["seq"])) for row in rows]
    assert numbers == sorted(set(numbers))


def test_ctrl_c_ends_the_csv_example(played: Played, tmp_path: Path) -> None:
    path = tmp_path / "rig.csv"
    process = subprocess.Popen(
        listening("csv_export", played, "--file", str(path)),
        env=environment(),
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = monotonic() + PATIENCE_S
    while not path.exists() or len(rows_of(path)) < 10:
        assert process.poll() is None
        assert monotonic() < deadline
        sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, output = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, output
    rows = rows_of(path)
    ended = re.fullmatch(r"(\d+) rows, (\d+) of them incomplete\n", output)
    assert ended is not None, output
    assert (int(ended[1]), int(ended[2]) < 3) == (len(rows), True)
    assert_is_what_was_played(rows[: -int(ended[2]) or None], played)


@contextmanager
def publishing() -> Generator[tuple[ZenohBus, str]]:
    """Serve a bus that publishes like a rig's programs; yields it and the address of its router."""
    with router(RIG) as ends:
        bus = ZenohBus(ends, RIG, "played")
        yield bus, ends.connect[0]
        bus.close()


def publish_until_ended(
    bus: ZenohBus, process: "subprocess.Popen[str]", pause_s: float = 0.0
) -> None:
    """Publish arming after arming, since the time at which the process subscribes is unknown.

    Sample 2 is not valid, 3 has an unconfirmed voltage, and the estimate of 4 is lost. On a busy
    machine messages of a burst may be dropped: ``pause_s`` is the time between two samples.
    """
    position, estimate, applied = (
        message
        for message in samples.grip(1)[0].messages()
        if isinstance(message, Position | Estimate | Applied)
    )
    end, epoch = monotonic() + PATIENCE_S, 1
    while process.poll() is None and monotonic() < end:
        for seq in range(80):
            for message in (position, estimate, applied):
                if seq == 4 and message is estimate:
                    continue
                changes: dict[str, Any] = {"epoch": epoch, "seq": seq}
                if message is applied:
                    changes |= {"unconfirmed": seq == 3, "voltage_V": UNKNOWN_V if seq == 3 else 1}
                else:
                    changes["valid"] = seq != 2
                bus.publish(with_arm(message, **changes))
            sleep(pause_s)
        epoch += 1
        sleep(0.05)


def test_csv_leaves_invalid_fields_empty_and_keeps_samples_with_a_lost_message(
    tmp_path: Path,
) -> None:
    with publishing() as (bus, place):
        words = command("csv_export", "--router", place, "--rig", RIG, "--count", "100")
        process = subprocess.Popen(
            [*words, "--file", str(tmp_path / "rig.csv")],
            env=environment(),
            stderr=subprocess.PIPE,
            text=True,
        )
        publish_until_ended(bus, process, pause_s=0.002)
        _, output = process.communicate(timeout=PATIENCE_S)
    rows = rows_of(tmp_path / "rig.csv")
    # The first arming may be received from its middle on; the second one begins within 100 rows.
    second = sorted({int(row["epoch"]) for row in rows})[1]
    measured = ("x_um", "force_mN", "voltage_V")
    filled = {
        int(row["seq"]): [bool(row[name]) for name in measured]
        for row in rows
        if int(row["epoch"]) == second
    }
    wanted = {2: [False, False, True], 3: [True, True, False], 4: [True, False, True]}
    assert {seq: filled[seq] for seq in wanted} == wanted
    assert all(all(cells) for seq, cells in filled.items() if seq not in wanted)
    incomplete = sum(row["seq"] == "4" for row in rows)
    assert output == f"100 rows, {incomplete} of them incomplete\n"


ENDLESS: dict[str, tuple[str, str]] = {
    "live_plot": ("", "drawn"),
    "place": ("", "is published on"),
    "ros2_bridge": ("--ros", "ready"),
}
"""Examples that run until Ctrl-C: an option that takes a router, and a word of their output."""


@pytest.mark.parametrize("name", ENDLESS)
def test_ctrl_c_ends_an_example_without_a_traceback(
    name: str, played: Played, tmp_path: Path
) -> None:
    option, word = ENDLESS[name]
    log = tmp_path / "log"
    words = listening(name, played, *([option, played.router] if option else []))
    if name == "live_plot":  # it prints nothing; each of its drawings does here
        script = tmp_path / "live_plot.py"
        text = (EXAMPLES / "live_plot.py").read_text(encoding="utf-8")
        changed = text.replace("matplotlib\n", 'matplotlib\nmatplotlib.use("Agg")\n', 1)
        script.write_text(
            changed.replace(
                "        draw()\n", '        draw()\n        print("drawn", flush=True)\n', 1
            ),
            encoding="utf-8",
        )
        words[1] = str(script)
    with until_interrupted(words, tmp_path, log) as process:
        await_text(log, word, process, PATIENCE_S)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0, log.read_text(encoding="utf-8")
    assert "Traceback" not in log.read_text(encoding="utf-8")


def test_subscribe_prints_no_unconfirmed_voltage(tmp_path: Path) -> None:
    with publishing() as (bus, place):
        text = (EXAMPLES / "subscribe.py").read_text(encoding="utf-8")
        assert "tcp/127.0.0.1:7447" in text
        script = tmp_path / "subscribe.py"
        changed = text.replace("tcp/127.0.0.1:7447", place).replace("/demo/", f"/{RIG}/")
        script.write_text(changed, encoding="utf-8")
        process = subprocess.Popen(
            [sys.executable, str(script)],
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        publisher = threading.Thread(target=publish_until_ended, args=(bus, process))
        publisher.start()
        assert process.stdout is not None
        output = [process.stdout.readline() for _ in range(400)]
        process.send_signal(signal.SIGINT)
        publisher.join()
        _, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, errors) == (0, "")
    assert not [line for line in output if f"{UNKNOWN_V:.4f} V" in line]
    assert sum("not confirmed" in line for line in output) >= 2
    assert sum("not valid" in line for line in output) >= 2
    assert sum(line.endswith("1.0000 V\n") for line in output) > 100


def test_a_plot_has_a_gap_where_the_voltage_is_not_confirmed_or_a_sample_is_lost(
    tmp_path: Path,
) -> None:
    """The script draws once into a file; its curves are read there, before it ends."""
    with publishing() as (bus, place):
        script, curves = tmp_path / "live_plot.py", tmp_path / "curves.json"
        text = (EXAMPLES / "live_plot.py").read_text(encoding="utf-8")
        script.write_text(
            text
            + "import json\n"
            + "found = {name: [list(map(float, xy)) for xy in curve.get_data()]"
            + " for name, curve in curves.items()}\n"
            + f"open({str(curves)!r}, 'w').write(json.dumps(found))\n",
            encoding="utf-8",
        )
        words = ["--router", place, "--rig", RIG, "--png", str(tmp_path / "rig.png")]
        process = subprocess.Popen(
            [sys.executable, str(script), *words, "--seconds", "2"], env=environment(), text=True
        )
        publish_until_ended(bus, process, pause_s=0.001)
        assert process.wait(PATIENCE_S) == 0
    found: dict[str, tuple[list[float], list[float]]] = json.loads(curves.read_text())
    voltages_V = found["voltage_V"][1]
    assert UNKNOWN_V not in voltages_V
    assert 1.0 in voltages_V
    assert sum(map(isnan, voltages_V)) >= 1
    assert sum(map(isnan, found["x_um"][1])) >= 1


def test_a_plot_has_its_curves(played: Played, tmp_path: Path) -> None:
    picture = tmp_path / "rig.png"
    done(listening("live_plot", played, "--png", str(picture), "--seconds", "1"), tmp_path)
    pixels = cast(Any, matplotlib.image.imread(picture))[:, :, :3]
    coloured = pixels.max(axis=2) - pixels.min(axis=2) > COLOURED
    height = round(0.3 * len(coloured))  # curves of a panel; the rest is the label of the time axis
    for panel in range(3):
        columns = coloured[panel * height : (panel + 1) * height].any(axis=0)
        assert columns.sum() > 0.5 * len(columns), f"panel {panel} has no curve"


@pytest.fixture(scope="module")
def gripped(tmp_path_factory: pytest.TempPathFactory) -> Generator[tuple[Path, str]]:
    """Provide a supervisor with a record of one job: the folder of the record, and the address
    of REST."""
    folder = tmp_path_factory.mktemp("gripped")
    desk = Harness(demo_rig(time="lockstep"), folder)
    job = desk.grip()["id"]
    assert desk.ended(job)["state"] == "succeeded"
    with served(desk.app) as address:
        yield folder / "jobs" / job, f"{address}/api/v1"
    desk.close()


def test_a_record_is_exported_as_csv(gripped: tuple[Path, str], tmp_path: Path) -> None:
    record, api = gripped
    output = done(command("record_csv", "--api", api, "--file", "job.csv"), tmp_path)
    assert output == f"{record.name}: job.csv\n"
    table = cast(Any, parquet).read_table(record / "samples.parquet")
    rows = rows_of(tmp_path / "job.csv")
    assert list(rows[0]) == table.column_names
    for name in ("t_s", "x_um", "force_mN", "voltage_V"):
        assert [float(row[name]) for row in rows] == table[name].to_pylist()
    assert "# force_mN [mN]" in (tmp_path / "job.csv").read_text(encoding="utf-8")


def test_a_missing_record_is_refused_with_a_reason(
    gripped: tuple[Path, str], tmp_path: Path
) -> None:
    ended = run(command("record_csv", "none", "--api", gripped[1]), tmp_path, PATIENCE_S)
    assert ended.returncode == 1
    assert "none" in ended.stdout
    assert "Traceback" not in ended.stdout
