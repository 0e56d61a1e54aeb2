"""Rig files and other texts as saved by editors of all systems, and behind links."""

import codecs
from pathlib import Path

import pytest

from pincette.config import ConfigError, read_rig
from pincette.core.files import EncodingError, decoded
from tests.support.rigs import DEMO

TEXT = 'name = "Müller 5 µm"\n'


@pytest.mark.parametrize("content", [TEXT.encode(), TEXT.encode("utf-8-sig")])
def test_utf_8_is_read_with_and_without_a_byte_order_mark(content: bytes) -> None:
    assert decoded(content) == TEXT


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (TEXT.encode("utf-16"), "UTF-16"),
        (codecs.BOM_UTF16_BE + TEXT.encode("utf-16-be"), "UTF-16"),
        (TEXT.encode("utf-32"), "UTF-32"),
        (TEXT.encode("utf-16-le"), "UTF-16"),
        (TEXT.encode("utf-16-be"), "UTF-16"),
        (TEXT.encode("latin-1"), "byte 0xFC in line 1"),
    ],
)
def test_another_encoding_is_named_with_the_remedy(content: bytes, named: str) -> None:
    with pytest.raises(EncodingError, match=named) as refused:
        decoded(content)
    assert "UTF-8" in str(refused.value)
    assert "iconv" in str(refused.value)


def test_a_rig_file_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(codecs.BOM_UTF8 + DEMO.read_bytes())
    assert read_rig(path) == read_rig(DEMO)
    path.write_bytes(DEMO.read_text(encoding="utf-8").encode("utf-16"))
    with pytest.raises(ConfigError, match=r"rig\.toml: it is UTF-16: save it as UTF-8"):
        read_rig(path)


def _linked(tmp_path: Path, *, base: bool) -> Path:
    real, links = tmp_path / "real", tmp_path / "links"
    real.mkdir()
    links.mkdir()
    if base:
        (real / "base.toml").write_bytes(DEMO.read_bytes())
    (real / "rig.toml").write_text('base = "base.toml"\n[rig]\nname = "linked"\n', "utf-8")
    (links / "middle.toml").symlink_to("../real/rig.toml")
    (links / "rig.toml").symlink_to("middle.toml")
    return links / "rig.toml"


def test_a_base_is_found_in_the_folder_of_a_links_target(tmp_path: Path) -> None:
    path = _linked(tmp_path, base=True)
    assert read_rig(path).rig.name == "linked"
    (path.parent / "base.toml").write_bytes(codecs.BOM_UTF8 + DEMO.read_bytes())
    (tmp_path / "real" / "base.toml").write_text("not = TOML", "utf-8")
    assert read_rig(path).rig.name == "linked"  # the file next to the link comes first


def test_a_missing_base_is_named_in_the_error(tmp_path: Path) -> None:
    path = _linked(tmp_path, base=False)
    with pytest.raises(ConfigError, match=r"base\.toml: No such file"):
        read_rig(path)


def test_a_link_to_nothing_names_its_target(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.symlink_to("gone.toml")
    with pytest.raises(ConfigError, match=r"rig\.toml, a link to .*gone\.toml: No such file"):
        read_rig(path)
