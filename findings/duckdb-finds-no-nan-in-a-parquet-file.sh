#!/usr/bin/env bash
# DuckDB answers queries about NaN differently for a Parquet file and for a table made of that file.
#
# One would expect: `SELECT max(x) FROM 'a.parquet'` is what it is after `CREATE TABLE t AS FROM 'a.parquet'`. In DuckDB
# NaN is the greatest number and equals itself, so `max(x)` is NaN, and `x > 100` and `x = 'nan'` find the NaNs.
# What happens: from the file `max(x)` is 3.0, and both conditions find no row. DuckDB takes the answer from the minimum
# and maximum in the file's statistics, in which the format leaves NaN out; the format says that they tell nothing of NaN.
# Seen with duckdb 2.0.0 and pyarrow 26.0.1 (PyPI), Python 3.11.7. Write missing numbers as null, or test with `isnan(x)`.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet duckdb==2.0.0 pyarrow==26.0.1
"$folder/venv/bin/python" - "$folder/a.parquet" <<'PYTHON'
import sys

import duckdb
import pyarrow
import pyarrow.parquet

path = sys.argv[1]
values = [1.0, 2.0, float("nan"), 3.0] * 5
pyarrow.parquet.write_table(pyarrow.table({"x": values}), path)
database = duckdb.connect()
database.execute(f"CREATE TABLE t AS FROM '{path}'")
differ = []
for what in ("max(x)", "count(*) FILTER (WHERE isnan(x))"):
    differ.append([database.execute(f"SELECT {what} FROM {one}").fetchone()[0] for one in (f"'{path}'", "t")])
    print(f"SELECT {what}: file {differ[-1][0]}, table {differ[-1][1]}")
for condition in ("x > 100", "x = 'nan'::DOUBLE", "NOT x <= 100"):
    query = "SELECT count(*) FROM {} WHERE " + condition
    differ.append([database.execute(query.format(one)).fetchone()[0] for one in (f"'{path}'", "t")])
    print(f"WHERE {condition}: file {differ[-1][0]} rows, table {differ[-1][1]} rows")
assert differ[1] == [5, 5], differ
assert differ[0][0] == 3.0 and differ[0][1] != differ[0][1], differ
assert differ[2:] == [[0, 5]] * 3, "file and table agree now: the finding is out of date"
print("as described: the file's statistics hide its NaNs")
PYTHON
