"""`--open` shows the results of a diagnosis, or says before the work begins why it cannot."""

import subprocess
import sys
import webbrowser
from pathlib import Path

import pytest

from twin.commands import opening

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere there is always a display")


@linux
@pytest.mark.parametrize(
    ("opener", "instead"), [("report", "open report.html elsewhere"), ("viewer", "with `rerun FILE`")]
)
def test_without_a_display_nothing_is_begun(twin, monkeypatch, tmp_path, opener, instead):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    code, out, error = twin("demo", "--open", opener)
    assert (code, out) == (2, "")
    assert f"--open {opener} needs a display, and DISPLAY and WAYLAND_DISPLAY are not set" in error
    assert instead in error
    assert not list(tmp_path.iterdir())


def test_only_report_and_viewer_can_be_opened(twin):
    code, _, error = twin("demo", "--open", "json")
    assert code == 2
    assert "Invalid value for '--open': 'json' is not one of 'report', 'viewer'" in error


@linux
@pytest.mark.parametrize("arguments", [("demo", "--open"), ("demo", "--open", "--force")])
def test_without_a_value_the_report_is_opened(twin, monkeypatch, arguments):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    assert "Error: --open report needs a display" in twin(*arguments)[2]


def test_report_is_shown_by_the_browser(monkeypatch, tmp_path):
    shown = []
    monkeypatch.setattr(webbrowser, "open", lambda address: shown.append(address) or True)
    assert opening.open_results("report", {"report": tmp_path / "report.html"}) == ""
    assert shown == [(tmp_path / "report.html").as_uri()]
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    assert "yourself" in opening.open_results("report", {"report": Path("report.html")})


def test_recording_is_shown_by_the_viewer_beside_python(monkeypatch, tmp_path):
    started = []
    monkeypatch.setattr(subprocess, "Popen", lambda command, **options: started.append(command))
    assert opening.open_results("viewer", {"rerun": tmp_path / "run.rrd"}) == ""
    [(viewer, file)] = started
    assert Path(viewer).parent == Path(sys.executable).parent
    assert file == str(tmp_path / "run.rrd")
    assert opening.open_results(None, {}) == ""
    assert len(started) == 1
