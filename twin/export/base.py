"""What every exporter of a rig gets and gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from twin.control.plants import make_model
from twin.export.linear import LinearModel, linear_model
from twin.parameters import Rig
from twin.rigs.model import Model


@dataclass(frozen=True)
class RigToExport:
    """A rig with its effects, as a parameter file declares them.

    Attributes:
      rig: without effects.
      effects: effect -> parameter -> value, SI.
      hub_angle: about which a linear model is made [rad].
    """

    rig: Rig
    effects: Mapping[str, Mapping[str, float]]
    hub_angle: float = 0.0

    @cached_property
    def model(self) -> Model:
        """The chain with the effects applied."""
        return make_model(self.rig, self.effects)

    @cached_property
    def linear(self) -> LinearModel:
        """The chain linearised about rest at `hub_angle`."""
        return linear_model(self.model, self.hub_angle)


@dataclass(frozen=True)
class Exported:
    """A rig as a file.

    Attributes:
      content: of the file.
      left_out: what the file lacks, in words.
    """

    content: str | bytes
    left_out: tuple[str, ...]


class Exporter:
    """A format in which a rig is written.

    Attributes:
      name: of the format, as `--format` takes it.
      suffix: ending of its files.
      what: what the file is, in a few words.
    """

    name: str
    suffix: str
    what: str

    def export(self, given: RigToExport) -> Exported:
        """Returns a rig as a file.

        Raises:
          InputError: a library is not installed, or the rig cannot be said in this format.
        """
        raise NotImplementedError
