"""The diagnosis of one rig as a task: a value goes to a worker, the contents of files come back.

A worker reads and writes no file, so that it may be on another machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from twin.campaigns.campaign import Campaign
from twin.files.provenance import Provenance

Contents: TypeAlias = Mapping[str, str | bytes | None]
"""Name of a file of the results -> its content; None for one that is removed."""


@dataclass(frozen=True)
class Task:
    """What is diagnosed.

    Attributes:
      campaign: the recordings.
      record: of the files that they come from.
      false_alarm_rate: as of a diagnosis.
    """

    campaign: Campaign
    record: Provenance
    false_alarm_rate: float


Solve: TypeAlias = Callable[[Task], Contents]


def diagnosed(task: Task) -> Contents:
    """Diagnoses a campaign in one thread.

    Raises:
      InputError: it cannot be diagnosed.
    """
    from twin.diagnosis.diagnose import diagnose
    from twin.report import deliver

    found = diagnose(task.campaign, workers=1, false_alarm_rate=task.false_alarm_rate)
    return deliver.rendered(replace(found, provenance=task.record), task.campaign.sensors).contents
