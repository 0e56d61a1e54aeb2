"""The commands of the documents are typed, page by page in order, as by a reader."""

from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.document_register import SITTINGS
from tests.support.documents import Sitting
from tests.support.typed_pages import cases, reader_checkout, type_page


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    with reader_checkout(tmp_path, monkeypatch) as place:
        yield place


@pytest.mark.parametrize(("page", "sitting"), cases(SITTINGS))
def test_the_commands_in_a_document_work_as_shown(
    page: str, sitting: Sitting, checkout: Path
) -> None:
    type_page(page, sitting, checkout)
