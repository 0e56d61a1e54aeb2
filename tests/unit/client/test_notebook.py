"""Jobs, rigs and supervisors in a console and in a notebook."""

from base64 import b64encode
from typing import Any

import httpx
import pytest

from pincette.api.jobs import Artifact, ArtifactList, Progress
from pincette.api.rigs import Newest, Rig

from . import desk
from .desk import Desk

NOW = desk.example(Progress, phase="hold", force_held_mN=15.02, force_uncertainty_mN=0.31)
ENDED = {"outcome": "gripped", "force_held_mN": 14.98, "force_uncertainty_mN": 0.2}
PNG = b"a picture"


def html_of(shown: Any) -> str:
    """Text that a notebook displays."""
    return shown._repr_html_()


def grip(**changes: object) -> httpx.Response:
    plain = {"kind": "grip", "values": {"force_mN": 15.0}, "result": None, "cause": ""}
    return desk.job(**{**plain, "ended_at": None, "progress": NOW, **changes})


def test_a_job_shows_its_force_without_another_request() -> None:
    requested = Desk(grip(id="j", state="running"))
    job = requested.supervisor().job("j")
    assert repr(job) == "<job j: grip, running, hold, 15.02 ± 0.31 mN, 15.00 mN>"
    html = html_of(job)
    assert "<th>force</th><td>15.02 ± 0.31 mN</td>" in html
    assert len(requested.asked) == 1


@pytest.mark.parametrize("recorded", [True, False])
def test_a_job_that_has_ended_is_shown_with_its_picture(recorded: bool) -> None:
    files = [desk.example(Artifact, name="grip.png")] if recorded else []
    listed = httpx.Response(200, json=desk.example(ArtifactList, artifacts=files))
    ended = grip(state="succeeded", ended_at="2026-01-01T00:00:00Z", result=ENDED, cause="a < b")
    job = Desk(ended, listed, httpx.Response(200, content=PNG)).supervisor().job("j")
    html = html_of(job)
    assert "14.98 ± 0.20 mN" in html
    assert "<td>a &lt; b</td>" in html
    assert (b64encode(PNG).decode() in html) == recorded


def test_an_unavailable_picture_is_omitted() -> None:
    ended = grip(state="failed", ended_at="2026-01-01T00:00:00Z")
    job = Desk(ended, httpx.ConnectError("gone")).supervisor().job("j")
    assert "<img" not in html_of(job)


def test_a_rig_and_a_supervisor_show_part_and_force() -> None:
    newest = desk.example(Newest, force_mN=15.0, force_uncertainty_mN=0.3)
    rig = desk.example(Rig, name="demo", part="held", newest=newest)
    answers = [httpx.Response(200, json=rig), httpx.Response(200, json={"rigs": [rig]})]
    supervisor = Desk(*answers).supervisor()
    one = supervisor.rig("demo")
    assert repr(one) == "<rig demo>"
    assert repr(supervisor) == f"<supervisor {desk.URL}>"
    for html in map(html_of, (one, supervisor)):
        assert "<td>demo</td>" in html
        assert "<td>held</td><td>15.00 ± 0.30 mN</td>" in html
