"""The command line `twin`.

An unusable input ends in `Error: ...` and exit code 2. Each command is a function of `twin.commands`; it imports heavy
modules inside, so that `--help` is fast.
"""

from __future__ import annotations

import typer

from twin import terminal
from twin.commands.check import check
from twin.commands.compare import compare
from twin.commands.data import data
from twin.commands.diagnose import demo, diagnose
from twin.commands.export import export
from twin.commands.identify import identify
from twin.commands.new import new
from twin.commands.plan import plan_experiment
from twin.commands.run import run
from twin.commands.validate import validate
from twin.commands.view import view

app = typer.Typer(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None
)


def main() -> None:
    """Runs the command and exits, with 2 for an unusable input and with 128 and the number of a signal after it."""
    terminal.run(app)


@app.callback()
def root() -> None:
    """A MuJoCo digital twin of a planar flexible manipulator that finds what its model lacks."""


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
):
    app.command()(command)

if __name__ == "__main__":
    main()
