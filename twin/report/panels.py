"""Panels in rows and columns, which a narrow screen shows in one column."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from twin.report import pages
from twin.report.pages import Figure

_NUMBERS = {"exponentformat": "none", "separatethousands": True}  # 400 000 in the place of 400k
_GRID, _AXIS = "#e9ecef", pages.GREY
_TOP, _BOTTOM = 58, 44  # margins with legend and with the label of the time axis [px]
_BARE_TOP = 14  # margin without legend and captions [px]
_LEFT, _DIGIT = 66, 7  # margin with labels of four digits, and what each further digit takes [px]
_LEGEND_LINE = 26  # of a legend with two lines, on a narrow screen [px]
_BETWEEN = 22  # between panels with a common time axis [px]
_BELOW = 66  # below a panel with a labelled axis, and above the caption of the next one [px]


class Panels:
    """Panels in rows and columns, as plotly axes; on a narrow screen the columns stand below one another.

    Args:
      rows: relative height of each row.
      row: height of a row of relative height 1 [px].
      columns: width of each column, over that of the figure [1].
      linked: whether all panels share the x axis of the first.
      gap: between columns, over the width of the figure [1]; None to fill the width.
    """

    def __init__(
        self,
        rows: list[float],
        row: int,
        columns: tuple[float, ...] = (0.55, 0.38),
        linked: bool = True,
        gap: float | None = None,
    ):
        self.linked = linked
        self.rows, self.columns, self.row = rows, columns, row
        self.data: list[dict[str, Any]] = []
        self.layout: dict[str, Any] = {"annotations": [], "shapes": []}
        self.inner = int(row * sum(rows) + _BETWEEN * (len(rows) - 1))
        self.space = _BETWEEN / self.inner
        spare = 1.0 - sum(columns)
        self.gap = gap if gap is not None else spare / max(len(columns) - 1, 1)

    def axes(self, row: int, column: int) -> tuple[str, str]:
        """Returns the names of the axes of a panel; they are created on first use."""
        suffix = self._suffix(row, column)
        if f"xaxis{suffix}" not in self.layout:
            self._make_axes(row, column, suffix)
        return f"x{suffix}", f"y{suffix}"

    def _suffix(self, row: int, column: int) -> str:
        number = row * len(self.columns) + column + 1
        return "" if number == 1 else str(number)

    def _make_axes(self, row: int, column: int, suffix: str) -> None:
        left = self._left(column)
        whole = sum(self.rows)
        unit = (1.0 - self.space * (len(self.rows) - 1)) / whole
        top = 1.0 - sum(self.rows[:row]) * unit - self.space * row
        style = {"gridcolor": _GRID, "linecolor": _AXIS, "zeroline": False, "ticks": "outside", "ticklen": 3}
        style |= {"tickcolor": _AXIS, "showline": True}
        # Plotly turns labels that are close, and they cover the title of the axis.
        x = {
            **style,
            "tickangle": 0,
            "domain": [left, min(left + self.columns[column], 1.0)],
            "anchor": f"y{suffix}",
        }
        if self.linked and suffix:
            x["matches"] = "x"
        y = {**style, "domain": [max(top - self.rows[row] * unit, 0.0), top], "anchor": f"x{suffix}"}
        self.layout |= {f"xaxis{suffix}": x, f"yaxis{suffix}": y | {"automargin": False}}

    def _left(self, column: int) -> float:
        return sum(self.columns[:column]) + self.gap * column

    def set(self, axis: str, **options: Any) -> None:
        """Changes an axis, say "x3"."""
        self.layout[f"{axis[0]}axis{axis[1:]}"] |= options

    def add(self, row: int, column: int, **trace: Any) -> None:
        """Adds a trace to a panel."""
        x, y = self.axes(row, column)
        self.data.append({"type": "scatter", "xaxis": x, "yaxis": y, **trace})

    def time_below(self, column: int, rows: int) -> None:
        """Labels the time axis below the last panel of a column only."""
        for row in range(rows):
            last = row == rows - 1
            self.set(self.axes(row, column)[0], showticklabels=last)
            if last:
                self.set(self.axes(row, column)[0], title=title("time", "s"))

    def caption(self, column: int, text: str) -> None:
        """Adds a caption above a column of panels."""
        place = {"xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom", "yshift": 6}
        font = {"size": 12.5, "color": pages.INK}
        at = {"x": self._left(column), "y": 1.0, "showarrow": False, "font": font}
        self.layout["annotations"].append({**place, **at, "text": text})

    def figure(self) -> Figure:
        """Returns the panels."""
        import plotly.graph_objects as go

        legend = {"orientation": "h", "x": 0, "xanchor": "left", "yref": "container", "y": 0.995}
        legend |= {
            "yanchor": "top",
            "itemsizing": "constant",
            "bgcolor": "rgba(0,0,0,0)",
            "font": {"size": 13},
        }
        layout = {
            **self.layout,
            "template": go.layout.Template(layout={"xaxis": _NUMBERS, "yaxis": _NUMBERS}),
            "separators": ".\u202f",
            "font": {"family": pages.FONT, "size": 12, "color": pages.INK},
            "margin": {"l": self._left_margin(), "r": 12, "t": self._top_margin(), "b": _BOTTOM},
            "height": self.inner + self._top_margin() + _BOTTOM,
            "paper_bgcolor": "white",
            "plot_bgcolor": "white",
            "hovermode": "closest",
            "legend": legend,
        }
        return pages.figure(go.Figure(self.data, layout), self._narrow())

    def _top_margin(self) -> int:
        """Room for the legend, which plotly draws for two traces or more, and for the captions [px]."""
        has_legend = len(self.data) > 1 and any(trace.get("showlegend", True) for trace in self.data)
        return _TOP if has_legend or self.layout["annotations"] else _BARE_TOP

    def _left_margin(self) -> int:
        """Room for the labels and titles of the first column [px]."""
        first = {self.axes(row, 0)[1] for row in range(len(self.rows))}
        shown = [
            np.abs(np.asarray(trace["y"], dtype=float)) for trace in self.data if trace["yaxis"] in first
        ]
        largest = max((y[np.isfinite(y)].max(initial=0.0) for y in shown), default=0.0)
        return _LEFT + _DIGIT * max(len(f"{largest:.0f}") - 4, 0)

    def _narrow(self) -> dict[str, Any]:
        """The layout on a narrow screen: all panels of the first column, then those of the next."""
        places = [
            (row, column)
            for column in range(len(self.columns))
            for row in range(len(self.rows))
            if f"xaxis{self._suffix(row, column)}" in self.layout
        ]
        heights = [self.row * self.rows[row] for row, _ in places]
        follows = [b[1] == a[1] for a, b in zip(places[:-1], places[1:], strict=True)]
        gaps = [_BETWEEN if same else _BELOW for same in follows]
        inner = sum(heights) + sum(gaps)
        tops = [inner - sum(heights[:i]) - sum(gaps[:i]) for i in range(len(places))]
        top_margin = self._top_margin() + (_LEGEND_LINE if self._top_margin() == _TOP else 0)
        changes: dict[str, Any] = {"height": int(inner + top_margin + _BOTTOM), "annotations": []}
        for (row, column), height, top in zip(places, heights, tops, strict=True):
            suffix = self._suffix(row, column)
            x, y = self.layout[f"xaxis{suffix}"], self.layout[f"yaxis{suffix}"]
            changes[f"xaxis{suffix}"] = x | {"domain": [0.0, 1.0], "nticks": 6}
            beside = self.layout[f"yaxis{self._suffix(row, 0)}"].get("title")
            bottom = max(top - height, 0) / inner
            changes[f"yaxis{suffix}"] = {"title": beside, **y, "domain": [bottom, top / inner]}
        first = dict(reversed([(column, top / inner) for (_, column), top in zip(places, tops, strict=True)]))
        for column, caption in enumerate(self.layout["annotations"]):
            changes["annotations"].append(caption | {"x": 0.0, "y": first.get(column, 1.0)})
        return changes | {"margin": {"l": self._left_margin() - 2, "r": 8, "t": top_margin, "b": _BOTTOM}}


def title(label: str, unit: str) -> dict[str, Any]:
    """Returns the title of an axis."""
    text = f"{html.escape(label)} [{html.escape(unit)}]" if unit else html.escape(label)
    return {"text": text, "font": {"size": 12}, "standoff": 4}
