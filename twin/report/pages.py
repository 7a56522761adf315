"""HTML pages that need no network: plotly.js is in the page. Palette and fonts that all figures share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

INK, BLUE, VERMILION, GREY = "#2b2b2b", "#0072b2", "#d55e00", "#9aa3ab"
"""Palette of Okabe and Ito, distinguishable with every common kind of colour vision, and in grey."""

_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif'


def render(template: str, filters: Mapping[str, Callable[..., Any]] | None = None, **content: Any) -> str:
    """Returns a page.

    Args:
      template: its file, relative to the package `twin`.
      filters: name -> filter of the template.
      content: name -> value of the template.
    """
    # Imported here, because jinja2 and plotly take 0.1 s, which `twin --help` does not need.
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    environment = Environment(
        loader=PackageLoader("twin", "."),
        autoescape=select_autoescape(("html", "j2")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= filters or {}
    environment.globals["plotly_js"] = Markup(get_plotlyjs())
    page = environment.get_template(template).render(content)
    # A lone surrogate, from a file name that is not UTF-8, could not be written.
    return page.encode("utf-8", "replace").decode("utf-8")


def figure_html(figure: Figure, name: str) -> str:
    """Returns a figure as an HTML element with the id `name`."""
    options = {"displaylogo": False, "responsive": True}
    return figure.to_html(full_html=False, include_plotlyjs=False, config=options, div_id=name)


def styled(figure: Figure, height: int, margin: Mapping[str, int]) -> Figure:
    """Sets height and margins [px] and the common style of a figure; returns the figure."""
    legend = {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0}
    return figure.update_layout(
        template="plotly_white",
        height=height,
        margin=dict(margin),
        legend=legend,
        font={"family": _FONT, "size": 13},
    )
