"""HTML pages that need no network: plotly.js is in the page. Palette, figures and tables that all pages share."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from twin import labels
from twin.report.prose import prose

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from jinja2 import Environment

INK, BLUE, VERMILION, PURPLE, GREY = "#2b2b2b", "#0072b2", "#d55e00", "#b3558f", "#9aa3ab"
"""Palette of Okabe and Ito, distinguishable with every common kind of colour vision, and in grey."""

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'

_PLOTLY = "report/vendor/plotly-basic.min.js"
"""Version 4.1.1 of the npm package plotly.js-basic-dist-min, 1.2 MB: scatter, bar and pie. The bundle with all charts
that comes with the Python package is 4.8 MB."""


@dataclass(frozen=True)
class Figure:
    """A figure of a page.

    Attributes:
      json: its data, its layout and, under "narrow", what of the layout differs on a screen as wide as a phone.
      height, narrow_height: on the page, and on such a screen [px].
    """

    json: str
    height: int
    narrow_height: int


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Attributes:
      text: of the cell.
      note: smaller text below it.
      strong: whether the text is bold.
      warns: whether the text is a warning.
      width: length of a bar in the place of the text, from 0 to 100; None for none.
      link: address that the text leads to, relative to the page; "" for none.
    """

    text: str
    note: str = ""
    strong: bool = False
    warns: bool = False
    width: float | None = None
    link: str = ""


Row = tuple[str | Cell, ...]


@dataclass(frozen=True)
class Table:
    """A table, which a narrow screen shows as one card for each row.

    Attributes:
      columns: their names; those that begin with ">" hold numbers. The first names the row.
      rows: of cells.
      groups: number of a row -> heading above it.
    """

    columns: Sequence[str]
    rows: Sequence[Row]
    groups: Mapping[int, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.rows)


def render(template: str, **content: Any) -> str:
    """Returns a page.

    Args:
      template: its file, relative to the package `twin`.
      content: name -> value of the template.
    """
    page = _environment().get_template(template).render(content)
    # A lone surrogate, from a file name that is not UTF-8, could not be written.
    return page.encode("utf-8", "replace").decode("utf-8")


@cache
def _environment() -> Environment:
    """The templates, with what all of them use."""
    # Imported here, because jinja2 takes 0.1 s, which `twin --help` does not need.
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("twin", "."),
        autoescape=select_autoescape(("html", "j2")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"cell": _as_cell, "prose": prose, "words": labels.words}
    plotly = files("twin").joinpath(_PLOTLY).read_text(encoding="utf-8")
    environment.globals["plotly_js"] = Markup(plotly)
    return environment


def _as_cell(value: str | Cell) -> Cell:
    return value if isinstance(value, Cell) else Cell(value)


def figure(drawn: go.Figure, narrow: go.Figure | Mapping[str, Any] | None = None) -> Figure:
    """Returns a plotly figure for a page.

    Args:
      drawn: with its height.
      narrow: the layout, or what of it differs, on a narrow screen: a mapping, or a figure with the same data.
    """
    import plotly.graph_objects as go

    layout = narrow if isinstance(narrow, Mapping) else narrow.layout.to_plotly_json() if narrow else {}
    changes = json.loads(go.Figure(layout=layout).to_json())["layout"]
    changes.pop("template", None)  # which plotly adds
    text = f'{drawn.to_json()[:-1]},"narrow":{json.dumps(changes)}}}'
    # "</script>" or "<!--" inside would end or break the enclosing element.
    safe = text.replace("<", "\\u003c").replace("\u2028", "\\u2028")
    height = int(drawn.layout.height)
    return Figure(safe, height, int(layout.get("height", height)))


def styled(drawn: go.Figure, height: int, margin: Mapping[str, int]) -> go.Figure:
    """Sets height and margins [px] and the common style of a figure; returns the figure."""
    legend = {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0}
    drawn.update_layout(template="plotly_white")
    titles = {"title": {"font": {"size": 13}}}
    return drawn.update_layout(
        template_layout_xaxis=titles,
        template_layout_yaxis=titles,
        height=height,
        margin=dict(margin),
        legend=legend,
        font={"family": FONT, "size": 13, "color": INK},
    )
