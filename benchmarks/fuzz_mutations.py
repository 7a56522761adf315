"""Kinds of mutation that break a valid input: bytes in, bytes out, reproducible from a random generator.

A kind that leaves nothing that could be right is marked `refused`: an input that it broke has to be refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

Mutate = Callable[[bytes, Random], bytes | None]


@dataclass(frozen=True)
class Kind:
    """One kind of mutation.

    Attributes:
      name: for the table.
      mutate: returns the broken content; None where the content has nothing of this kind to break.
      refused: whether what it breaks may never be accepted.
      apart_from: names of targets for which `refused` does not hold.
    """

    name: str
    mutate: Mutate
    refused: bool = False
    apart_from: tuple[str, ...] = ()

    def must_refuse(self, target: str) -> bool:
        """Whether an input of a target that it broke may never be accepted."""
        return self.refused and target not in self.apart_from


# Helpers for lines of TOML

_NUMBER = re.compile(r"^([\w.-]+) = ([-+]?(?:\d[\d_]*\.?\d*(?:e[-+]?\d+)?))(\s*(?:#.*)?)$")
_TEXT = re.compile(r'^([\w.-]+) = "([^"]*)"(\s*(?:#.*)?)$')
POSITIVE = re.compile(
    r"length|linear_density|bending_stiffness|hub_inertia|half_thickness|torque_limit|damping|static_friction|"
    r"coulomb_friction|tip_mass|tip_inertia|noise|position|standard_error|uncertainty|share|stiffness"
)
_NOT_ZERO = re.compile(r"value|length|linear_density|bending_stiffness|hub_inertia|half_thickness|share")
_FREE_TEXT = ("experiment", "source")  # any text is right there
_CHOSEN = ("unit", "role", "loop", "start", "file")  # texts of which only some are right
_UNBOUNDED = ("torque_limit",)


def _lines(content: bytes) -> list[str]:
    return content.decode("utf-8").split("\n")


def _joined(lines: list[str]) -> bytes:
    return "\n".join(lines).encode("utf-8")


def _line(pattern: re.Pattern[str], wanted: Callable[[str], bool] = lambda key: True):
    """Returns a function that picks a line of a pattern whose key is wanted."""

    def pick(lines: list[str], rng: Random) -> int | None:
        found = [
            k for k, line in enumerate(lines) if (m := pattern.match(line)) and wanted(_key(lines, k, m[1]))
        ]
        return rng.choice(found) if found else None

    return pick


def _key(lines: list[str], k: int, key: str) -> str:
    """The key of a line; NAME in a table [parameters.NAME], and that of the table in one of uncertainties."""
    heads = [line.strip("[]").split(".") for line in lines[:k] if line.startswith("[")]
    if heads and heads[-1][0] in ("uncertainty", "standard_errors"):
        return "uncertainty"
    return heads[-1][-1] if heads and key == "value" else key


def valued(value: str | Callable[[str, Random], str], wanted=lambda key: True, pattern=_NUMBER) -> Mutate:
    """Replaces the value of a line by another one."""

    def mutate(content: bytes, rng: Random) -> bytes | None:
        lines = _lines(content)
        if (k := _line(pattern, wanted)(lines, rng)) is None:
            return None
        match = pattern.match(lines[k])
        assert match
        lines[k] = f"{match[1]} = {value if isinstance(value, str) else value(match[2], rng)}"
        return _joined(lines)

    return mutate


def texted(value: str, wanted=lambda key: True) -> Mutate:
    """Replaces a text of a line by another one, given with its quotes."""
    return valued(value, wanted, _TEXT)


def _with_line(change: Callable[[list[str], int, Random], list[str]], pattern=r"^[\w.-]+ = ") -> Mutate:
    """Changes one line of a pattern: `change` returns what stands in its place."""

    def mutate(content: bytes, rng: Random) -> bytes | None:
        lines = _lines(content)
        found = [k for k, line in enumerate(lines) if re.match(pattern, line)]
        if not found:
            return None
        k = rng.choice(found)
        return _joined([*lines[:k], *change(lines, k, rng), *lines[k + 1 :]])

    return mutate


def _table_twice(content: bytes, rng: Random) -> bytes | None:
    blocks = re.split(r"(?m)^(?=\[)", content.decode("utf-8"))
    if len(blocks) < 2:
        return None
    k = rng.randrange(1, len(blocks))
    return "".join([*blocks[: k + 1], "\n", *blocks[k:]]).encode("utf-8")


def _positive(key: str) -> bool:
    return POSITIVE.search(key) is not None


def _finite(key: str) -> bool:
    return key not in _UNBOUNDED


def _without(lines: list[str], k: int, rng: Random) -> list[str]:
    return []


_REQUIRED = r"^(format|name|role|file|length|linear_density|bending_stiffness|hub_inertia|value) = "
_DEEP = 3000

TOML = (
    Kind("number to text", valued('"abc"'), True),
    Kind("number to text of digits", valued(lambda v, r: f'"{v}"'), True),
    Kind("number to true", valued("true"), True),
    Kind("number to NaN", valued("nan"), True),
    Kind("number to infinity", valued("inf", _finite), True),
    Kind("number to -infinity", valued("-inf"), True),
    Kind("number to 1e300", valued("1e300")),
    Kind("number to 1e-300", valued("1e-300")),
    Kind("number to 1e999", valued("1e999", _finite), True),
    Kind("number to integer of 400 digits", valued("1" + "0" * 400), True),
    Kind("number to integer of 5000 digits", valued("1" * 5000), True),
    Kind("sign turned", valued(lambda v, r: f"-{v.lstrip('+-')}", _positive), True, ("requirements",)),
    Kind("any sign turned", valued(lambda v, r: v[1:] if v[0] == "-" else f"-{v}")),
    Kind("positive number to zero", valued("0.0", lambda key: bool(_NOT_ZERO.fullmatch(key))), True),
    Kind("any number to zero", valued("0")),
    Kind("a million times", valued(lambda v, r: f"{1e6 * float(v):.6g}")),
    Kind("a millionth", valued(lambda v, r: f"{1e-6 * float(v):.6g}")),
    Kind("length in mm", valued(lambda v, r: f"{1e3 * float(v):g}", lambda key: key == "length"), True),
    Kind("random magnitude", valued(lambda v, r: f"{r.choice((-1, 1)) * 10 ** r.uniform(-20, 20):.6g}")),
    Kind("number to list", valued(lambda v, r: f"[{v}]"), True),
    Kind("number to table", valued(lambda v, r: f"{{ a = {v} }}"), True),
    Kind("number to date", valued("2024-02-30T00:00:00Z"), True),
    Kind("number to day", valued("1979-05-27"), True),
    Kind("number to nested lists", valued("[" * _DEEP + "]" * _DEEP), True),
    Kind("number to nested tables", valued("{ a = " * _DEEP + "1" + " }" * _DEEP), True),
    Kind("text to number", valued("3", pattern=_TEXT), True),
    Kind("text to list", valued('["a", "b"]', pattern=_TEXT), True),
    Kind("text emptied", texted('""', lambda key: key not in _FREE_TEXT), True),
    Kind("unknown unit or role", texted('"furlong"', lambda key: key in _CHOSEN), True),
    Kind("terminal escapes in a text", texted(r'"\u001b[31mred\u001b]0;title\u0007"')),
    Kind("escapes in a unit, role or file", texted(r'"\u001b[2J"', lambda key: key in _CHOSEN), True),
    Kind("markup in a text", texted('"[bold red]x[/] <script>alert(1)</script> {{ 7*7 }} %s"')),
    Kind("path in a text", texted('"../../etc/passwd"')),
    Kind("long text", texted(f'"{"x" * 20_000}"')),
    Kind("unicode in a text", texted('"\u202eabc\u0000\u2028 \U0001f600 \u0301"'.replace("\x00", ""))),
    Kind("line ends in a text", texted(r'"a\nb\r\nError: c"')),
    Kind("required key deleted", _with_line(_without, _REQUIRED), True, ("requirements",)),
    Kind("unit deleted", _with_line(_without, r"^unit = "), True, ("rig",)),
    Kind("any line deleted", _with_line(lambda lines, k, rng: [], r".")),
    Kind("key twice", _with_line(lambda lines, k, rng: [lines[k], lines[k]]), True),
    Kind("table twice", _table_twice, True),
    Kind("key renamed", _with_line(lambda lines, k, rng: [f"x{lines[k]}"]), True),
    Kind("key with escapes", _with_line(lambda lines, k, rng: [rf'"\u001b[31m{k}" = 1']), True),
    Kind("long key", _with_line(lambda lines, k, rng: [f"{'k' * 20_000} = 1"]), True),
    Kind("unknown table", lambda content, rng: content + b"\n[nonsense]\nx = 1\n", True),
    Kind("lines shuffled", lambda content, rng: _joined(rng.sample(lines := _lines(content), len(lines)))),
)
"""Kinds for TOML files."""


# CSV


def _cell(change: Callable[[str, Random], str], column: int | None = None, first: int = 2) -> Mutate:
    """Changes one field of one row; of a given column, or of any."""

    def mutate(content: bytes, rng: Random) -> bytes | None:
        lines = _lines(content)
        rows = [k for k, line in enumerate(lines) if k >= first and line]
        if not rows:
            return None
        k = rng.choice(rows)
        cells = lines[k].split(",")
        at = rng.randrange(len(cells)) if column is None else column
        cells[at] = change(cells[at], rng)
        lines[k] = ",".join(cells)
        return _joined(lines)

    return mutate


def _columns(change: Callable[[float, int], float]) -> Mutate:
    """Changes the first column, the time: `change` takes value and row."""

    def mutate(content: bytes, rng: Random) -> bytes | None:
        head, *rows = content.decode("utf-8").strip().split("\n")
        parts = [row.partition(",") for row in rows]
        try:
            changed = [f"{change(float(a), k):.15g}{comma}{b}" for k, (a, comma, b) in enumerate(parts)]
        except ValueError:
            return None
        return _joined([head, *changed, ""])

    return mutate


def _rows(change: Callable[[list[str], Random], list[str]]) -> Mutate:
    """Changes the rows after the header."""

    def mutate(content: bytes, rng: Random) -> bytes:
        head, *rows = content.decode("utf-8").strip().split("\n")
        return _joined([head, *change(rows, rng), ""])

    return mutate


def _header(change: Callable[[list[str], Random], list[str]]) -> Mutate:
    """Changes the names of the columns."""

    def mutate(content: bytes, rng: Random) -> bytes:
        head, *rows = content.decode("utf-8").split("\n")
        return _joined([",".join(change(head.split(","), rng)), *rows])

    return mutate


def _row_twice(rows: list[str], rng: Random) -> list[str]:
    k = rng.randrange(len(rows))
    return [*rows[: k + 1], *rows[k:]]


def _swapped(rows: list[str], rng: Random) -> list[str]:
    k = rng.randrange(len(rows) - 1)
    return [*rows[:k], rows[k + 1], rows[k], *rows[k + 2 :]]


_ANY_ORDER = ("static",)  # rows may stand in any order
_NO_CLOCK = (*_ANY_ORDER, "patch", "run")
"""Targets whose first column is no time of a card: runs are compared over the time that they share."""

CSV = (
    Kind("field to text", _cell(lambda v, r: "abc"), True),
    Kind("field to infinity", _cell(lambda v, r: "inf"), True),
    Kind("field to 1e200", _cell(lambda v, r: "1e200"), True),
    Kind("field to 1e99", _cell(lambda v, r: "1e99")),
    Kind("field to 1e-320", _cell(lambda v, r: "1e-320")),
    Kind("field to NaN", _cell(lambda v, r: "NaN")),
    Kind("first field to NaN", _cell(lambda v, r: "nan", 0), True, _ANY_ORDER),
    Kind("first field emptied", _cell(lambda v, r: "", 0), True, _ANY_ORDER),
    Kind("field emptied", _cell(lambda v, r: "")),
    Kind("field with underscore", _cell(lambda v, r: "1_0"), True),
    Kind("field in hexadecimal", _cell(lambda v, r: "0x1A"), True),
    Kind("field with unit", _cell(lambda v, r: f"{v} rad"), True),
    Kind("field with escapes", _cell(lambda v, r: "\x1b[31m1"), True),
    Kind("field of a megabyte", _cell(lambda v, r: "7" * 1_000_000), True),
    Kind("field with markup", _cell(lambda v, r: "[red]<b>"), True),
    Kind("unbalanced quote", _cell(lambda v, r: f'"{v}')),
    Kind("row with one field more", _rows(lambda rows, r: [*rows[:-1], rows[-1] + ",1"]), True),
    Kind("row with one field less", _rows(lambda rows, r: [*rows[:-1], rows[-1].rpartition(",")[0]]), True),
    Kind("row twice", _rows(_row_twice), True, _ANY_ORDER),
    Kind("rows swapped", _rows(_swapped), True, _ANY_ORDER),
    Kind("rows shuffled", _rows(lambda rows, r: r.sample(rows, len(rows))), True, _ANY_ORDER),
    Kind("rows backwards", _rows(lambda rows, r: rows[::-1]), True, _ANY_ORDER),
    Kind("rows deleted", _rows(lambda rows, r: [row for row in rows if r.random() < 0.7])),
    Kind("one row", _rows(lambda rows, r: rows[:1]), True, _ANY_ORDER),
    Kind("no rows", _rows(lambda rows, r: []), True),
    Kind("time jumps by a million", _columns(lambda t, k: t + 1e6 * (k > 9)), True, _NO_CLOCK),
    Kind("time in tiny steps", _columns(lambda t, k: 1e-12 * t), True, _NO_CLOCK),
    Kind("time in ms", _columns(lambda t, k: 1e3 * t), True, _NO_CLOCK),
    Kind("time since 1970", _columns(lambda t, k: 1.7e9 + t)),
    Kind("time stands still", _columns(lambda t, k: 0.0), True, _ANY_ORDER),
    Kind("time without end", _columns(lambda t, k: 1e30 * t), True, _NO_CLOCK),
    Kind("time negative", _columns(lambda t, k: t - 1e4)),
    Kind("header deleted", lambda content, rng: content.partition(b"\n")[2], True),
    Kind("column named twice", _header(lambda names, r: [names[0], *names[:-1]]), True),
    Kind("first column renamed", _header(lambda names, r: ["x" + names[0], *names[1:]]), True, _ANY_ORDER),
    Kind("columns with markup", _header(lambda names, r: [f"[red]{n}[/x]" for n in names]), True, _ANY_ORDER),
    Kind("columns with escapes", _header(lambda names, r: [f"\x1b[1m{n}" for n in names]), True, _ANY_ORDER),
    Kind("column of a long name", _header(lambda names, r: ["n" * 50_000, *names[1:]]), True, _ANY_ORDER),
    Kind("semicolons", lambda content, rng: content.replace(b",", b";")),
    Kind("tabs", lambda content, rng: content.replace(b",", b"\t")),
    Kind("decimal commas", lambda content, rng: content.replace(b".", b","), True),
    Kind("blank lines", lambda content, rng: content.replace(b"\n", b"\n\n")),
    Kind("comment first", lambda content, rng: b"# recorded today\n" + content),
)
"""Kinds for CSV files."""


# Any file


def _flipped(content: bytes, rng: Random) -> bytes:
    broken = bytearray(content)
    for _ in range(rng.randint(1, 20)):
        broken[rng.randrange(len(broken))] = rng.randrange(256)
    return bytes(broken)


def _with_inserted(piece: bytes) -> Mutate:
    def mutate(content: bytes, rng: Random) -> bytes:
        at = rng.randrange(1, len(content))
        return content[:at] + piece + content[at:]

    return mutate


_TEXT_TABLES = ("recording", "static", "patch", "run")
"""Targets that may be in other encodings than UTF-8."""


def _utf16(content: bytes, rng: Random) -> bytes:
    return content.decode("utf-8").encode("utf-16")


FILE = (
    Kind("empty file", lambda content, rng: b"", True, ("requirements",)),
    Kind("blank file", lambda content, rng: b" \n\n \n", True, ("requirements",)),
    Kind("truncated", lambda content, rng: content[: rng.randrange(len(content))]),
    Kind("byte-order mark", lambda content, rng: b"\xef\xbb\xbf" + content),
    Kind("UTF-16", _utf16, True, _TEXT_TABLES),
    Kind("a byte that is no UTF-8", _with_inserted(b"\xff"), True, _TEXT_TABLES),
    Kind("NUL inserted", _with_inserted(b"\x00")),
    Kind("line ends of Windows", lambda content, rng: content.replace(b"\n", b"\r\n")),
    Kind("line ends of old", lambda content, rng: content.replace(b"\n", b"\r")),
    Kind("bytes overwritten", _flipped),
    Kind("random bytes", lambda content, rng: rng.randbytes(2000), True),
    Kind("one long line", lambda content, rng: b"a" * 2_000_000, True),
    Kind("content repeated", lambda content, rng: content + content, True, ("static", "controller")),
)
"""Kinds for the bytes of any file."""


# Controllers in Python


def _law(body: str) -> Mutate:
    return lambda content, rng: f"def law(measured, reference):\n    {body}\n".encode()


CONTROLLER = (
    Kind("returns NaN", _law('return float("nan")'), True),
    Kind("returns infinity", _law('return float("inf")'), True),
    Kind("returns text", _law('return "0.1 N m"'), True),
    Kind("returns None", _law("pass"), True),
    Kind("returns a list", _law("return [1.0, 2.0]"), True),
    Kind("returns 1e300", _law("return 1e300")),
    Kind("returns an integer of 400 digits", _law("return 10**400"), True),
    Kind("raises", _law('raise RuntimeError("\\x1b[31m" + 9999 * "x")'), True),
    Kind("divides by zero", _law("return 1 / 0"), True),
    Kind("leaves Python", _law("raise SystemExit(0)"), True),
    Kind("recurses", _law("return law(measured, reference)"), True),
    Kind("one argument", lambda content, rng: b"def law(measured):\n    return 0.0\n", True),
    Kind("does not parse", lambda content, rng: content + b"\ndef (:\n", True),
    Kind("lacks the name", lambda content, rng: b"x = 1\n", True),
    Kind("is a number", lambda content, rng: b"law = 3\n", True),
    Kind("imports what is not there", lambda content, rng: b"import no_such_module_here\n", True),
    Kind("leaves Python on import", lambda content, rng: b"import sys\nsys.exit(0)\n" + content, True),
    Kind("raises on import", lambda content, rng: b"raise ValueError('x')\n" + content, True),
    Kind("asks for a column that is not there", _law('return measured["speed"]'), True),
    Kind("changes its input", _law("measured.clear(); return 0.0")),
)
"""Kinds for controllers."""
