"""What commands print: names literally, in the characters that the console has."""

import io
import sys

import pytest
from rich.table import Table

from twin import labels
from twin.commands import compare
from twin.commands.screen import Screen
from twin.labels import printable
from twin.report.compare import Difference
from twin.terminal import OutputLost

NAMES = ("[red]x.csv", "a[/b]/r.csv", ":smile:", "[link=x]")


def stream(encoding: str) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="")


def printed(out: io.TextIOWrapper) -> str:
    out.flush()
    return out.buffer.getvalue().decode(out.encoding)


@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "cp1252", "cp437"])
def test_names_are_printed_literally_wherever_they_stand(encoding):
    out = stream(encoding)
    screen = Screen(file=out)
    for name in NAMES:
        table = Table(f"head {name}", title=f"title {name}", box=None)
        table.add_row(f"cell {name}")
        screen.print(table)
        screen.print(f"line {name}")
    for name in NAMES:
        for place in ("head", "title", "cell", "line"):
            assert f"{place} {name}" in printed(out)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "cp437"])
def test_signs_have_a_counterpart_in_ascii_and_columns_stay_in_line(encoding, monkeypatch):
    monkeypatch.setattr(sys, "stdout", stream(encoding))
    rows = [
        Difference(name, "hub_angle", 0.01, 0.02, 0.03) for name in ("théta.csv", "日本.csv", "[b]x[/b].csv")
    ]
    compare._print("[red]θ.csv", [*rows, Difference("x.csv", "strain_base", 1e-6, 2e-6, 3e-6)])
    title, head, *body = printed(sys.stdout).splitlines()
    assert title.rstrip() == "difference from [red]theta.csv"
    assert [line.split()[0] for line in body] == ["theta.csv", "??.csv", "[b]x[/b].csv", "x.csv"]
    assert [line.split()[5] for line in body] == ["deg", "deg", "deg", "ue"]
    place = head.index("unit")
    assert {line[place:].split()[0] for line in body} == {"deg", "ue"}


def test_control_characters_do_not_reach_the_terminal():
    out = stream("utf-8")
    Screen(file=out).print("a\x1b[2Jb\x9bc")
    assert printed(out) == "a\N{REPLACEMENT CHARACTER}[2Jb\N{REPLACEMENT CHARACTER}c\n"
    assert printable("5° ± 1 µε, x², Ångström", plain=True) == "5 deg +- 1 ue, x^2, Angstrom"
    assert printable(labels.unit("N*m^2"), plain=True) == "N m^2"
    assert printable(labels.number(-1.3e-12, 2), plain=True) == "-1.3 x 10^-12"


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(28, "No space left on device"), "No space left on device"),
        (BrokenPipeError(32, "Broken pipe"), None),
    ],
)
def test_output_that_cannot_be_written_is_lost(error, reason, monkeypatch):
    out = stream("utf-8")

    def fail():
        raise error

    monkeypatch.setattr(out, "flush", fail)
    with pytest.raises(OutputLost) as lost:
        Screen(file=out).print("x")
    assert lost.value.reason == reason
