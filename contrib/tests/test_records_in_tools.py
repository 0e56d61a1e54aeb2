"""A record of each kind opens in each tool of the page "Read a record with other tools"."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from time import sleep
from typing import Any
from xml.etree import ElementTree

import pyarrow.parquet
import pytest

from contrib.support.npm import node, npm_folder
from contrib.support.stock_clients import block
from pincette.cli.output_file import for_spreadsheet
from pincette.config import RigFile, read_rig
from pincette.control.planning.program import Program
from pincette.records import csv_export, folder
from pincette.records.number_table import METADATA
from pincette.records.tables import write_tables_of_file
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.replay.desk import Desk, recorded
from tests.support.adapters import SLOWLY, adapter_rig, until
from tests.support.checkout import ROOT
from tests.support.documents import blocks_of
from tests.support.environments import environment, ran
from tests.support.grips import kill, make_ready, restart
from tests.support.running import RunningRig
from tests.support.two_arms import short_grip, two_arm_rig

parquet: Any = pyarrow.parquet
PAGE = "docs/how-to/read-a-record.md"
PYTHON = (
    "csvw==4.1.1",
    "duckdb==2.0.0",
    "fastparquet==2026.9.0",
    "mcap==1.6.0",
    "mcap-protobuf-support==0.6.0",
    "pandas==3.1.1",
    "polars==2.1.0",
)
NODE = ("@mcap/core@2.2.2", "@mcap/nodejs@1.0.2", "fzstd@0.1.1")
CLOSED = ("paused", "queued", "killed", "two arms", "1 kHz")
"""Kinds of records that have tables."""
KINDS = ("live", "broken off", *CLOSED)
SPREADSHEET = "semicolon.csv"
JOBS = "export.numbers.csv"
"""Table of all jobs, which is beside the record of the killed recorder."""
LABELS = {"a,b;c": "=1+1", "µ#夹": 'two "lines"\nof text'}
IN_EACH = """\
import json, os, sys
import {tool}
results = []
for folder in sys.argv[1:]:
    os.chdir(folder)
    {found}
    results.append(found)
print(json.dumps(results))
"""
FRAME = "frame = {recipe}; found = [len(frame), float(frame['force_mN'].max())]"
FRAMES = {
    "pandas": FRAME,
    "polars": FRAME,
    "fastparquet": FRAME,
    "duckdb": "(found,) = duckdb.sql({recipe!r}.replace('max(', 'count(*), max(')).fetchall()",
}
"""Statements that find the number of rows and the largest force, by the Python package."""
MCAP = """\
import json, sys
from collections import Counter
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
def topics(path):
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return Counter(channel.topic for _, channel, _, _ in reader.iter_decoded_messages())
print(json.dumps([topics(path) for path in sys.argv[1:]]))
"""
VALIDATED = """\
import json, sys
from csvw import CSVW
print(json.dumps([CSVW(path, validate=True).is_valid for path in sys.argv[1:]]))
"""


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder with the files of a record of each kind."""
    made = {name: tmp_path_factory.mktemp(name.replace(" ", "-")) for name in KINDS}
    with adapter_rig(tmp_path_factory.mktemp("rig"), SLOWLY) as rig:
        make_ready(rig)
        paused = rig.start_grip(until_released=True)
        queued = rig.start_grip(queue=True, labels=LABELS)
        rig.until_phase(paused, "hold")
        act(rig, paused, "pause")
        sleep(1.0)  # the snapshot ends half a second before now
        download(rig, paused, made["live"], "snapshot.mcap")
        act(rig, paused, "resume")
        act(rig, paused, "release")
        for name, job in (("paused", paused), ("queued", queued)):
            assert rig.ended(job)["record_complete"]
            download(rig, job, made[name], folder.LIVE, folder.SAMPLES)
        killed = rig.start_grip(until_released=True)
        rig.until_phase(killed, "hold")
        kill(rig, "recorder")
        download(rig, killed, made["broken off"], "snapshot.mcap")
        act(rig, killed, "release")
        restart(rig, "recorder")
        assert not rig.ended(killed)["record_complete"]
        # The restarted recorder repairs the record and writes its table somewhat later.
        until(lambda: folder.SAMPLES in artifacts(rig, killed), "no table of the killed record")
        download(rig, killed, made["killed"], folder.LIVE, folder.SAMPLES)
        for name in (JOBS, f"{JOBS}{METADATA}"):
            (made["killed"] / name).write_bytes(rig.client.get(f"/jobs/{name}").content)
    pair, fast = two_arm_rig(), read_rig(ROOT / "deploy/rigs/kilohertz.toml")
    play(made["two arms"], pair, short_grip(pair, 0.4))
    play(made["1 kHz"], fast, plan_job(GripJobRequest(kind="grip"), fast).program)
    for name in CLOSED:
        samples = made[name] / folder.SAMPLES
        numbers = made[name] / csv_export.NUMBERS
        numbers.write_text("".join(csv_export.number_rows(samples)), encoding="utf-8")
        described = "".join(csv_export.number_metadata(samples))
        Path(f"{numbers}{METADATA}").write_text(described, encoding="utf-8")
        text = "".join(csv_export.csv_rows(samples)).encode()
        (made[name] / SPREADSHEET).write_bytes(for_spreadsheet(text, "semicolon"))
    return made


def act(rig: RunningRig, job: str, action: str) -> None:
    until(lambda: action in rig.job(job)["allowed_actions"], f"no {action}")
    rig.post(f"/jobs/{job}/actions", {"type": action}).raise_for_status()


def artifacts(rig: RunningRig, job: str) -> list[str]:
    return [one["name"] for one in rig.get(f"/jobs/{job}/artifacts")["artifacts"]]


def download(rig: RunningRig, job: str, into: Path, *names: str) -> None:
    for name in names:
        answer = rig.client.get(f"/jobs/{job}/artifacts/{name}").raise_for_status()
        (into / name).write_bytes(answer.content)


def play(into: Path, rig: RigFile, program: Program) -> None:
    """Record a program that is played in this process."""
    recorded(into, rig, Desk(rig).play(program, 1), 1)
    assert write_tables_of_file(into).wrong == []


def recipe(tool: str) -> list[str]:
    """Return the code of a tool's recipe on the page."""
    lines = (ROOT / PAGE).read_text("utf-8").splitlines()
    (row,) = [line for line in lines if line.startswith(f"| {tool}")]
    return row.rstrip("| ").rpartition("| ")[2].split("`")[1::2]


def expected(record: Path) -> list[float]:
    """Return the number of rows and the largest force of a record."""
    force_mN = parquet.read_table(record / folder.SAMPLES)["force_mN"].to_pylist()
    return [len(force_mN), max(one for one in force_mN if one is not None)]


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return environment(tmp_path_factory.mktemp("venv") / "venv", *PYTHON)


def test_tables_of_records_open_in_python(
    records: dict[str, Path], python: Path, tmp_path: Path
) -> None:
    folders = [str(records[name]) for name in CLOSED]
    wanted = [expected(records[name]) for name in CLOSED]
    for tool, found in FRAMES.items():
        (code,) = recipe(tool if tool != "duckdb" else "DuckDB")
        script = IN_EACH.format(tool=tool, found=found.format(recipe=code))
        assert json.loads(ran([str(python), "-c", script, *folders])) == wanted, tool
    (tmp_path / "data").mkdir()
    (tmp_path / "data/newest").symlink_to(records["queued"])
    program = block(PAGE, "import duckdb").text
    assert '"force_mN": {"unit": "mN"' in ran([str(python), "-c", program], tmp_path)


def test_numbers_are_valid_csvw(records: dict[str, Path], python: Path, tmp_path: Path) -> None:
    tables = [str(records[name] / csv_export.NUMBERS) for name in CLOSED]
    described = [f"{table}{METADATA}" for table in [*tables, str(records["killed"] / JOBS)]]
    assert json.loads(ran([str(python), "-c", VALIDATED, *described])) == [True] * len(described)
    wrong = tmp_path / csv_export.NUMBERS
    names, _, rows = Path(tables[0]).read_text("utf-8").partition("\n")
    wrong.write_text(f"{names}\nword{rows}", encoding="utf-8")
    shutil.copy(described[0], f"{wrong}{METADATA}")
    assert json.loads(ran([str(python), "-c", VALIDATED, f"{wrong}{METADATA}"])) == [False]


def by_r(words: list[str]) -> list[str]:
    (read,) = words
    shown = "cat(nrow(d), format(max(d$force_mN, na.rm = TRUE), digits = 17))"
    return ["-e", f"d <- {read}; {shown}"]


def by_octave(words: list[str]) -> list[str]:
    (read,) = words
    names = 'names = strsplit(fgetl(fopen("numbers.csv")), ",")'
    shown = 'printf("%d %.17g", rows(d), max(d(:, strcmp(names, "force_mN"))))'
    return ["--eval", f"d = {read}; {names}; {shown}"]


def by_gnuplot(words: list[str]) -> list[str]:
    separator, plot = words
    shown = 'stats "numbers.csv" using "force_mN" nooutput; set print "-"'
    shown += '; print sprintf("%d %.17g", STATS_records + STATS_invalid, GPVAL_DATA_Y_MAX)'
    return ["-e", f"set terminal unknown; {separator}; {plot}; {shown}"]


PROGRAMS: dict[str, tuple[str, Callable[[list[str]], list[str]]]] = {
    "R ": ("Rscript", by_r),
    "Octave": ("octave-cli", by_octave),
    "gnuplot": ("gnuplot", by_gnuplot),
}


def needs(program: str) -> pytest.MarkDecorator:
    """Return a mark that skips a test before its fixtures if a program is not installed."""
    missing = shutil.which(program) is None
    return pytest.mark.skipif(missing, reason=f"{program} is not installed")


@pytest.mark.parametrize(
    "tool", [pytest.param(tool, marks=needs(program)) for tool, (program, _) in PROGRAMS.items()]
)
def test_numeric_tables_open_in_other_languages(records: dict[str, Path], tool: str) -> None:
    program, words = PROGRAMS[tool]
    for name in CLOSED:
        found = ran([program, *words(recipe(tool))], records[name]).split()
        assert [float(one) for one in found] == expected(records[name]), name


@needs("soffice")
def test_samples_open_in_a_german_spreadsheet(records: dict[str, Path], tmp_path: Path) -> None:
    """LibreOffice converts the file as its import dialogue would: UTF-8, semicolon, German."""
    for name in CLOSED:
        opened = "--infilter=CSV:59,34,76,1,,1031,false,true"
        line = ["soffice", f"-env:UserInstallation=file://{tmp_path}/profile", "--headless", opened]
        source = str(records[name] / SPREADSHEET)
        ran([*line, "--convert-to", "fods", "--outdir", str(tmp_path), source])
        rows = cells(tmp_path / "semicolon.fods")
        place = next(row.index("force_mN") for row in rows if "force_mN" in row)
        force_mN = [row[place] for row in rows if row and isinstance(row[0], float)]
        found = [len(force_mN), max(one for one in force_mN if one is not None)]
        assert found == pytest.approx(expected(records[name]), rel=1e-12), name


def cells(path: Path) -> list[list[Any]]:
    """Return the rows of the first sheet of a flat OpenDocument: numbers, texts and None."""
    office, table = (
        f"{{urn:oasis:names:tc:opendocument:xmlns:{one}:1.0}}" for one in ("office", "table")
    )
    rows: list[list[Any]] = []
    for row in ElementTree.parse(path).iter(f"{table}table-row"):
        found: list[Any] = []
        for cell in row.iter(f"{table}table-cell"):
            value = cell.get(f"{office}value")
            text = "".join(cell.itertext()).strip() or None
            times = int(cell.get(f"{table}number-columns-repeated", "1"))
            found += [text if value is None else float(value)] * min(times, 100)
        rows.append(found)
    return rows


def files(records: dict[str, Path]) -> list[str]:
    """Return the path of the MCAP file of each record."""
    return [str(next(records[name].glob("*.mcap"))) for name in KINDS]


def test_messages_open_in_python_and_typescript(
    records: dict[str, Path], python: Path, tmp_path: Path
) -> None:
    found = json.loads(ran([str(python), "-c", MCAP, *files(records)]))
    assert all(counts["estimate"] > 0 for counts in found)
    script = tmp_path / "topics.mjs"
    (program,) = (one.text for one in blocks_of(ROOT / PAGE) if one.language == "js")
    script.write_text(program, encoding="utf-8")
    scripts = npm_folder(tmp_path / "npm", script, *NODE)
    assert [node(scripts, script.name, file) for file in files(records)] == found


def test_messages_open_in_rerun(records: dict[str, Path], tmp_path: Path) -> None:
    rerun = str(Path(sys.executable).with_name("rerun"))
    home = {"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)}
    for source in files(records):
        target = str(tmp_path / "job.rrd")
        ran([rerun, "mcap", "convert", source, "--output", target], more=home)
        assert "pincette.Estimate:message" in ran([rerun, "rrd", "print", "-v", target], more=home)
