"""What an answer was computed with and from."""

import hashlib
import sys
from datetime import UTC, datetime, timedelta

import pytest

from twin.errors import InputError
from twin.files.provenance import command_line, recorded


def test_inputs_are_named_in_their_folder_and_hashed(tmp_path):
    folder, rig = tmp_path / "bench", tmp_path / "rig.toml"
    (folder / "runs").mkdir(parents=True)
    (folder / "runs" / "a.csv").write_bytes(b"t,x\n")
    rig.write_bytes(b"")
    record = recorded(
        [folder / "runs" / "a.csv", folder / "static.csv", None, rig], folder, None, {"draws": 3}
    )
    assert record.to_json()["inputs"] == {
        "runs/a.csv": hashlib.sha256(b"t,x\n").hexdigest(),
        str(rig): hashlib.sha256(b"").hexdigest(),
    }
    assert (record.command, dict(record.seeds)) == (None, {"draws": 3})
    assert abs(datetime.fromisoformat(record.date) - datetime.now(UTC)) < timedelta(minutes=1)


def test_command_line_can_be_typed_again(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/a/b/twin", "diagnose", "my rig", "--out", "x"])
    assert command_line() == "twin diagnose 'my rig' --out x"


def test_a_file_that_cannot_be_read_is_an_error_that_names_it(tmp_path):
    with pytest.raises(InputError, match=f"{tmp_path.name} cannot be read: Is a directory"):
        recorded([tmp_path], None, None, {})
