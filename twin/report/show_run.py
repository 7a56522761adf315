"""Runs an experiment and shows it with rerun: in a file, or in the viewer while it is computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from twin.control.closed_loop import Run
from twin.control.experiment import Experiment
from twin.errors import InputError
from twin.files.readers import SUFFIXES
from twin.report import run_rerun
from twin.report.run_files import is_file_of_run, read_track
from twin.report.run_rerun import Track


def ghost_track(experiment: Experiment, what: str) -> Track | None:
    """Returns the track that is shown beside an experiment; None for none.

    Args:
      experiment: what is run.
      what: "other" for the other plant, "none", or a file of a run or of a campaign.

    Raises:
      InputError: it is none of these, the other plant does not model an effect, or the file cannot be read.
    """
    if what == "none":
        return None
    if what == "other":
        other = replace(experiment, plant="chain" if experiment.plant == "modal" else "modal")
        return run_rerun.of_run(other.run(), other.plant)
    if not is_file_of_run(what):
        endings = ", ".join(SUFFIXES)
        raise InputError(f"'{what}' is no ghost; expected other, none, or a file of a run: {endings}")
    return read_track(Path(what), experiment.rig)


def run_and_show(
    experiment: Experiment,
    rrd: Path | None,
    view: bool,
    ghost: str,
    remark: Callable[[str], None] = lambda text: None,
) -> Run:
    """Runs an experiment and shows it in a file, or in the viewer while it is computed.

    Args:
      experiment: what is run.
      rrd: file for the viewer; None for none.
      view: whether to start the viewer and show the run there.
      ghost: what is shown beside it, see `ghost_track`.
      remark: called with the reason where the other plant cannot be shown, because it does not model an effect.
    """
    if rrd is None and not view:
        return experiment.run()
    name, length = f"{experiment.scenario}, {experiment.plant}", experiment.rig["length"]
    try:
        other = ghost_track(experiment, ghost)
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
    """Runs an experiment while its pieces are sent to the viewer."""
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
