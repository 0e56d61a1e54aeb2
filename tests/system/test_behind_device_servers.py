"""Rigs whose instruments are behind real device servers: the force of a grip, and the findings
of doctor."""

import json
import subprocess
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from time import monotonic, sleep
from typing import Any, cast

import httpx
import pyarrow.parquet as parquet
import pytest

from pincette.config import RigFile
from pincette.diagnostics.hops import DEFAULT_HELD_S
from pincette.engine.fleet import LOOP, Fleet
from tests.support.device_servers import ser2net, socat
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig, rig_toml
from tests.support.running import Json, RunningRig

pytestmark = [pytest.mark.usefixtures("stalls"), pytest.mark.real_time]

START = {
    "ser2net": partial(ser2net, options="chardelay: false"),
    "ser2net that waits": ser2net,
    "socat": socat,
}


@contextmanager
def rig_behind(name: str, folder: Path, time: str = "real") -> Generator[RunningRig]:
    """Run a rig whose instruments are connected to terminals, directly or behind servers of one
    kind."""
    near = demo_rig(SHORT, time=time)
    urls = {table: str(folder / table) for table in ("sensor", "output")}
    near = near.model_copy(
        update={
            table: getattr(near, table).model_copy(update={"url": url})
            for table, url in urls.items()
        }
    )
    path = folder / "instruments.toml"
    path.write_text(rig_toml(near), encoding="utf-8")
    with ExitStack() as running:
        instruments = Fleet(near, path, folder / "data", lambda _name, _line: None)
        running.callback(instruments.down)
        instruments.start(["router", "rig"])
        far = near
        for table, url in urls.items() if name in START else ():
            place = folder / f"{table}.server"
            place.mkdir()
            server = running.enter_context(START[name](url, place))
            one = getattr(far, table).model_copy(update={"url": server.url})
            far = far.model_copy(update={table: one})
        path = folder / "rig.toml"
        path.write_text(rig_toml(far), encoding="utf-8")
        fleet = Fleet(far, path, folder / "data", lambda _name, _line: None)
        running.callback(fleet.down)
        fleet.start_each(dict.fromkeys((*LOOP, "recorder", "supervisor"), ()))
        client = running.enter_context(
            httpx.Client(base_url=f"{far.supervisor.url}/api/v1", timeout=30.0, trust_env=False)
        )
        yield RunningRig(far, path, folder / "data", fleet, client)


def grip(name: str, folder: Path) -> Json:
    folder.mkdir()
    with rig_behind(name, folder) as rig:
        make_ready(rig, 30.0)
        job = rig.ended(rig.start_grip(hold_s=1.0), 60.0)
        assert job["state"] == "succeeded", job["cause"]
        result: Json = job["result"]
        return result


COLUMNS = ("seq", "x_um", "force_mN", "force_uncertainty_mN", "voltage_V", "phase", "true_force_mN")


def test_in_lockstep_the_same_grip_gives_identical_numbers(
    tmp_path: Path,
) -> None:
    tables: dict[str, Json] = {}
    for name in ("direct", "ser2net", "socat"):
        folder = tmp_path / name
        folder.mkdir()
        with rig_behind(name, folder, "lockstep") as rig:
            job = rig.ended(rig.start_grip(hold_s=0.5), 120.0)
            assert job["state"] == "succeeded", job["cause"]
            samples = Path(job["record"]) / "samples.parquet"
            tables[name] = cast(Any, parquet).read_table(samples, columns=list(COLUMNS)).to_pydict()
    assert len(tables["direct"]["seq"]) > 100
    for column in COLUMNS:
        for name in ("ser2net", "socat"):
            assert tables[name][column] == tables["direct"][column], (name, column)


READ_S = 20.0


def with_instruments(rig: RunningRig) -> list[Json]:
    return [one for one in rig.view()["programs"] if one["name"] in ("sensor", "actuator")]


def test_doctor_and_bring_up_name_a_server_that_holds_answers_on_a_running_rig(
    tmp_path: Path,
) -> None:
    """The figures come from the programs: the server admits one client, which is the program."""
    with rig_behind("ser2net that waits", tmp_path) as rig:
        until_s = monotonic() + READ_S
        while not all(one["exchanges"] for one in with_instruments(rig)):
            assert monotonic() < until_s
            sleep(0.1)
        make_ready(rig, 30.0)
        command = ["doctor", "--rig", str(rig.path), "--data", str(rig.data), "--json"]
        found = json.loads(pincette(*command).stdout)
        shown = pincette("bring-up", "--list", "--url", rig.rig.supervisor.url).stdout
        # A copy of the rig file with other ports: doctor finds no rig there, and opens instruments.
        copy = tmp_path / "copy.toml"
        copy.write_text(rig_toml(real(at_other_ports(rig.rig))), encoding="utf-8")
        refused = json.loads(pincette("doctor", "--rig", str(copy), "--json").stdout)
        programs = with_instruments(rig)
    for table in ("sensor", "output"):
        url = getattr(rig.rig, table).url
        about = [one for one in found if url in one["what"]]
        assert any("median" in one["what"] for one in about)
        assert not any("in use" in one["what"] for one in about)
        if table == "sensor":  # only an arming sends an output enough requests
            assert any("chardelay: false" in one["remedy"] for one in about if one["note"]), about
    assert any(one["what"].startswith("timing, measured") for one in found)
    assert "chardelay: false" in shown
    (sensor,) = (one for one in programs if one["name"] == "sensor")
    assert sensor["exchanges"][0]["held_s"] >= DEFAULT_HELD_S
    for table in ("sensor", "output"):
        assert any(table in one["what"] and "in use by process" in one["what"] for one in refused)
    for program in programs:
        assert program["instrument"]["reopened"] == 0
        assert program["instrument"]["unexpected"] == 0


def at_other_ports(rig: RigFile) -> RigFile:
    """Return a rig with the same instruments on other ports."""
    other = demo_rig(SHORT)
    return rig.model_copy(update={"bus": other.bus, "supervisor": other.supervisor})


def real(rig: RigFile) -> RigFile:
    """Return a rig without its simulation, so that doctor treats its instruments as real."""
    return rig.model_copy(update={"simulation": None})


def pincette(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pincette", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120.0)
