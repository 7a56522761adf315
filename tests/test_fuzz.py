"""Broken inputs are refused with a message, or give an object that is right: 300 of `benchmarks/fuzz.py`."""

import os
import sys
from dataclasses import replace

import pytest

if not sys.platform.startswith("linux"):
    pytest.skip("needs fork and /proc", allow_module_level=True)

import fuzz


def test_no_broken_input_is_a_fault():
    found = fuzz.outcomes(0, range(300))
    faults = [(o.broken.target.name, o.broken.kind.name, o.what) for o in found if o.what in fuzz.FAULTS]
    assert faults == []


def test_an_input_is_repeated_by_its_number(tmp_path):
    for place in ("a", "b"):
        fuzz.prepare(fuzz.broken_input(3, 17), tmp_path / place)
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert names
    assert all((tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names)


@pytest.mark.parametrize(
    ("read", "what"),
    [
        (lambda folder: 1 / 0, "traceback"),
        (lambda folder: os._exit(3), "traceback"),
        (lambda folder: bytearray(2**31), "memory"),
        (lambda folder: None, "accepted"),
        (lambda folder: _raise(AssertionError("nan")), "wrong object"),
        (lambda folder: _raise(fuzz.InputError("no")), "message"),
        (lambda folder: _raise(fuzz.InputError("length" + 3000 * "x")), "message"),
        (lambda folder: _raise(fuzz.InputError("length is -1; expected more")), "refused"),
    ],
)
def test_every_fault_is_told(read, what, tmp_path):
    target = replace(fuzz.targets()[3], read=read)
    broken = fuzz.Broken(0, target, fuzz.Kind("any", fuzz._nothing, refused=True), lambda file: None)
    (found,) = fuzz._judged_by_child([broken], tmp_path)
    assert found.what == what


def _raise(error):
    raise error
