"""What several tests need."""

from __future__ import annotations

import os
import sys

import pytest
from hypothesis import settings

from twin import cli

# The same examples in every run, however slow the machine; `--hypothesis-profile=search` draws new ones.
settings.register_profile("repeat", deadline=None, derandomize=True, database=None)
settings.register_profile("search", deadline=None, max_examples=1000)
settings.load_profile("repeat")


@pytest.fixture(scope="session")
def rig_campaign(tmp_path_factory):
    """Returns a function of the arguments of `make_campaign`: the campaign, made once a session."""
    from rig_campaigns import RigCampaigns  # 2 s with all that it imports: not every test needs them

    own = tmp_path_factory.getbasetemp()
    # Each worker of pytest-xdist has a folder of its own in that of the session.
    store = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "rig-campaigns"
    store.mkdir(exist_ok=True)
    return RigCampaigns(store)


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
