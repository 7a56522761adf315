"""What several tests need."""

from __future__ import annotations

import sys

import pytest

from twin import cli


@pytest.fixture
def twin(monkeypatch, capsys, tmp_path):
    """Returns a function that runs `twin` in the test's folder and returns exit code, output and errors."""
    monkeypatch.chdir(tmp_path)

    def invoke(*arguments) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["twin", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return (stop.value.code or 0, *capsys.readouterr())

    return invoke
