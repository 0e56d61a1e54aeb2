"""The page of keys matches pincette.core.topics."""

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import cast

from msgspec.structs import fields

from pincette.core.topics import REQUESTS, TOPICS, key, request_key

Pages = dict[Path, Callable[[], str]]


def pages(root: Path) -> Pages:
    return cast(Pages, runpy.run_path(str(root / "docs/generate.py"))["PAGES"])


def test_generated_pages_are_up_to_date(root: Path) -> None:
    stale = [
        str(path.relative_to(root))
        for path, page in pages(root).items()
        if not path.is_file() or path.read_text(encoding="utf-8") != page()
    ]
    assert not stale, "derived from changed code; run `make docs` and look at the difference"


def test_the_page_of_keys_is_complete(root: Path) -> None:
    page = pages(root)[root / "docs/reference/keys.md"]()
    for topic in TOPICS:
        assert f"`{key('{rig}', topic, '{service}')}`" in page
        for field in fields(topic.message):
            assert f"| `{field.name}` |" in page
    for question in REQUESTS:
        assert f"`{request_key('{rig}', question)}`" in page


def test_units_are_read_from_the_names(root: Path) -> None:
    page = pages(root)[root / "docs/reference/keys.md"]()
    assert "| `x_um` | number | µm |" in page
    assert "| `contact_stiffness_mN_per_um` | number or nil | mN/µm |" in page
    assert "| `zero_age_s` | number or nil | s |" in page
