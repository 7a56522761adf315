"""Options, console and progress display that several commands use."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.errors import InputError, nearest

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from twin.commands.screen import Screen
    from twin.commands.stages import Stage, Stages
    from twin.parameters import Rig


def _out_folder(kind: str) -> Any:
    return typer.Option(
        "--out", metavar="FOLDER", help="Folder of the results.", show_default=f"<campaign>-{kind}"
    )


CONTROLLERS = (
    "siso, lqi, lqi-zv, lqi-ei, siso-friction, or your own: FILE.py:NAME, which runs with your rights."
)
"""Help text; written out, so that `--help` does not import the library of controllers."""

RIG_NAMES = ("bossi2009", "bossi2009-printed")
CONTROLLER_NAMES = ("siso", "lqi", "lqi-zv", "lqi-ei", "siso-friction")
SCENARIO_NAMES = (
    *("bang-bang-20", "bang-bang-45", "bang-bang-60", "bang-bang-90", "bang-bang-120"),
    *("sinus-0.2", "sinus-0.4", "filtered-step-120", "lq-step-120"),
)
PLANT_NAMES = ("chain", "modal", "compiled", "paper")
FORMAT_NAMES = ("mat", "matlab", "mjcf", "fmu")
"""Names that a shell completes; written out for the same reason."""


def completed(names: Sequence[str]) -> Callable[[str], list[str]]:
    """Returns a function from the beginning of a word to the names that a shell offers for it."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


COMPILING = "loading the equations of motion; the first time they are compiled, which takes up to a minute"

CampaignFolder = Annotated[
    Path,
    typer.Argument(metavar="CAMPAIGN", help="Folder with campaign.toml and the recordings."),
]
JsonFile = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the result here, as JSON.")
]
ReportFile = Annotated[
    Path | None, typer.Option("--report", metavar="FILE", help="Write a report here, as HTML.")
]
RIGS = "bossi2009, bossi2009-printed, or a parameter file (TOML)."
RigOption = Annotated[
    str,
    typer.Option("--rig", metavar="NAME|FILE", help=RIGS, autocompletion=completed(RIG_NAMES)),
]
DeclaredRig = Annotated[
    Path | None,
    typer.Option(
        "--rig",
        metavar="FILE",
        help="Parameter file (TOML) with the declared rig and its known effects.",
        show_default="as the campaign declares it",
    ),
]
SchedulerAddress = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler whose workers do it, as tcp://192.168.0.10:8786.",
    ),
]
DEFAULT_RIG = "bossi2009"
DiagnosisFolder = Annotated[Path | None, _out_folder("diagnosis")]
IdentificationFolder = Annotated[Path | None, _out_folder("identification")]
Force = Annotated[bool, typer.Option("--force", help="Write into a folder that holds other files.")]


def console() -> Screen:
    """Returns the console for results; with --quiet it shows nothing."""
    from twin.commands.screen import Screen, is_quiet

    return Screen(quiet=is_quiet())


@contextmanager
def progress(
    stages: Sequence[Stage] = (), first_line: float | None = None
) -> Iterator[Callable[[str], None]]:
    """Yields a function that shows a text as the current stage on standard error; nothing with --quiet.

    A terminal shows the present text; elsewhere lines are printed once the work takes long.

    Args:
      stages: of the work, for how much of it is done.
      first_line: time before which no line is printed [s]; None for the usual one.
    """
    from twin.commands.screen import Screen, is_quiet
    from twin.commands.stages import FIRST_LINE, Lines, Stages

    screen, followed = Screen(stderr=True), Stages(stages)
    if is_quiet():
        yield lambda text: None
    elif not screen.is_terminal:
        first = FIRST_LINE if first_line is None else first_line
        yield Lines(followed, lambda line: screen.print(line, soft_wrap=True), first).update
    else:
        with _spinner(screen, followed) as show:
            yield show


@contextmanager
def _spinner(screen: Screen, followed: Stages) -> Iterator[Callable[[str], None]]:
    """Yields a function that shows a text beside a spinner and the time."""
    from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TimeElapsedColumn
    from rich.text import Text

    from twin.labels import printable

    plain = screen.options.ascii_only

    class Line(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(printable(followed.line(), plain), no_wrap=True, overflow="ellipsis")

    spinner = SpinnerColumn("line" if plain else "dots")
    with Progress(spinner, TimeElapsedColumn(), Line(), console=screen, transient=True) as display:
        display.add_task("", total=None)
        yield followed.update


def executor(scheduler: str | None) -> AbstractContextManager[Executor | None]:
    """Returns a context with the workers of the scheduler that `--scheduler` names; with None where it names none."""
    if scheduler is None:
        return nullcontext()
    from twin.executors.scheduler import scheduler as workers_of

    return workers_of(scheduler)


def load_rig(name_or_file: str) -> tuple[Rig, dict[str, dict[str, float]]]:
    """Returns a published rig by its name, or the rig and the effects of a parameter file.

    Raises:
      InputError: neither a preset nor a file that can be read.
    """
    from twin.rigs import PRESETS, preset
    from twin.rigs.rig_file import read_rig_file

    path = rig_file(name_or_file)
    if path is not None:
        return read_rig_file(path)
    if name_or_file not in PRESETS:
        known = f"{', '.join(PRESETS)}, or a parameter file (TOML){nearest(name_or_file, PRESETS)}"
        raise InputError(f"'{name_or_file}' is neither a preset nor a file; expected one of: {known}")
    return preset(name_or_file), {}


def rig_file(name_or_file: str) -> Path | None:
    """Returns the parameter file that `--rig` names; None for a preset."""
    from twin.rigs import PRESETS

    path = Path(name_or_file)
    return None if name_or_file in PRESETS or not (path.suffix or path.exists()) else path


def controller_file(name: str | None) -> Path | None:
    """Returns the FILE.py of a controller FILE.py:NAME; None for one of the library, or none at all."""
    file, _, _ = (name or "").rpartition(":")
    return Path(file) if file.endswith(".py") else None


_FILE_INSTEAD = "write a file with `twin run SCENARIO --rrd FILE` and open it elsewhere with `rerun FILE`"


def require_display(what: str, instead: str = _FILE_INSTEAD) -> None:
    """Checks that a window can be opened.

    Args:
      what: needs it.
      instead: what can be done without one.

    Raises:
      InputError: no display is set, or the one that is set cannot be opened.
    """
    if not sys.platform.startswith("linux"):
        return
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise _no_display(what, "DISPLAY and WAYLAND_DISPLAY are not set", instead)
    if not _display_opens():
        raise _no_display(what, "the one that DISPLAY or WAYLAND_DISPLAY names cannot be opened", instead)


def _display_opens() -> bool:
    import glfw  # which MuJoCo's viewer uses

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        opened = bool(glfw.init())
        glfw.terminate()
    return opened


def _no_display(what: str, why: str, instead: str) -> InputError:
    return InputError(f"{what} needs a display, and {why}; {instead}")
