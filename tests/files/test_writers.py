"""Tables are read back from each format as they were written."""

import sys
from pathlib import Path

import numpy as np
import pytest

from twin.errors import InputError
from twin.files.readers import read_recording
from twin.files.writers import SUFFIXES, WRITERS, check_table, mcap, write_table, writer_of

TIME = 0.002 * np.arange(50)
COLUMNS = {
    "time": TIME,
    "hub_angle": np.sin(7 * TIME) / 3,
    "mode": np.sign(TIME - 0.05),
    "state_x": np.where(TIME < 0.02, np.nan, TIME**2),
}
UNITS = {"time": "s", "hub_angle": "rad", "mode": "1"}
LIBRARIES = {".parquet": "pyarrow.parquet", ".pq": "pyarrow.parquet", ".mcap": "mcap.writer"}


@pytest.mark.parametrize("suffix", ["", *SUFFIXES])
def test_what_is_written_is_read_back(tmp_path, suffix):
    if suffix in LIBRARIES:
        pytest.importorskip(LIBRARIES[suffix])
    path = tmp_path / f"run{suffix}"
    write_table(COLUMNS, UNITS, path)
    read = read_recording(path, path.name)
    columns = {name.removeprefix(f"{mcap.TOPIC}."): values for name, values in read.columns.items()}
    assert columns.keys() == COLUMNS.keys()
    for name, values in COLUMNS.items():
        np.testing.assert_allclose(columns[name], values, rtol=1e-8, atol=1e-12, err_msg=name)


def test_parquet_keeps_the_units(tmp_path):
    pytest.importorskip("pyarrow")
    write_table(COLUMNS, UNITS, tmp_path / "run.parquet")
    assert read_recording(tmp_path / "run.parquet", "run.parquet").units == UNITS


def test_names_that_matlab_does_not_allow_are_changed_and_stay_different(tmp_path):
    odd = ("θ", "θ_", "a" * 40, "a" * 39 + "b", "_x", "1", "units", "a b")
    columns = {"time": TIME, **{name: TIME + k for k, name in enumerate(odd)}}
    write_table(columns, {}, tmp_path / "run.mat")
    read = read_recording(tmp_path / "run.mat", "run.mat").columns
    assert len(read) == len(columns)
    assert all(name.isascii() and name.isidentifier() and len(name) <= 31 for name in read)
    np.testing.assert_array_equal([v[0] for v in read.values()], [0.0, *range(len(odd))])


def test_another_ending_is_refused_with_those_that_exist(tmp_path):
    with pytest.raises(InputError, match=r"run.xlsx ends in '.xlsx'; expected one of: .csv, "):
        check_table(tmp_path / "run.xlsx")
    check_table(None)
    check_table(Path("/dev/stdout"))


@pytest.mark.parametrize("suffix", LIBRARIES)
def test_a_missing_library_is_told_before_the_work_with_its_extra(monkeypatch, suffix):
    monkeypatch.setitem(sys.modules, LIBRARIES[suffix], None)
    with pytest.raises(InputError, match=r"by pip install -e '\.\[files\]', or write a .csv"):
        check_table(Path(f"run{suffix}"))


def test_each_ending_has_one_writer():
    endings = [suffix for writer in WRITERS for suffix in writer.suffixes]
    assert len(set(endings)) == len(endings)
    assert writer_of(Path("RUN.MAT")).kind == "a MATLAB file"
