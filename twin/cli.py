"""The command line `twin`.

An unusable input ends in `Error: ...` and exit code 2. Each command is a function of `twin.commands`; it imports heavy
modules inside, so that `--help` is fast.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from twin import terminal
from twin.commands.check import check
from twin.commands.compare import compare
from twin.commands.data import data
from twin.commands.diagnose import demo, diagnose
from twin.commands.export import export
from twin.commands.identify import identify
from twin.commands.new import new
from twin.commands.parser import Command
from twin.commands.plan import plan_experiment
from twin.commands.run import run
from twin.commands.validate import validate
from twin.commands.view import view
from twin.commands.virtual_rig import virtual_rig

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)


def main() -> None:
    """Runs the command and exits, with 2 for an unusable input and with 128 and the number of a signal after it."""
    terminal.run(lambda: app(prog_name="twin"))


def _show_version(wanted: bool) -> None:
    if wanted:
        import twin

        typer.echo(f"twin {twin.__version__}")
        raise typer.Exit


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show errors only.")]


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """A MuJoCo digital twin of a planar flexible manipulator that finds what its model lacks."""
    from twin.commands.screen import set_quiet

    set_quiet(quiet)


def _with_quiet(command: Callable[..., None]) -> Callable[..., None]:
    """Returns a command with the option --quiet."""

    @functools.wraps(command)
    def quietable(*, quiet: bool, **given: Any) -> None:
        from twin.commands.screen import set_quiet

        if quiet:
            set_quiet(True)
        command(**given)

    own = inspect.signature(command, eval_str=True)
    option = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet)
    parameters = [*own.parameters.values(), option]
    quietable.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    quietable.__annotations__ = {p.name: p.annotation for p in parameters}
    return quietable


for command in (
    demo,
    new,
    data,
    diagnose,
    check,
    run,
    compare,
    view,
    identify,
    validate,
    plan_experiment,
    export,
    virtual_rig,
):
    app.command(cls=Command)(_with_quiet(command))

if __name__ == "__main__":
    main()
