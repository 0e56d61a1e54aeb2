"""``pincette latency``: its output and chart of a measurement, and its exit status."""

import json
from pathlib import Path

import pytest

from pincette.cli import Exit
from pincette.cli.latency import bars
from pincette.cli.main import main
from pincette.config.programs import Scheduling
from pincette.engine.measuring.machine import Findings, MeasuringError, Progress
from pincette.latency.rule import Measured
from tests.support.histograms import counted

HOP = counted([0.0002] * 1000)


class Machine:
    """A machine with a completed measurement."""

    def __init__(self, late_s: float, refused: str = "") -> None:
        self.late_s, self.refused = late_s, refused
        self.kept: list[Findings] = []
        self.asked: list[tuple[tuple[float, ...], float, Scheduling, bool]] = []

    def measure(
        self,
        periods_s: tuple[float, ...],
        for_s: float,
        scheduling: Scheduling,
        progress: Progress,
        *,
        loaded: bool,
    ) -> Findings:
        self.asked.append((periods_s, for_s, scheduling, loaded))
        progress("wake-ups", for_s)
        found = [Measured(one, counted([self.late_s] * 1000), 0) for one in periods_s]
        return Findings(tuple(found), HOP, self.refused, "Linux 6", 2, 0.25, loaded)

    def keep(self, _data: Path, found: Findings, _measured_at: str) -> None:
        self.kept.append(found)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    made = Machine(0.0003)
    monkeypatch.setattr("pincette.engine.measuring.machine.measure", made.measure)
    monkeypatch.setattr("pincette.engine.measuring.kept.keep", made.keep)
    return made


def test_the_shortest_period_is_reported(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["latency", "--seconds", "7"]) == Exit.DONE
    output, progress = capsys.readouterr()
    assert "supported: 5 ms and longer (200 Hz)" in output
    assert "not 2 ms: p99.9 of the lateness: 0.3 ms, limit 0.1 T = 0.2 ms" in output
    assert "[rig] period_s = 0.02 with the law pbsmic, as four programs" in output
    assert "A period T is supported if, of at least 100 wake-ups" in output
    assert "the machine's host took 0.25 s" in output
    assert progress == "wake-ups: 7.0 s\n"
    ((periods_s, for_s, _, loaded),) = machine.asked
    assert (max(periods_s), min(periods_s), for_s, loaded) == (0.02, 0.001, 7.0, False)


def test_if_a_period_is_given_no_other_is_measured(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["latency", "--period-s", "0.002", "--load"]) == Exit.FAILED
    assert "supported: none of these periods" in capsys.readouterr().out
    assert machine.asked[0][0] == (0.002,)
    assert machine.asked[0][3] is True


def test_json_output_is_one_document(
    machine: Machine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine.refused = "locked memory (memlock limit 64 KiB)"
    picture = tmp_path / "late.png"
    assert main(["latency", "--json", "--plot", str(picture)]) == Exit.DONE
    tree = json.loads(capsys.readouterr().out)
    assert tree["shortest_supported_s"] == 0.005
    assert tree["recommended"] == {"period_s": 0.02, "scheme": "pbsmic", "composed": []}
    assert tree["refused"] == machine.refused
    assert [one["supported"] for one in tree["periods"]] == [True, True, True, False, False]
    late = tree["periods"][0]["lateness"]
    assert late["count"] == sum(late["counts"]) == 1000
    assert late["max_s"] == late["p999_s"] == 0.0003
    assert tree["hop"]["max_s"] == 0.0002
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_rig_file_states_the_requested_scheduling(machine: Machine, tmp_path: Path) -> None:
    text = Path("deploy/rigs/demo.toml").read_text(encoding="utf-8")
    rig = tmp_path / "rig.toml"
    rig.write_text(f"{text}\n[realtime]\npriority = {{ sensor = 33 }}\n", encoding="utf-8")
    assert main(["latency", "--rig", str(rig)]) == Exit.DONE
    assert machine.asked[0][2].priority == 33


def test_a_measurement_is_stored_and_the_suitable_settings_are_reported(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    machine.late_s = 0.031
    words = ["latency", "--rig", "deploy/rigs/demo.toml"]
    assert main(words) == Exit.FAILED
    assert len(machine.kept) == 1
    output = capsys.readouterr().out
    assert "suits this machine: [safety] command_age_periods = 4.5 (" in output
    assert main([*words, "--json"]) == Exit.FAILED
    (change,) = json.loads(capsys.readouterr().out)["changes"]
    assert (change["key"], change["value"]) == ("[safety] command_age_periods", "4.5")


def test_a_machine_that_cannot_be_measured_is_reported(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **_also: object) -> Findings:
        raise MeasuringError("no bus")

    monkeypatch.setattr("pincette.engine.measuring.machine.measure", fail)
    assert main(["latency"]) == Exit.FAILED
    assert "this machine could not be measured: no bus" in capsys.readouterr().err
    assert machine.asked == []


@pytest.mark.parametrize(
    "words", [["--seconds", "0"], ["--period-s", "2"], ["--period-s", "nan"], ["--seconds", "x"]]
)
def test_impossible_measurements_are_refused(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["latency", *words]) == Exit.USAGE
    assert "cannot be used" in capsys.readouterr().err


def test_a_histogram_is_printed_on_one_line() -> None:
    assert bars(counted([])).strip() == ""
    line = bars(counted([1.05e-6] + [1.05e-3] * 999 + [1e3]))
    assert len(line) == 15
    assert [place for place, bar in enumerate(line) if bar != " "] == [0, 9, 14]
    assert line[9] == "█"
