"""A rig that starts with a damaged model, or on the ports of a running rig: nothing moves, and
the fault is reported with the remedy."""

from contextlib import closing
from pathlib import Path

from pincette.core.messages import Applied
from pincette_supervisor.config import MODELS, STORE
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model import RigModel
from tests.support.commands import pincette
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import paced_rig, rig_toml
from tests.support.running import running_rig
from tests.support.witness import witness

LONG_S = 180.0
"""Longest time of a command on a busy machine, in s."""


def test_a_damaged_model_moves_nothing_and_is_named_with_the_remedy(tmp_path: Path) -> None:
    rig_file, models = paced_rig(SHORT), tmp_path / "data" / MODELS
    with closing(Store(tmp_path / "data" / STORE)) as store:
        model = RigModel(rig_file, models, store)
        model.add({"model.compliance_um_per_mN": 0.44}, {}, "a calibration")
    (damaged,) = models.rglob("0001-*.json")
    whole = damaged.read_text(encoding="utf-8")
    damaged.write_text(whole.replace("0.44", "0.94"), encoding="utf-8")
    with running_rig(rig_file, tmp_path) as rig, witness(rig_file) as seen:
        answer = rig.post("/jobs", {"kind": "grip", "autostart": True})
        assert answer.status_code == 503, answer.text
        reasons = " ".join(answer.json()["reasons"])
        # the message names the file and the remedy
        for fact in (damaged.name, "pincette model use 0"):
            assert fact in reasons
        shown = pincette("model", "show", "--url", rig.rig.supervisor.url, timeout_s=LONG_S).stdout
        assert damaged.name in shown
        refused = pincette("model", "use", "1", "--url", rig.rig.supervisor.url, timeout_s=LONG_S)
        assert refused.returncode == 1
        assert damaged.name in refused.stderr
        assert {echo.arms[0].voltage_V for _, echo in seen.since(Applied, 0.0)} <= {0.0}

        damaged.write_text(whole, encoding="utf-8")
        mended = pincette("model", "use", "1", "--url", rig.rig.supervisor.url, timeout_s=LONG_S)
        assert mended.returncode == 0, mended.stderr
        make_ready(rig)
        assert rig.ended(rig.start_grip())["state"] == "succeeded"


def test_a_rig_on_the_ports_of_another_does_not_start_and_the_first_continues(
    tmp_path: Path,
) -> None:
    rig_file, path, data = paced_rig(SHORT), tmp_path / "other.toml", tmp_path / "other"
    other = rig_file.model_copy(update={"rig": rig_file.rig.model_copy(update={"name": "other"})})
    path.write_text(rig_toml(other), encoding="utf-8")
    with running_rig(rig_file, tmp_path) as rig:
        make_ready(rig)
        job = rig.start_grip(until_released=True)
        rig.until_phase(job, "hold")
        for second in (rig.path, path):
            done = pincette("up", "--rig", second, "--data", data, timeout_s=LONG_S)
            assert done.returncode == 1
            assert f":{rig_file.bus.port} " in done.stderr  # the port that is in use
            assert "router" in done.stderr
        assert rig.fleet.ended() == []
        assert rig.job(job)["progress"]["phase"] == "hold"
        rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
        assert rig.ended(job)["state"] == "succeeded"
