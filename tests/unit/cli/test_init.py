"""``pincette init``: its prompts, and the rig file that it writes."""

from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from pincette.cli.main import main
from pincette.config import read_rig
from pincette.config.bench_form import NUMBERED
from pincette.core import plugins
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present

ROOT = Path(__file__).parents[3]


class Terminal(StringIO):
    """A terminal with typed input."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return tmp_path / "bench.toml"


def typing(monkeypatch: pytest.MonkeyPatch, answers: Iterator[str]) -> list[str]:
    """Type a reply to each prompt; returns the prompts."""
    requests: list[str] = []

    def answer(question: str) -> str:
        requests.append(question)
        return next(answers, "")

    monkeypatch.setattr("sys.stdin", Terminal())
    monkeypatch.setattr("builtins.input", answer)
    return requests


def test_with_all_defaults_init_writes_the_rig_file_of_a_real_bench(bench: Path) -> None:
    assert main(["init", str(bench), "--yes"]) == 0
    written = bench.read_text(encoding="utf-8")
    assert written == (ROOT / "deploy/rigs/real-bench.toml").read_text(encoding="utf-8")
    rig = read_rig(bench)
    assert rig.simulation is None
    assert rig.rig.time == "real"


def test_a_file_is_never_overwritten(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench.write_text("mine", encoding="utf-8")
    assert main(["init", str(bench), "--yes"]) == 1
    assert bench.read_text(encoding="utf-8") == "mine"
    assert "exists already" in capsys.readouterr().err


def test_each_option_replaces_one_question(bench: Path) -> None:
    words = ["--name", "left", "--force-max-mN", "12", "--grip-force-mN", "5", "--period-s", "0.05"]
    words += ["--amplifier-gain", "10", "--arm-min-V", "0", "--arm-max-V", "60"]
    words += ["--free-stroke-um", "90", "--sensor-url", "socket://127.0.0.1:7461"]
    words += ["--output", "srs_dc205", "--output-option", "baud=9600"]
    assert main(["init", str(bench), "--yes", *words]) == 0
    rig = read_rig(bench)
    assert (rig.rig.name, rig.rig.period_s) == ("left", 0.05)
    assert (rig.limits.voltage_min_V, rig.limits.voltage_max_V) == (0.0, 6.0)
    assert rig.model.piezo_um_per_V == 15.0
    assert (rig.limits.force_max_mN, rig.grip.force_mN) == (12.0, 5.0)
    assert rig.sensor.url == "socket://127.0.0.1:7461"
    assert (rig.output.driver, rig.output.options["baud"]) == ("srs_dc205", 9600)
    assert rig.output.on_silence == "holds"  # it has no watchdog


def test_every_question_states_its_unit_its_default_and_where_to_look(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requested = typing(monkeypatch, iter(()))
    assert main(["init", str(bench)]) == 0
    for question in NUMBERED:
        (text,) = [one for one in requested if one.startswith(question.words)]
        assert f"[{question.default}]" in text
        assert f"({question.where})" in text
        assert not question.unit or f" in {question.unit} " in text
    drivers = next(text for text in requested if "driver of the voltage output" in text)
    assert all(name in drivers for name in plugins.names(plugins.VOLTAGE_OUTPUTS))
    assert any(text.startswith("watchdog_s: ") for text in requested)


def broken(bench: Path, **wish: Any) -> set[str]:
    """Return the quantities whose limits a plan on the new rig would break."""
    plan = plan_job(REQUEST.validate_python(wish), read_rig(bench), Present(0.0, 0.0)).plan
    return {str(one.quantity) for one in plan.violations}


SWING: dict[str, Any] = {
    "kind": "track",
    "shape": "sinusoid",
    "force_mean_mN": 12.0,
    "force_pp_mN": 20.0,
    "frequency_hz": 5.0,
}


def test_init_asks_for_every_limit_that_default_jobs_would_exceed(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requested = typing(monkeypatch, iter(()))
    assert main(["init", str(bench)]) == 0
    assert broken(bench, kind="grip", force_mN=30.0) == set()
    assert broken(bench, **SWING) <= {"slew", "rate", "acceleration"}
    needed = {
        one.flag: one.where.split(", ")[-1].removesuffix(" at 5 Hz").split()[-1]
        for one in NUMBERED
        if one.where.endswith(" at 5 Hz")
    }
    for flag, value in needed.items():
        assert any(f"{value} at 5 Hz" in text for text in requested), flag
    bench.unlink()
    words = [word for pair in needed.items() for word in pair]
    assert main(["init", str(bench), "--yes", *words]) == 0
    assert broken(bench, **SWING) == set()


def test_init_asks_again_after_an_invalid_number(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requested = typing(monkeypatch, iter(["mine", "fast", "0.04"]))
    assert main(["init", str(bench)]) == 0
    assert requested[1] == requested[2]
    assert read_rig(bench).rig.period_s == 0.04


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        ([], 2, "--yes uses the defaults"),
        (["--yes", "--name", "No Name"], 2, "rig.name"),
        (["--yes", "--arm-min-V", "90"], 2, "give no range"),
        (["--yes", "--sensor", "other"], 2, "there are"),
        (["--yes", "--sensor", "nidaqmx"], 2, "um_per_V"),
        (["--yes", "--output-option", "bauds=1"], 2, "has no option bauds"),
        (["--yes", "--on-silence", "perhaps"], 2, "safe or holds"),
    ],
)
def test_impossible_answers_write_no_rig_file(
    bench: Path, capsys: pytest.CaptureFixture[str], words: list[str], status: int, said: str
) -> None:
    assert main(["init", str(bench), *words]) == status
    assert said in capsys.readouterr().err
    assert not bench.exists()
