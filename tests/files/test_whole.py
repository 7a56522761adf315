"""Files are written whole or not at all, never through a link, and their places are tried beforehand."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from twin.errors import InputError
from twin.files import whole
from twin.files.whole import check_file, check_folder, check_place, is_temporary, write_file, write_files

POSIX = pytest.mark.skipif(os.name == "nt", reason="devices and modes of POSIX")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def full(*_):
    raise OSError(28, "No space left on device")


def test_text_and_bytes_are_written_and_none_removes(tmp_path):
    a, b, c = (tmp_path / name for name in "abc")
    c.write_text("old")
    write_files({a: "µ\n", b: b"\x00", c: None})
    assert (a.read_bytes(), b.read_bytes()) == ("µ\n".encode(), b"\x00")
    assert names(tmp_path) == ["a", "b"]


def test_a_lone_surrogate_is_replaced(tmp_path):
    write_file(tmp_path / "a", "caf\udce9")
    assert (tmp_path / "a").read_text() == "caf?"


@pytest.mark.parametrize("failing", [1, 2, 3])
def test_without_space_for_one_of_them_all_are_as_before(failing, tmp_path, monkeypatch):
    paths = [tmp_path / name for name in "abc"]
    for path in paths[:2]:
        path.write_text("old")
    calls = iter(range(1, 9))
    monkeypatch.setattr(os, "fsync", lambda _: full() if next(calls) == failing else None)
    with pytest.raises(InputError, match=f"cannot write .*{'abc'[failing - 1]}: No space left on device"):
        write_files(dict.fromkeys(paths, "new"))
    assert names(tmp_path) == ["a", "b"]
    assert [path.read_text() for path in paths[:2]] == ["old", "old"]


def test_files_are_replaced_in_the_order_given(tmp_path, monkeypatch):
    order, replace = [], os.replace
    monkeypatch.setattr(os, "replace", lambda old, new: order.append(new.name) or replace(old, new))
    write_files({tmp_path / name: "" for name in "bca"})
    assert order == ["b", "c", "a"]


@POSIX
def test_a_new_file_has_the_usual_mode_and_an_old_one_keeps_its_own(tmp_path):
    (tmp_path / "usual").write_text("")
    (tmp_path / "own").write_text("")
    (tmp_path / "own").chmod(0o640)
    write_files({tmp_path / "new": "", tmp_path / "own": ""})
    modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert modes["new"] == modes["usual"]
    assert modes["own"] == 0o640


@POSIX
@pytest.mark.parametrize("target", ["there", "nowhere"])
def test_nothing_is_written_through_a_link(target, tmp_path):
    (tmp_path / "there").write_text("keep")
    (tmp_path / "link").symlink_to(target)
    for refused in (check_place, check_file, lambda path: write_file(path, "x")):
        with pytest.raises(InputError, match=f"link: it is a link to {target}"):
            refused(tmp_path / "link")
    assert names(tmp_path) == ["link", "there"]
    assert (tmp_path / "there").read_text() == "keep"


@POSIX
def test_devices_take_everything_but_a_full_one():
    check_file(Path("/dev/null"))
    write_file(Path("/dev/null"), "x")
    with pytest.raises(InputError, match="cannot write /dev/full: No space left on device"):
        write_file(Path("/dev/full"), "x")


@POSIX
@pytest.mark.parametrize("place", ["/dev/stdout", "/dev/fd/1"])
def test_standard_output_keeps_its_order_in_a_file(place, tmp_path):
    code = (
        f"from pathlib import Path; from twin.files.whole import check_file, write_file; path = Path({place!r}); "
        "print('a'); check_file(path); write_file(path, 'b\\n'); print('c')"
    )
    with (tmp_path / "out").open("w") as out:
        subprocess.run([sys.executable, "-c", code], stdout=out, check=True)
    assert (tmp_path / "out").read_text() == "a\nb\nc\n"


# Places


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("file", "cannot write into file: it is a file"),
        ("file/new", "cannot write into file: it is a file"),
        pytest.param("link", "cannot write into link: it is a link to nowhere", marks=POSIX),
        pytest.param("link/new", "cannot write into link: it is a link to nowhere", marks=POSIX),
        ("new/" + 300 * "n", "File name too long"),
        ("nu\0ll", "null"),
        pytest.param("/proc/new", "cannot write /proc/new", marks=POSIX),
    ],
)
def test_a_folder_that_cannot_be_made_is_found_and_nothing_left(place, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    if os.name != "nt":
        Path("link").symlink_to("nowhere")
    before = names(tmp_path)
    with pytest.raises(InputError, match=message):
        check_folder(Path(place))
    assert names(tmp_path) == before


def test_a_folder_that_can_be_made_is_not(tmp_path):
    check_folder(tmp_path / "a" / "b")
    check_folder(tmp_path)
    assert names(tmp_path) == []


def test_a_folder_without_permission_is_found(tmp_path, monkeypatch):
    def denied(self, **_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "touch", denied)  # root, who may run the tests, is denied nothing
    with pytest.raises(InputError, match="Permission denied"):
        check_folder(tmp_path / "new")
    assert names(tmp_path) == []


def test_a_write_protected_file_is_found(tmp_path, monkeypatch):
    (tmp_path / "mine").write_text("")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="mine: it is write-protected"):
        check_file(tmp_path / "mine")


# What a killed process leaves


@POSIX
def test_temporary_files_of_ended_processes_are_removed_and_no_others(tmp_path):
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    kept = [
        whole.temporary_path(tmp_path).name,
        f".twin-{os.getppid()}-00000000-00000000.tmp",
        ".twin-mine.tmp",
    ]
    gone = [f".twin-{ended.pid}-00000000-00000000.tmp", f".twin-{os.getpid()}-00000000-00000000.tmp"]
    for name in (*kept, *gone):
        (tmp_path / name).write_text("")
    check_folder(tmp_path)
    assert names(tmp_path) == sorted(kept)
    assert [is_temporary(name) for name in kept] == [True, True, False]
