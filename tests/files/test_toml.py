"""TOML files: what no parser and no float can hold is named, whatever the file is."""

import pytest

from twin.errors import InputError
from twin.files.toml import read_toml

BAD = {
    "an integer of 5000 digits": (
        "a = " + "9" * 5000,
        ": a whole number has more than 4300 digits; expected",
    ),
    "an integer beyond a float": (
        "[a]\nb = [1, {c = 1" + "0" * 400 + "}]",
        ": a.b.2.c is beyond the largest number",
    ),
    "a float beyond the largest": ("a = 1e999", ": 1e999 is beyond the largest number"),
    "nested lists": ("a = " + "[" * 2000 + "]" * 2000, " has tables or lists nested more than 32 deep"),
    "dotted keys": ("a" + ".a" * 2000 + " = 1", " has tables or lists nested more than 32 deep"),
    "a long line": ("a = '" + "x" * 10_000 + "'", ", line 1 has more than 10000 characters"),
    "no value": ("a = 1\nb = ", ", at its end: Invalid value; expected a rig as TOML"),
    "a control character": ("a = '\x1b'", ", line 1, column "),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_bad_toml_is_named(tmp_path, text, message):
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_toml(tmp_path / "rig.toml", "a rig")
    assert str(caught.value).startswith(f"rig.toml{message}")
    assert len(str(caught.value)) < 200
    assert str(caught.value).isprintable()


def test_a_byte_order_mark_is_no_content(tmp_path):
    (tmp_path / "rig.toml").write_bytes("\ufeffa = 1\r\nb = -inf\r\n".encode())
    assert read_toml(tmp_path / "rig.toml", "a rig") == {"a": 1, "b": -float("inf")}


def test_numbers_and_depth_that_files_have_are_accepted(tmp_path):
    deep = "[" * 30 + "]" * 30
    (tmp_path / "rig.toml").write_text(f"a = {deep}\nb = 1{'0' * 300}\nc = {{x = [1.0, inf, nan]}}\n")
    assert read_toml(tmp_path / "rig.toml", "a rig")["b"] == 10**300
