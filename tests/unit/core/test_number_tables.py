"""Tables of numbers as spreadsheets and recorders write them, or an error that names the unclear
line."""

from pathlib import Path

import pytest

from pincette.core.number_tables import FileError, read_table, table

NAMES = ("t_s", "force_mN")
POSITIONS = ("t_s", "x_um")
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
    "header",
    [
        "t_s;x_um",
        " t_s ; x_um ",
        "\ufefft_s;x_um",
        '"t_s";"x_um"',
        "t;x",
        "Time;Position",
        "Zeit [s];x [um]",
        "t (s);x (µm)",
        "t/s;x/\u03bcm",
        "time in s;position in µm",
        "T_s;X_um",
        "# t_s;x_um",
        "# sample A; second run",
        "# t_ms;x_mm\n# made by hand",
        "# t_ms;x_mm\nt_s;x_um",
    ],
)
def test_known_names_of_columns_are_read(header: str) -> None:
    wanted = [{"t_s": 0.0, "x_um": 34.5}, {"t_s": 1.0, "x_um": 35.0}]
    assert table(f"{header}\n0;34,5\n1;35\n", POSITIONS) == wanted


@pytest.mark.parametrize(
    ("header", "column"),
    [
        ("t_s;place_um", "place_um"),
        ("t_s;second_x_um", "second_x_um"),
        ("t_s;x_r_um", "x_r_um"),
        ("t_s;z_um", "z_um"),
        ("t_s;force_mN", "force_mN"),
        ("dwell_s;x_um", "dwell_s"),
        ("x_um;x_um", "x_um"),
        ("t;t", "t"),
        ("t;u", "u"),
        ("τ;ξ", "τ"),
        ("t_s;x_mm", "x_mm"),
        ("t_ms;x_um", "t_ms"),
        ("T_S;X_UM", "T_S"),
        ("t_s;x_uM", "x_uM"),
        ("t;xmm", "xmm"),
        ("t;x.mm", "x.mm"),
        ("t;x-mm", "x-mm"),
        ("t;x{mm}", "x{mm}"),
        ("t;x in mm", "x in mm"),
        ("t;x, mm", "x, mm"),
        ("tMs;xMm", "tMs"),
        ("# t_ms;x_mm", "t_ms"),
        ("#t [s]; x [mm]", "x [mm]"),
        ("# t_s;place_um", "place_um"),
        ("# made by hand\n\n# t;u\n", "u"),
    ],
)
def test_unknown_names_of_columns_are_refused(header: str, column: str) -> None:
    with pytest.raises(FileError) as refused:
        table(f"{header}\n0;34\n1;35\n", POSITIONS)
    assert repr(column) in str(refused.value)
    assert "t_s and x_um" in str(refused.value)


@pytest.mark.parametrize(
    "comment", ["# t_ms x_mm", "# t [ms]  x [mm]", "# time (s) place (um)", "# t_s,x_mm"]
)
def test_names_in_a_comment_are_read_where_white_space_separates(comment: str) -> None:
    with pytest.raises(FileError, match="line 1"):
        table(f"{comment}\n0 34\n1 35\n", POSITIONS)
    right = "# time [s] position [µm]\n0 34\n1 35\n"
    assert table(right, POSITIONS) == table("0 34\n1 35\n", POSITIONS)


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
