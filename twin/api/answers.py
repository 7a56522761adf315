"""What the functions of the interface return."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.api.inputs import FilePath, RigFile
from twin.api.table import Table
from twin.campaigns.campaign import Campaign
from twin.control.closed_loop import Run as _Run
from twin.control.experiment import Experiment
from twin.diagnosis.answer import AdoptedEffect
from twin.diagnosis.answer import Diagnosis as _Diagnosis
from twin.errors import InputError
from twin.recording import CHANNEL_UNITS, Recording

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from twin.identification.result import Identification as _Identification


@dataclass(frozen=True)
class Diagnosis:
    """What a campaign's model lacks.

    Attributes:
      answer: all of it, see `twin.diagnosis.answer.Diagnosis`.
      campaign: what was diagnosed.
    """

    answer: _Diagnosis = field(repr=False)
    campaign: Campaign = field(repr=False)

    @property
    def verdict(self) -> str:
        """ "explained", "no-missing-effect" or "outside-library"."""
        return self.answer.verdict

    @property
    def summary(self) -> str:
        """The verdict in plain sentences."""
        from twin.report import display

        return f"{display.headline(self.answer)} {self.answer.summary}".strip()

    @property
    def effects(self) -> tuple[AdoptedEffect, ...]:
        """The adopted effects, the most important first."""
        return self.answer.effects

    @property
    def rig(self) -> RigFile:
        """The augmented rig: fitted parameters, known and adopted effects; for `model`, `run` and `validate`."""
        both = (*self.answer.known, *self.answer.effects)
        return RigFile(self.answer.fitted, {e.name: dict(e.parameters) for e in both})

    def table(self) -> Table:
        """Root-mean-square errors of the held-out recordings, or of all if none was held out, SI units."""
        from twin.report import display

        names = ("recording", "channel", "before", "calibrated", "after", "noise", "unit")
        rows = [
            (file, channel, e.before, e.calibrated, e.after, e.noise, CHANNEL_UNITS[channel])
            for file, prediction in display.evaluated_predictions(self.answer).items()
            for channel, e in prediction.errors.items()
        ]
        return Table.of_rows(names, rows)

    def error_budget(self) -> Table:
        """What calibration and each effect take away of the errors of held-out recordings, or of all; SI units.

        `rms` and `fit_percent` are of the free run of the whole recording, `rms_window` and `fit_percent_window` in
        windows, see `twin.diagnosis.windows`.
        """
        from twin.report import display

        names = ("recording", "channel", "model", "rms_window", "rms", "fit_percent", "fit_percent_window")
        models = display.budget_columns(self.answer)
        rows = [
            (file, c, m, e.rms_window, e.rms, e.fit_percent, e.fit_percent_window, budget.noise, budget.unit)
            for file, prediction in display.evaluated_predictions(self.answer).items()
            for c, budget in prediction.budget.items()
            for m, e in zip(models, budget.models, strict=True)
        ]
        return Table.of_rows((*names, "noise", "unit"), rows)

    def parameters(self) -> Table:
        """Parameters of the adopted effects with standard errors."""
        rows = [
            (e.name, name, value, e.standard_errors.get(name), e.units[name])
            for e in self.effects
            for name, value in e.parameters.items()
        ]
        return Table.of_rows(("effect", "parameter", "value", "standard_error", "unit"), rows)

    def ranking(self) -> Table:
        """All candidates of the first round, each with the round that came nearest to adopting it.

        Columns: effect, round, its score there, and the rule by which it was turned down; no rule of an adopted one. A
        candidate that no round fitted has the score of its score test, and no round.
        """
        turned_down = {name: self.answer.failed_rule(name) for name, _ in self.answer.ranking}
        rows = [
            (
                name,
                self.answer.nearest_round(name),
                self.answer.score(name),
                failed.judgement.rule if (failed := turned_down[name]) is not None else None,
            )
            for name, _ in self.answer.ranking
        ]
        return Table.of_rows(("effect", "round", "score", "turned_down_by"), rows)

    def plot(self, recording: str | None = None) -> go.Figure:
        """Every channel of a recording, measured, before and after; by default the first held-out one.

        Raises:
          InputError: there is no such recording.
        """
        import plotly.io

        from twin.report import display, figures

        shown = self.answer.predictions
        name = (
            recording
            if recording is not None
            else next(iter(display.evaluated_predictions(self.answer)), None)
        )
        if name is None or name not in shown:
            raise InputError(f"there is no recording '{name}'; expected one of: {', '.join(shown)}")
        figure = figures.recording_figure(shown[name])
        if figure is None:
            raise InputError(f"{name} has no channel that is simulated; expected one with readings")
        return plotly.io.from_json(figure.json).update_layout(height=figure.height)

    def save(self, folder: FilePath, force: bool = False) -> dict[str, Path]:
        """Writes report, rerun recording, answer, augmented rig and MJCF; returns what each file is -> its path.

        Args:
          folder: where to; made if it is not there.
          force: whether it may hold something else than earlier results.

        Raises:
          InputError: the folder holds something else, or cannot be written.
        """
        from twin.report import deliver

        chosen = deliver.FOLDER.choose(Path(folder), Path(self.answer.campaign), force)
        return dict(deliver.deliver(self.answer, self.campaign.sensors, chosen).paths)

    def to_json(self) -> dict[str, Any]:
        """Returns the answer as plain values: what `twin diagnose --json` writes."""
        return self.answer.to_json()

    def __repr__(self) -> str:
        names = ", ".join(e.name for e in self.effects)
        return f"<Diagnosis of {self.answer.campaign}: {self.verdict}{f' ({names})' if names else ''}>"

    def _repr_html_(self) -> str:
        import html

        effects = self.parameters()._repr_html_() if self.effects else ""
        text = html.escape(self.summary)
        return f"<p><b>{self.verdict}</b>. {text}</p>{effects}{self.table()._repr_html_()}"


@dataclass(frozen=True)
class Identification:
    """What the recordings of a campaign say of its declared parameters.

    Attributes:
      answer: all of it, see `twin.identification.result.Identification`.
    """

    answer: _Identification = field(repr=False)

    @property
    def trusted(self) -> bool:
        """False where the recordings contradict the model: standard errors and intervals are then NaN."""
        return self.answer.trust.trusted

    @property
    def reason(self) -> str:
        """Why it is trusted or not."""
        return self.answer.trust.reason

    def table(self) -> Table:
        """Declared and identified value of each parameter, standard error and 95 % interval."""
        names = ("parameter", "declared", "value", "standard_error", "low", "high", "unit", "not_determined")
        rows = []
        for name, p in self.answer.all_parameters.items():
            low, high = p.estimate.interval
            why = self.answer.not_determined.get(name)
            rows.append(
                (name, p.declared, p.estimate.value, p.estimate.standard_error, low, high, p.unit, why)
            )
        return Table.of_rows(names, rows)

    def save(self, folder: FilePath, force: bool = False) -> dict[str, Path]:
        """Writes report, answer and rig file; returns what each file is -> its path.

        Raises:
          InputError: the folder holds something else, or cannot be written.
        """
        from twin.identification import deliver

        chosen = deliver.FOLDER.choose(Path(folder), Path(self.answer.campaign), force)
        return dict(deliver.deliver(self.answer, chosen))

    def to_json(self) -> dict[str, Any]:
        """Returns the answer as plain values: what `twin identify --json` writes."""
        return self.answer.to_json()

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()


@dataclass(frozen=True)
class Run:
    """A closed-loop run.

    Attributes:
      experiment: what was run.
      run: samples, states and outline, see `twin.control.closed_loop.Run`.
    """

    experiment: Experiment = field(repr=False)
    run: _Run = field(repr=False)

    @property
    def metrics(self) -> dict[str, float]:
        """Figures of the run, as `twin run --json` writes them."""
        return self.experiment.metrics(self.run)

    @property
    def recording(self) -> Recording:
        """What the sensors and the command line of the rig would have recorded."""
        return self.run.recording(self.experiment.scenario)

    def save(self, file: FilePath) -> Path:
        """Writes the run as a recording (.csv, .mat, .parquet, .mcap) or for the rerun viewer (.rrd).

        Raises:
          InputError: the name ends otherwise, or the file cannot be written.
        """
        path = Path(file)
        if path.suffix == ".rrd":
            from twin.report import run_rerun

            track = run_rerun.of_run(self.run, self.experiment.plant)
            run_rerun.write_rrd([track], self.experiment.rig["length"], path, self.experiment.scenario)
        else:
            from twin.report.run_files import write_run

            write_run(self.run, path)
        return path
