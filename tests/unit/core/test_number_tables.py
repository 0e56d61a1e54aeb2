"""Tables of numbers as spreadsheets and recorders write them, or an error that names the unclear
line."""

from pathlib import Path

import pytest

from pincette.core.number_tables import FileError, read_table, table

NAMES = ("t_s", "force_mN")
WANTED = [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 0.5, "force_mN": 7.25}]


@pytest.mark.parametrize(
    "text",
    [
        "0,5\n0.5,7.25\n",
        "0;5\n0,5;7,25\n",
        "0\t5\n0,5\t7,25\n",
        "0 5\n0,5 7,25\n",
        "0, 5\n0.5, 7.25\n",
        "t_s,force_mN\n0,5\n0.5,7.25\n",
        "\ufefft_s;force_mN\r\n0;5\r\n0,5;7,25\r\n",
        "time [s];force [mN]\n0;5\n0,5;7,25",
        "t (s), F (mN)\n0,5\n0.5,7.25",
        "Zeit;Kraft\n0;5\n0,5;7,25",
        "# made by hand\n\n0;5\n  # more\n0.5;7.25\n\n",
        '"t_s","force_mN"\n"0","5"\n"0,5","7,25"\n',
        "t_s,x_um,force_mN\n0,1.0,5\n0.5,2.0,7.25\n",
        "force_mN;t_s\n5;0\n7,25;0,5\n",
        "0,000;5,000\n0,500;7,250\n",
    ],
)
def test_common_number_formats_are_read(text: str) -> None:
    assert table(text, NAMES) == WANTED


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", 1),
        ("# nothing\n", 1),
        ("t_s,force_mN\n0,0,5,0\n", 2),
        ("0,5\n0,5,7,25\n", 2),
        ("0;5\n0.5;7,25\n", 2),
        ("0;1,000\n1;2,000\n", 1),
        ("0;5\n0.5;7 mN\n", 2),
        ("0;5\n0.5;\n", 2),
        ("0;5\n0.5;nan\n", 2),
        ("nan;inf\n0;5\n", 1),
        ("１;5\n0;5\n", 1),
        ("time;5\n0;5\n", 1),
        ("0;5\nt;force\n", 2),
        ("t_ms;force_mN\n0;5\n", 1),
        ("time (ms);force (mN)\n0;5\n", 1),
        ("time s;force N\n0;5\n", 1),
        ("s;N\n0;5\n", 1),
        ("t_s;force_uN\n0;5\n", 1),
        ("t_s;force_mN [N]\n0;5\n", 1),
        ("t_min;force_mN\n0;5\n", 1),
        ("t_s;x_um\n0;5\n", 1),
        ("force;t\n5;0\n", 1),
        ("t_s;a;b\n0;1;2\n", 1),
        ("t_s;force_mN;force_mN\n0;1;2\n", 1),
        ("0;5;6\n", 1),
        ("0;1.000,5\n", 1),
        ("0;1_000\n", 1),
        ('0;"5\n', 1),
        ("0;5\n0.5;1e400\n", 2),
    ],
)
def test_ambiguous_rows_are_refused_with_their_line(text: str, line: int) -> None:
    with pytest.raises(FileError, match=rf"line {line}\b"):
        table(text, NAMES)


def test_another_encoding_is_named(tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    file.write_bytes("0;5\n1;6\n".encode("utf-16"))
    with pytest.raises(FileError, match="UTF-16"):
        read_table(str(file), NAMES)
    file.write_bytes(b"0;5\n1;6 \xb5\n")
    with pytest.raises(FileError, match=r"line 2.*UTF-8"):
        read_table(str(file), NAMES)
    with pytest.raises(FileError, match="cannot be read"):
        read_table(str(tmp_path / "none.csv"), NAMES)
    with pytest.raises(FileError, match="cannot be read"):
        read_table(str(tmp_path), NAMES)
