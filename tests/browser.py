"""Opens pages in headless Chromium and reports what a reader would miss."""

import html
import json
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest

CHROMIUM = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome", "chrome")
        if (path := shutil.which(name))
    ),
    None,
)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

PHONE, DESK = 390, 1280
"""Widths of windows [px]."""
_HEIGHT = 40_000  # of a window, so that all of a page is near the screen [px]

_BEFORE = """<script>
window.errors = [];
window.addEventListener('error', function (event) { window.errors.push(String(event.message)); });
console.error = console.warn = function (text) { window.errors.push(String(text)); };
</script>"""
_UNFOLD = """<script>
document.querySelectorAll('details').forEach(function (part) { part.open = true; });
</script>"""
_AFTER = """<script>
window.addEventListener('load', function () {
  var wide = document.documentElement.clientWidth;
  function name(e) { return e.tagName + '.' + e.className + ' ' + e.textContent.slice(0, 30); }
  var seen = Array.prototype.slice.call(document.querySelectorAll('main, main *'));
  parent.postMessage({page: PAGE, errors: window.errors,
    figures: document.querySelectorAll('.plot').length,
    empty: Array.prototype.slice.call(document.querySelectorAll('.plot')).filter(function (plot) {
      return !plot.querySelector('svg .scatterlayer .trace, svg .barlayer .trace');
    }).map(function (plot) { return plot.id; }),
    wider: seen.filter(function (e) { return e.getBoundingClientRect().right > wide + 0.5; }).map(name),
    width: document.documentElement.scrollWidth}, '*');
});
</script>"""
_FRAMES = """<!doctype html><body><pre id="found"></pre>%s<script>
var found = [];
window.addEventListener('message', function (event) {
  found.push(event.data);
  document.getElementById('found').textContent = JSON.stringify(found);
});
</script></body>"""


def looked_at(pages: Mapping[str, str], folder: Path) -> dict[tuple[str, int], dict]:
    """Returns what a browser says of each page at each width, with all folded parts open.

    Args:
      pages: name -> page.
      folder: for files.

    Returns:
      (name, width) -> "errors" of scripts, number of "figures", those that are "empty", elements that are "wider" than
      the window, and the "width" of the page.
    """
    frames = []
    for name, page in pages.items():
        for width in (PHONE, DESK):
            key = f"{name}-{width}"
            (folder / f"{key}.html").write_text(_probed(page, key), encoding="utf-8")
            size = f'style="width:{width}px;height:{_HEIGHT}px;border:0"'
            frames.append((f'<iframe src="{key}.html" {size}></iframe>', (name, width), key))
    # The frames stand behind the script that listens to them.
    text = (_FRAMES % "").replace("</body>", "".join(frame for frame, *_ in frames) + "</body>")
    (folder / "frames.html").write_text(text, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom"]
    options += [
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
    ]
    address = (folder / "frames.html").as_uri()
    command = [str(CHROMIUM), *options, f"--user-data-dir={folder / 'profile'}", address]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout
    [told] = re.findall(r'<pre id="found">(.*?)</pre>', dom, flags=re.DOTALL)
    by_page = {entry["page"]: entry for entry in json.loads(html.unescape(told) or "[]")}
    return {place: by_page[key] for _, place, key in frames}


def _probed(page: str, key: str) -> str:
    page = page.replace("<head>", "<head>" + _BEFORE, 1)
    page = page.replace("</main>", "</main>" + _UNFOLD, 1)
    return page.replace("</body>", _AFTER.replace("PAGE", json.dumps(key)) + "</body>", 1)


def assert_readable(pages: Mapping[str, str], folder: Path, figures: int = 1) -> None:
    """Checks that every page is drawn without an error, with so many figures or more, and not wider than its window."""
    for (name, width), told in looked_at(pages, folder).items():
        where = f"{name} at {width} px"
        assert told["errors"] == [], where
        assert told["figures"] >= figures, where
        assert told["empty"] == [], where
        assert told["wider"] == [], where
        assert told["width"] <= width, where
