"""Numbers that are typed into the page: what each text means, and what is refused."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

CASES = json.loads((Path(__file__).parents[1] / "data" / "numbers.json").read_text("utf-8"))
READ = """async ([name, texts]) => {
  const numbers = await import('./page/js/form/numbers.js');
  return texts.map((text) => { try { return numbers[name](text); } catch { return null; } });
}"""


@pytest.mark.parametrize(("kind", "reader"), [("single", "numberIn"), ("list", "numbersIn")])
def test_every_text_of_the_common_table_is_read_as_stated(
    browser: Browser, tmp_path: Path, kind: str, reader: str
) -> None:
    desk = Harness(demo_rig(time="lockstep"), tmp_path)
    cases = CASES[kind]
    with served(desk.app) as address:
        page = browser.new_page()
        page.goto(address)
        read = page.evaluate(READ, [reader, [text for text, _ in cases]])
        page.close()
    desk.close()
    found = dict(zip([text for text, _ in cases], read, strict=True))
    assert found == dict(cases)
