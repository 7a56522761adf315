"""A run shown: in a file, or in the viewer piece by piece while it goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from twin.control.closed_loop import Run
from twin.control.experiment import Experiment
from twin.errors import InputError
from twin.report import run_rerun
from twin.report.run_csv import read_track
from twin.report.run_rerun import Track


def beside(experiment: Experiment, what: str) -> Track | None:
    """Returns what is shown beside an experiment: "other" plant, "none", or a CSV file of a run or of a campaign.

    Raises:
      InputError: it is none of these, the other plant has no such effect, or the file cannot be read.
    """
    if what == "none":
        return None
    if what == "other":
        other = replace(experiment, plant="chain" if experiment.plant == "modal" else "modal")
        return run_rerun.of_run(other.run(), other.plant)
    if not what.endswith(".csv"):
        raise InputError(f"'{what}' is no ghost; expected other, none, or a CSV file")
    return read_track(Path(what), experiment.rig)


def run_shown(
    experiment: Experiment,
    rrd: Path | None,
    view: bool,
    ghost: str,
    remark: Callable[[str], None] = lambda text: None,
) -> Run:
    """Runs an experiment and shows it: in a file, or in the viewer piece by piece while it goes on.

    Args:
      experiment: what is run.
      rrd: file for the viewer; None for none.
      view: show it in the viewer, which is started.
      ghost: what is shown beside it, see `beside`.
      remark: told why the other plant is not shown, where it has no such effect.
    """
    if rrd is None and not view:
        return experiment.run()
    name, length = f"{experiment.scenario}, {experiment.plant}", experiment.rig["length"]
    try:
        other = beside(experiment, ghost)
    except InputError as error:
        if ghost != "other":
            raise
        other = None
        remark(f"No ghost is shown: {str(error).partition(';')[0]}.")
    run = _run_in_viewer(experiment, other, name) if view else experiment.run()
    if rrd is not None:
        track = run_rerun.of_run(run, experiment.plant)
        run_rerun.write_rrd([track] if other is None else [track, other], length, rrd, name)
    return run


def _run_in_viewer(experiment: Experiment, ghost: Track | None, name: str) -> Run:
    stream = run_rerun.open_viewer(name)
    sender: run_rerun.RunStream | None = None

    def show(piece: Run) -> None:
        nonlocal sender
        track = run_rerun.of_run(piece, experiment.plant)
        if sender is None:
            tracks = [track] if ghost is None else [track, ghost]
            sender = run_rerun.RunStream(stream, tracks, experiment.rig["length"])
            if ghost is not None:
                sender.send(1, ghost)
        sender.send(0, track)
        if ghost is not None:
            sender.send_differences(track, [ghost])

    run = experiment.run(show)
    run_rerun.close(stream)
    return run
