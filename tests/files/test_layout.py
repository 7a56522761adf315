"""Text tables as laboratories write them: any separator, decimal commas, a preamble, a row of units."""

import numpy as np
import pytest

from twin.errors import InputError
from twin.files.table import read_table

VALUES = np.array([[0.0, 1.5, -0.25], [0.001, 1e-3, 2.0], [0.002, 3.0, 1e5]])
HEADER = ("time", "torque", "angle")


def text(separator=",", decimal=".", header=HEADER, above=(), units=()):
    rows = [[repr(float(value)).replace(".", decimal) for value in row] for row in VALUES]
    return "\n".join([*above, separator.join(header), *units, *(separator.join(row) for row in rows)]) + "\n"


def read(tmp_path, content, wanted=None):
    path = tmp_path / "a.csv"
    path.write_text(content, encoding="utf-8")
    return read_table(path, "a.csv", wanted)


def check(table, first_line=2):
    assert table.header == HEADER
    assert table.lines.tolist() == [first_line, first_line + 1, first_line + 2]
    np.testing.assert_array_equal(np.column_stack([table.columns[name] for name in HEADER]), VALUES)


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("separator", [";", "\t", " ", "   "])
def test_any_separator_and_decimal_sign(tmp_path, separator, decimal):
    check(read(tmp_path, text(separator, decimal)))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_empty_fields_are_missing(tmp_path, separator):
    content = separator.join(HEADER) + "\n" + f"0{separator}{separator}\n0.1{separator}{separator}2\n"
    table = read(tmp_path, content)
    np.testing.assert_array_equal(table.columns["torque"], [np.nan, np.nan])
    np.testing.assert_array_equal(table.columns["angle"], [np.nan, 2.0])


@pytest.mark.parametrize("above", [("# card 7",), ("% a", "", "%b 1,2"), ("# card", "")])
def test_a_preamble_is_skipped(tmp_path, above):
    check(read(tmp_path, text(above=above)), len(above) + 2)


@pytest.mark.parametrize("sign", ["# ", "%", "#"])
@pytest.mark.parametrize("separator", [",", " ", ";"])
def test_the_header_may_be_a_comment(tmp_path, sign, separator):
    content = text(separator).replace("time", f"# written by a card\n{sign}time", 1)
    check(read(tmp_path, content), 3)


@pytest.mark.parametrize(
    "row", ["s;N*m;rad", "[s];[N*m];[rad]", "(s);;(rad)", "ms;V;V"], ids=["plain", "square", "round", "raw"]
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_row_of_units(tmp_path, row, separator):
    table = read(tmp_path, text(separator, units=[row.replace(";", separator)]))
    check(table, 3)
    plain = [cell.strip("[]()") for cell in row.split(";")]
    assert table.units == {name: unit for name, unit in zip(HEADER, plain, strict=True) if unit}


def test_units_behind_the_names_stay_one_name_between_blanks(tmp_path):
    table = read(tmp_path, "time [s] torque [N m] angle\n0 1 2\n0.1 1 2\n")
    assert table.header == ("time [s]", "torque [N m]", "angle")


def test_a_name_of_two_words_is_one_column(tmp_path):
    assert read(tmp_path, "hub angle\n1\n2\n").header == ("hub angle",)


def test_dates_in_a_column_that_is_not_read(tmp_path):
    content = "date;time;angle\n25.11.2026;0,001;1,5\n25.11.2026;0,002;2\n"
    table = read(tmp_path, content, {"time", "angle"})
    np.testing.assert_array_equal(table.columns["angle"], [1.5, 2.0])


def test_decimal_points_beside_thousands_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"line 2: angle is '1.234,5'; expected a number"):
        read(tmp_path, "time;angle\n0,1;1.234,5\n0,2;3\n")
    with pytest.raises(InputError, match=r"line 3: angle is '1.5'; expected a number with a decimal comma"):
        read(tmp_path, "time;angle\n0,1;3\n0,2;1.5\n")


STAMPS = [
    "{day}T{clock}.{ms}",
    "{day} {clock}.{ms}",
    "{day} {clock},{ms}",
    "{day}T{clock}.{ms}Z",
    "{day} {clock}.{ms}000000+01:00",
    '"{day} {clock},{ms}"',
]
# No field holds the separator unless it is quoted, which no file with blanks between its fields is.
FILES = [
    (form, separator, decimal)
    for form in STAMPS
    for separator in (",", ";", "\t", " ")
    for decimal in ".,"
    if separator not in form + decimal or (separator == "," and '"' in form and decimal == ".")
]


@pytest.mark.parametrize(("form", "separator", "decimal"), FILES)
def test_dates_and_times_count_in_seconds_from_the_first(tmp_path, form, separator, decimal):
    clocks = [("12:59:59", "998"), ("12:59:59", "999"), ("13:00:00", "001")]
    rows = [form.format(day="2024-02-29", clock=clock, ms=ms) for clock, ms in clocks]
    content = f"time{separator}angle\n" + "".join(f"{row}{separator}1{decimal}5\n" for row in rows)
    table = read(tmp_path, content)
    np.testing.assert_allclose(table.columns["time"], [0.0, 0.001, 0.003], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(table.columns["angle"], [1.5, 1.5, 1.5])
    assert table.units["time"] == "s"


def test_stamps_over_midnight_and_across_time_zones(tmp_path):
    content = "time,angle\n2023-12-31T23:59:59.9Z,1\n,2\n2024-01-01T01:00:00.1+01:00,3\n"
    np.testing.assert_allclose(read(tmp_path, content).columns["time"], [0.0, np.nan, 0.2], atol=1e-12)


@pytest.mark.parametrize("wrong", ["2024-02-30T12:00:00", "0.5", "2024-02-29T12:00:01Z", "2024-02-29"])
def test_what_is_no_stamp_below_one_is_named_with_its_line(tmp_path, wrong):
    expected = (
        rf"^a.csv, line 3: time is '{wrong}'; expected a date and time like 2024-03-01T12:00:00.000, as"
    )
    with pytest.raises(InputError, match=expected):
        read(tmp_path, f"time,angle\n2024-02-29T12:00:00.000,1\n{wrong},2\n")


def test_a_row_with_stamps_that_lacks_a_field_is_named(tmp_path):
    with pytest.raises(InputError, match="^a.csv, line 3 has 1 fields; expected 2"):
        read(tmp_path, "time,angle\n2024-02-29T12:00:00.000,1\n2024-02-29T12:00:00.001\n")
