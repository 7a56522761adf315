"""Tables of numbers: what is written is read back, to the last bit, however a file spells it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin.files.table import read_table

NAMES = st.from_regex(r"[a-z][a-z_0-9]{0,9}", fullmatch=True)
VALUES = st.floats(-1e100, 1e100) | st.just(np.nan)


@st.composite
def tables(draw):
    """Names and rows of a table; a lone column has no missing values, since an empty line is no row."""
    header = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    value = VALUES if len(header) > 1 else st.floats(-1e100, 1e100)
    return header, draw(st.lists(st.lists(value, min_size=len(header), max_size=len(header)), max_size=8))


def cell(value, missing, quoted):
    text = missing if np.isnan(value) else repr(value)
    return f'"{text}"' if quoted else text


@given(
    table=tables(),
    missing=st.sampled_from(["", "nan", "NaN", " "]),
    quoted=st.booleans(),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    mark=st.sampled_from(["", "\ufeff"]),
    empty=st.booleans(),
)
def test_a_table_is_read_as_it_was_written(tmp_path_factory, table, missing, quoted, end, mark, empty):
    header, rows = table
    body = [",".join(cell(value, missing, quoted) for value in row) for row in rows]
    between = 2 if empty else 1
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_bytes((mark + (end * between).join([",".join(header), *body]) + end).encode())
    found = read_table(path, "table.csv")
    assert found.header == tuple(header)
    assert len(found) == len(rows)
    assert found.lines.tolist() == [1 + between * (k + 1) for k in range(len(rows))]
    for name, column in zip(header, zip(*rows, strict=True), strict=True) if rows else ():
        np.testing.assert_array_equal(found.columns[name], column)
    [last] = header[-1:]
    alone = read_table(path, "table.csv", [last]).columns
    assert list(alone) == [last]
    np.testing.assert_array_equal(alone[last], found.columns[last])
