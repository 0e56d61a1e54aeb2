"""A grip whose instruments are behind real device servers ends as one with direct lines does."""

from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import httpx
import pytest

from pincette.engine.fleet import LOOP, Fleet
from tests.support.device_servers import ser2net, socat
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import demo_rig, rig_toml
from tests.support.running import Json, RunningRig

pytestmark = [pytest.mark.usefixtures("stalls"), pytest.mark.real_time]

MOST_APART_MN = 0.5
"""Between the true forces of two grips: sensor noise, and the creep of the arm's past."""
START = {"ser2net": partial(ser2net, options="chardelay: false"), "socat": socat}


@contextmanager
def rig_behind(name: str, folder: Path) -> Generator[RunningRig]:
    """Run a rig whose instruments are at terminals, directly or behind servers of one kind."""
    near = demo_rig(SHORT)
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


def test_the_force_is_that_of_direct_lines(tmp_path: Path, figures: list[str]) -> None:
    results = {name: grip(name, tmp_path / name) for name in ("direct", *START)}
    forces_mN = {name: result["true_force_held_mN"] for name, result in results.items()}
    missed = {name: result["missed_ticks"] for name, result in results.items()}
    figures.append(f"true force held in mN: {forces_mN}; missed ticks: {missed}")
    for name in START:
        assert forces_mN[name] == pytest.approx(forces_mN["direct"], abs=MOST_APART_MN)
