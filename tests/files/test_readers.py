"""Readers of recordings: what a library wrote is read back, and what cannot be read is told in one sentence."""

import datetime
import json
import struct
import sys

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, motion, toml_text, write
from scipy.io import savemat

from twin.campaigns.campaign import read_campaign
from twin.errors import InputError
from twin.files.readers import READERS, SUFFIXES, base, read_recording

TIME = 0.001 * np.arange(200)
TORQUE, ANGLE = np.sin(20 * TIME), TIME**2


def read(path, wanted=None):
    return read_recording(path, path.name, wanted)


def check(table, **columns):
    for name, expected in columns.items():
        np.testing.assert_allclose(table.columns[name], expected, rtol=0, atol=1e-12)


# One file of each format with the columns time, torque and angle


def write_mat(path):
    savemat(path, {"time": TIME, "torque": TORQUE[:, None], "angle": ANGLE, "gain": 3.0, "who": "me"})


def write_mat73(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("time", TIME), ("torque", TORQUE), ("angle", ANGLE)):
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128))


def write_h5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["time"], file["torque"] = TIME, TORQUE
        file["angle"] = ANGLE
        file["angle"].attrs["units"] = "rad"


def write_parquet(path):
    parquet = pytest.importorskip("pyarrow.parquet")
    parquet.write_table(arrow(), path)


def write_feather(path):
    feather = pytest.importorskip("pyarrow.feather")
    feather.write_feather(arrow(), path)


def arrow():
    import pyarrow

    fields = [pyarrow.field("time", "double"), pyarrow.field("torque", "double")]
    fields.append(pyarrow.field("angle", "double", metadata={"unit": "rad"}))
    return pyarrow.table([TIME, TORQUE, ANGLE], schema=pyarrow.schema(fields))


def write_tdms(path):
    nptdms = pytest.importorskip("nptdms")
    channels = [
        nptdms.ChannelObject("rig", "torque", TORQUE, {"wf_increment": 0.001, "wf_start_offset": 0.0}),
        nptdms.ChannelObject("rig", "angle", ANGLE, {"wf_increment": 0.001, "unit_string": "rad"}),
    ]
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(channels)


def write_mcap(path):
    writer = pytest.importorskip("mcap.writer")
    with path.open("wb") as stream:
        file = writer.Writer(stream)
        file.start()
        schema = file.register_schema("x", "jsonschema", b"{}")
        channel = file.register_channel("/torque", "json", schema)
        other = file.register_channel("/rig/joint", "json", schema)
        for k in range(len(TIME)):
            stamp = 10**18 + round(1e9 * TIME[k])
            file.add_message(channel, stamp, json.dumps(float(TORQUE[k])).encode(), stamp)
            data = {"name": ["hub"], "position": [float(ANGLE[k])]}
            file.add_message(other, stamp, json.dumps(data).encode(), stamp)
        file.finish()


def write_excel(path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["recorded by me"])
    sheet = book.create_sheet()
    for row in (["time", "torque", "angle"], ["s", "N*m", "rad"]):
        sheet.append(row)
    for row in zip(TIME, TORQUE, ANGLE, strict=True):
        sheet.append([float(value) for value in row])
    book.save(path)


WRITERS = {
    "a.mat": write_mat,
    "v73.mat": write_mat73,
    "a.h5": write_h5,
    "a.parquet": write_parquet,
    "a.feather": write_feather,
    "a.tdms": write_tdms,
    "a.mcap": write_mcap,
    "a.xlsx": write_excel,
}
RENAMED = {"a.mcap": {"angle": "rig.joint.position[0]"}}
UNITS = {"a.h5", "a.parquet", "a.feather", "a.tdms", "a.xlsx"}


@pytest.mark.parametrize("name", WRITERS)
def test_columns_are_read_as_written(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path)
    angle = RENAMED.get(name, {}).get("angle", "angle")
    table = read(path)
    check(table, time=TIME, torque=TORQUE, **{angle: ANGLE})
    check(read(path, {"time", angle}), time=TIME, **{angle: ANGLE})
    assert set(read(path, {angle}).columns) == {angle}
    assert table.units.get("angle") == ("rad" if name in UNITS else None)
    assert len(table) == len(TIME)


@pytest.mark.parametrize("name", WRITERS)
def test_a_broken_file_is_told(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path)
    whole = path.read_bytes()
    for content in (whole[: len(whole) // 3], whole[:16], b"", b"nonsense" * 50):
        path.write_bytes(content)
        with pytest.raises(InputError, match=rf"^{name}( |:|,)"):
            read(path, {"time", "torque"})


@pytest.mark.parametrize("name", WRITERS)
def test_a_folder_or_no_file_is_told(tmp_path, name):
    with pytest.raises(InputError, match=f"^{name}: there is no such file in"):
        read(tmp_path / name)
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=f"^{name} is a folder; expected an? "):
        read(tmp_path / name)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.kind)
def test_every_reader_is_written_of(reader):
    assert reader.__doc__
    assert set(reader.suffixes) <= set(SUFFIXES)
    assert any(name.endswith(reader.suffixes) for name in WRITERS)


def test_a_truncated_matlab_file_is_told_without_the_name_of_a_class(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"time": TIME, "torque": TORQUE})
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InputError) as told:
        read(path)
    assert str(told.value).startswith("a.mat cannot be read as a MATLAB file: ")
    assert "Error" not in str(told.value)


@pytest.mark.parametrize("name", [n for n in WRITERS if n != "a.mat"])
def test_an_absent_library_is_named_with_its_extra(tmp_path, name, monkeypatch):
    path = tmp_path / name
    WRITERS[name](path)
    for module in ("h5py", "pyarrow.parquet", "pyarrow.feather", "nptdms", "mcap.reader", "openpyxl"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        InputError, match=r"install it in the clone of flexlink-twin by pip install -e '\.\[files\]'"
    ):
        read(path)


def test_a_large_file_is_refused_by_its_size(tmp_path):
    with (tmp_path / "a.h5").open("wb") as file:
        file.truncate(base.LARGEST_FILE + 1)
    with pytest.raises(InputError, match="a.h5 has more than 1000 MB; expected an HDF5 file of at most that"):
        read(tmp_path / "a.h5")


def test_more_numbers_than_fit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(base, "_MOST_NUMBERS", 100)
    savemat(tmp_path / "a.mat", {"time": TIME})
    with pytest.raises(InputError, match=r"^a.mat: it holds 200 numbers; expected at most 100$"):
        read(tmp_path / "a.mat")


# What is in the columns


def test_columns_of_other_lengths(tmp_path):
    savemat(tmp_path / "a.mat", {"time": TIME, "torque": TORQUE, "slow": np.arange(20.0)})
    assert set(read(tmp_path / "a.mat").columns) == {"time", "torque"}
    with pytest.raises(InputError, match="columns differ in their number of samples: time 200, slow 20"):
        read(tmp_path / "a.mat", {"time", "slow"})


def test_what_is_no_number_is_refused_with_its_sample(tmp_path):
    torque = TORQUE.copy()
    torque[4] = np.inf
    savemat(tmp_path / "a.mat", {"time": TIME, "torque": torque, "z": TORQUE * 1j})
    with pytest.raises(InputError, match="^a.mat, sample 5: torque is 'inf'; expected a number or nan"):
        read(tmp_path / "a.mat", {"time", "torque"})
    with pytest.raises(InputError, match="^a.mat: z holds complex numbers; expected numbers"):
        read(tmp_path / "a.mat", {"z"})


def test_text_that_is_wanted_is_refused(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    import pyarrow

    parquet.write_table(pyarrow.table({"time": [0.0, 1.0], "name": ["a", "b"]}), tmp_path / "a.parquet")
    check(read(tmp_path / "a.parquet"), time=[0.0, 1.0])
    with pytest.raises(InputError, match="^a.parquet: name holds no numbers"):
        read(tmp_path / "a.parquet", {"name"})


def test_instants_count_from_the_first_and_nulls_are_missing(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    import pyarrow

    start = datetime.datetime(2026, 3, 1, 12)
    stamps = [start + datetime.timedelta(milliseconds=k) for k in range(3)]
    parquet.write_table(pyarrow.table({"time": stamps, "angle": [1, None, 3]}), tmp_path / "a.parquet")
    table = read(tmp_path / "a.parquet")
    check(table, time=[0.0, 0.001, 0.002], angle=[1, np.nan, 3])
    assert table.units == {"time": "s"}


def test_instants_of_excel_count_from_the_first(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["time", "angle"])
    for k in range(3):
        book.active.append([datetime.datetime(2026, 3, 1, 12) + datetime.timedelta(milliseconds=k), k])
    book.save(tmp_path / "a.xlsx")
    table = read(tmp_path / "a.xlsx")
    check(table, time=[0.0, 0.001, 0.002], angle=[0, 1, 2])
    assert table.units == {"time": "s"}


def test_topics_logged_at_instants_of_their_own(tmp_path):
    writer = pytest.importorskip("mcap.writer")
    with (tmp_path / "a.mcap").open("wb") as stream:
        file = writer.Writer(stream)
        file.start()
        for topic, stamps in (("/u", (0, 2_000_000)), ("/y", (1_000_000, 3_000_000))):
            channel = file.register_channel(topic, "json", 0)
            for stamp in stamps:
                file.add_message(channel, stamp, json.dumps({"v": stamp}).encode(), stamp)
        file.finish()
    table = read(tmp_path / "a.mcap")
    check(table, time=[0, 0.001, 0.002, 0.003])
    check(table, **{"u.v": [0, np.nan, 2e6, np.nan], "y.v": [np.nan, 1e6, np.nan, 3e6]})


def test_messages_that_cannot_be_decoded_are_told(tmp_path):
    writer = pytest.importorskip("mcap.writer")
    with (tmp_path / "a.mcap").open("wb") as stream:
        file = writer.Writer(stream)
        file.start()
        file.add_message(file.register_channel("/u", "protobuf", 0), 0, b"x", 0)
        file.finish()
    with pytest.raises(InputError, match="^a.mcap: its messages are encoded as protobuf; expected json"):
        read(tmp_path / "a.mcap")


def test_channels_of_two_groups_with_one_name(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(str(tmp_path / "a.tdms")) as file:
        file.write_segment([nptdms.ChannelObject(g, "u", TORQUE) for g in ("a", "b")])
    assert read(tmp_path / "a.tdms").header == ("a/u", "b/u")


def test_a_number_in_excel_is_told_by_its_row(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["time", "angle"], [datetime.time(0, 0, 1, 500_000), 1], [2, "abc"], [3, None]):
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    check(read(tmp_path / "a.xlsx", {"time"}), time=[1.5, 2, 3])
    with pytest.raises(InputError, match="^a.xlsx, line 3: angle is 'abc'; expected a number"):
        read(tmp_path / "a.xlsx")


# MATLAB and HDF5


def test_structures_and_matrices(tmp_path):
    rig = {
        "t": TIME,
        "hub": {"angle": ANGLE},
        "both": np.column_stack([TORQUE, ANGLE]),
        "wide": np.vstack([TORQUE, ANGLE]),
    }
    savemat(tmp_path / "a.mat", {"rig": rig})
    expected = {"rig.t": TIME, "rig.hub.angle": ANGLE, "rig.both[1]": ANGLE, "rig.wide[0]": TORQUE}
    check(read(tmp_path / "a.mat"), **expected)


def simulink(labels=("torque", "hub angle")):
    """The structure with time of a To Workspace block or a scope."""
    signals = np.zeros(
        2, dtype=[("values", object), ("dimensions", object), ("label", object), ("title", object)]
    )
    for k, (values, label) in enumerate(zip((TORQUE[:, None], ANGLE[:, None]), labels, strict=True)):
        signals[k] = (values, 1.0, label, "")
    return {"time": TIME[:, None], "signals": signals, "blockName": "rig/Scope"}


def test_the_structure_with_time_of_simulink(tmp_path):
    savemat(
        tmp_path / "a.mat", {"out": simulink(), "scope": simulink(("", "")), "twice": simulink(("a", "a"))}
    )
    check(read(tmp_path / "a.mat"), **{"out.time": TIME, "out.torque": TORQUE, "out.hub angle": ANGLE})
    check(read(tmp_path / "a.mat"), **{"scope.signals[0]": TORQUE, "scope.signals[1]": ANGLE})
    check(read(tmp_path / "a.mat"), **{"twice.signals[0]": TORQUE, "twice.signals[1]": ANGLE})


def test_one_signal_of_simulink(tmp_path):
    one = {"time": TIME, "signals": {"values": TORQUE[:, None], "dimensions": 1.0, "label": ""}}
    savemat(tmp_path / "a.mat", {"out": one})
    check(read(tmp_path / "a.mat"), **{"out.time": TIME, "out.signals[0]": TORQUE})


def test_a_dataset_as_structure_and_a_capture_of_dspace(tmp_path):
    dataset = {"hub": {"Time": TIME, "Data": ANGLE}}
    y = np.zeros(2, dtype=[("Name", object), ("Data", object)])
    y[0], y[1] = ("torque", TORQUE), ("angle", ANGLE)
    savemat(tmp_path / "a.mat", {"logs": dataset, "rec": {"X": {"Data": TIME}, "Y": y}})
    expected = {"logs.hub.Time": TIME, "logs.hub.Data": ANGLE, "rec.X.Data": TIME, "rec.Y.torque": TORQUE}
    check(read(tmp_path / "a.mat"), **expected)


def test_structures_of_version_73(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        out, references = file.create_group("out"), file.create_group("#refs#")
        out.attrs["MATLAB_class"] = np.bytes_("struct")
        numeric(out, "time", TIME[None, :])
        signals = out.create_group("signals")
        signals.attrs["MATLAB_class"] = np.bytes_("struct")
        labels = [np.array([[ord(c)] for c in word], dtype="uint16") for word in ("torque", "angle")]
        values = [TORQUE[None, :], ANGLE[None, :]]
        for field, arrays, kind in (("values", values, "double"), ("label", labels, "char")):
            made = [numeric(references, f"{field}{k}", array, kind).ref for k, array in enumerate(arrays)]
            signals.create_dataset(field, data=np.array(made, dtype=h5py.ref_dtype)[:, None])
        numeric(file, "tt", np.zeros((1, 6), dtype="uint32"), "timetable")
    check(read(path), **{"out.time": TIME, "out.torque": TORQUE, "out.angle": ANGLE})
    assert "tt (timetable) can be read by MATLAB alone: writetable" in read(path).note


def numeric(group, name, values, kind="double"):
    made = group.create_dataset(name, data=values)
    made.attrs["MATLAB_class"] = np.bytes_(kind)
    return made


def element(kind, content):
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def with_timetable(path, content):
    """Writes a level 5 file that begins with a timetable, an object of class 17."""
    savemat(path, content)
    numbers = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1)) + element(1, b"")
    numbers += element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    names = b"".join(element(1, name) for name in (b"tt", b"MCOS", b"timetable"))
    whole = path.read_bytes()
    timetable = element(14, element(6, struct.pack("<II", 17, 0)) + names + element(14, numbers))
    path.write_bytes(whole[:128] + timetable + whole[128:])
    return path


def test_a_timetable_of_level_5_is_told(tmp_path):
    alone = with_timetable(tmp_path / "alone.mat", {})
    with pytest.raises(
        InputError, match=r"holds no arrays of numbers; tt \(timetable\) can be read by MATLAB alone"
    ):
        read(alone)
    table = read(with_timetable(tmp_path / "a.mat", {"time": TIME}))
    check(table, time=TIME)
    assert "writetable(timetable2table(x), 'x.csv')" in table.note


def test_tables_and_groups_of_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    rows = np.zeros(len(TIME), dtype=[("time", float), ("angle", "f4")])
    rows["time"] = TIME
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["rig/hub/torque"], file["rows"], file["name"] = TORQUE, rows, "me"
    check(read(tmp_path / "a.h5"), **{"rig/hub/torque": TORQUE, "rows.time": TIME})


# In a campaign


def test_a_campaign_of_any_format_is_that_of_its_csv(tmp_path):
    recorded, plain = motion(), read_campaign(write(tmp_path, toml_text(recordings=(FIT,))))
    savemat(tmp_path / "push.mat", {"rig": {k: np.round(v, 9) for k, v in recorded.items()}})
    channels = {name: f'{lines}\ncolumn = "rig.{name}"' for name, lines in CHANNELS.items()}
    channels["time"] = 'unit = "s"\ncolumn = "rig.time"'
    toml = toml_text(channels, (FIT.replace(".csv", ".mat"),))
    [found], [expected] = read_campaign(write(tmp_path, toml)).fit, plain.fit
    np.testing.assert_allclose(found.time, expected.time, atol=1e-9)
    for name in CHANNELS:
        np.testing.assert_allclose(found[name], expected[name], atol=2e-9)


def test_a_missing_column_is_told_without_a_line(tmp_path):
    savemat(
        tmp_path / "push.mat", {"t": TIME, "torque_command": TORQUE, "hub_angle": ANGLE, "strain_base": ANGLE}
    )
    toml = toml_text(recordings=(FIT.replace(".csv", ".mat"),))
    with pytest.raises(InputError, match="^push.mat: column 'time' is missing; expected the time in s"):
        read_campaign(write(tmp_path, toml))
