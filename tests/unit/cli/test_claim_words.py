"""A claim from a shell."""

import json

import httpx
import pytest

from pincette.api.access import Claim
from pincette.api.rigs import Rig
from pincette.cli import Exit
from pincette.cli.main import main
from tests.unit.client import desk

from .conftest import At

AT = ("--rig-name", "demo")


def test_after_a_claim_from_the_shell_every_command_sends_the_secret_of_the_claim(
    at: At, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PINCETTE_CLAIM", "")  # restored at the end, whatever the command sets
    claim = desk.example(Claim)
    listed = httpx.Response(200, json={"rigs": [desk.example(Rig, claim=claim)]})
    supervisor = at(httpx.Response(200, json=claim), listed, desk.rig())
    assert main(["claim", "take", "--lease-s", "30", "--note", "night", *AT]) == Exit.DONE
    name, _, secret = capsys.readouterr().out.strip().partition("=")
    assert name == "export PINCETTE_CLAIM"
    assert json.loads(supervisor.asked[-1].content) == {"lease_s": 30.0, "note": "night"}
    monkeypatch.setenv("PINCETTE_CLAIM", secret)
    assert main(["rigs", "--json"]) == Exit.DONE
    assert json.loads(capsys.readouterr().out)[0]["claim"] == claim
    assert main(["claim", "give-back", *AT]) == Exit.DONE
    assert {one.headers["x-claim"] for one in supervisor.asked} == {secret}
    supervisor = at(desk.rig(claim=claim), desk.rig())
    assert main(["claim", "give-back", "--force", *AT]) == Exit.DONE
    assert supervisor.asked[-1].url.params["force"] == "true"
    assert claim["by"] in capsys.readouterr().out
