"""Files that are none, too large or no text are refused before they are read, by every reader."""

import os
import socket
import sys
from pathlib import Path

import pytest

from twin.campaigns.campaign import read_campaign
from twin.errors import InputError
from twin.files import table
from twin.files.outputs import ResultsFolder
from twin.files.table import read_table
from twin.files.text import check_lines, read_text
from twin.files.toml import read_toml
from twin.report.run_files import read_track
from twin.rigs.patch import read_patch
from twin.rigs.rig_file import read_rig_file
from twin.validation.requirements import read_requirements

posix = pytest.mark.skipif(sys.platform == "win32", reason="pipes, sockets and devices of POSIX")


def pipe(path):
    os.mkfifo(path)


def endless(path):
    path.symlink_to("/dev/zero")


def listening(path):
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(path))


KINDS = {"a pipe": pipe, "a device": endless, "a socket": listening, "a folder": lambda path: path.mkdir()}


@posix
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_is_refused_unread(tmp_path, kind, monkeypatch):
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    KINDS[kind](Path("a"))
    with pytest.raises(InputError, match=f"^a is {kind}; expected a file$"):
        read_text(tmp_path / "a", "a", 100)


READERS = {
    "rig": lambda folder: read_rig_file(folder / "a.csv"),
    "requirements": lambda folder: read_requirements(folder / "a.csv"),
    "patch": lambda folder: read_patch(folder / "a.csv"),
    "run": lambda folder: read_track(folder / "a.csv"),
}


@posix
@pytest.mark.parametrize("reader", READERS)
def test_every_reader_refuses_a_pipe(tmp_path, reader):
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(InputError, match="a.csv is a pipe"):
        READERS[reader](tmp_path)


@posix
def test_a_campaign_file_that_is_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "campaign.toml")
    with pytest.raises(InputError, match="campaign.toml is a pipe; expected a campaign as a TOML file"):
        read_campaign(tmp_path)


@posix
def test_a_pipe_in_a_folder_of_results_is_no_answer(tmp_path):
    os.mkfifo(tmp_path / "answer.json")
    folder = ResultsFolder("diagnosis", {"answer": "answer.json"}, "answer.json", frozenset({"verdict"}))
    with pytest.raises(InputError, match="holds answer.json, which no diagnosis wrote"):
        folder.choose(tmp_path, tmp_path)


def test_a_link_to_a_file_is_read(tmp_path):
    (tmp_path / "there").write_text("text")
    (tmp_path / "here").symlink_to(tmp_path / "there")
    assert read_text(tmp_path / "here", "here", 100) == "text"


def test_a_file_beyond_the_size_is_not_read(tmp_path):
    (tmp_path / "a").write_bytes(b"x" * 3_000_001)
    assert len(read_text(tmp_path / "a", "a", 3_000_001)) == 3_000_001
    with pytest.raises(InputError, match="^a has more than 3 MB; expected a file of at most that$"):
        read_text(tmp_path / "a", "a", 3_000_000)


@posix
def test_a_file_that_tells_no_size_is_read_to_the_limit():
    with pytest.raises(InputError, match="has more than 0 MB"):
        read_text(Path("/proc/self/status"), "status", 10)


def test_a_sparse_table_is_refused_by_its_size(tmp_path):
    with (tmp_path / "a.csv").open("wb") as file:
        file.truncate(table.LARGEST_FILE + 1)
    with pytest.raises(InputError, match="a.csv has more than 1000 MB; expected a CSV file of at most that"):
        read_table(tmp_path / "a.csv", "a.csv")


@pytest.mark.parametrize("read", [read_table, lambda path, name: read_toml(path, "a rig", name)])
def test_a_nul_byte_is_named_by_its_line(tmp_path, read):
    (tmp_path / "a").write_bytes(b"a = 1\nb = '\0'\n")
    with pytest.raises(InputError, match=r"^a, line 2: byte 0x00 is no text; expected a text file in UTF-8$"):
        read(tmp_path / "a", "a")


GERMAN = "Zeit [s];Drehwinkel [°];Spannung für Motor\n0,0;1,5;2\n0,1;2,5;3\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "latin-1", "utf-16"])
def test_tables_of_older_encodings_are_read(tmp_path, encoding):
    (tmp_path / "a.csv").write_bytes(GERMAN.replace("\n", "\r\n").encode(encoding))
    table = read_table(tmp_path / "a.csv", "a.csv")
    assert table.header == ("Zeit [s]", "Drehwinkel [°]", "Spannung für Motor")
    assert table.columns["Drehwinkel [°]"].tolist() == [1.5, 2.5]


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n\0\0", b"\xff\xfea", b"a,b\n\x81,1\n", b"\xfc\x01"])
def test_what_is_text_in_no_encoding_is_refused(tmp_path, content):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"^a.csv, line \d: byte 0x.. is not UTF-8; save the file as UTF-8$"):
        read_table(tmp_path / "a.csv", "a.csv")


def test_toml_is_read_in_utf_8_alone(tmp_path):
    (tmp_path / "a.toml").write_bytes('name = "für"'.encode("cp1252"))
    with pytest.raises(InputError, match=r"^a, line 1: byte 0xfc is not UTF-8; save the file as UTF-8$"):
        read_toml(tmp_path / "a.toml", "a rig", "a")


def test_a_nul_in_a_name_is_no_file(tmp_path):
    with pytest.raises(InputError, match="is no name of a file"):
        read_text(tmp_path / "a\0b", "a", 10)


def test_a_name_that_is_too_long(tmp_path):
    with pytest.raises(InputError, match="^a cannot be read: "):
        read_text(tmp_path / ("a" * 5000), "a", 10)


@pytest.mark.parametrize(
    ("lines", "line"), [("abcd", 1), ("abc\nabcd", 2), ("\n\nabcde\n", 3), ("abc\n\nabc\n", None)]
)
def test_long_lines_are_named(lines, line):
    if line is None:
        check_lines(lines, "a", 3)
        return
    with pytest.raises(InputError, match=f"^a, line {line} has more than 3 characters"):
        check_lines(lines, "a", 3)
