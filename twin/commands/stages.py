"""How far a long computation is: stage of how many, and the time left, from the messages of its progress."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence

from twin.labels import duration

_COUNTED = re.compile(r"\b(\d+) of (\d+)\b")
_EARLY = 0.05  # share of the work, before which the time left would be a guess
FIRST_LINE = 10.0
"""Time before which no line is printed [s]: most commands have ended."""
_BETWEEN_LINES = 30.0  # s between lines of one stage

Stage = tuple[str, float]
"""Beginning of the message with which a stage begins, and its usual share of the time of all stages [1]."""


class Stages:
    """Follows the messages of a computation.

    Attributes:
      text: the last message.
      number: of the present stage, from 1 on; 0 where there are no stages, or before the first.
    """

    def __init__(self, stages: Sequence[Stage] = (), clock: Callable[[], float] = time.monotonic) -> None:
        """Takes the stages in order, and a clock [s]."""
        self._stages, self._clock = tuple(stages), clock
        self._began = self._updated = clock()
        self._share = 0.0
        self.text, self.number = "starting", 0

    def update(self, text: str) -> None:
        """Takes a message; a computation that goes back to an earlier stage stays where it is."""
        self.text = text
        begun = [k for k, (start, _) in enumerate(self._stages, 1) if text.startswith(start)]
        self.number = max(self.number, *begun) if begun else self.number
        done = self._done()
        if done > self._share:
            self._share, self._updated = done, self._clock()

    def _done(self) -> float:
        """Share of the work that is done when the last message comes [1]."""
        counted = _COUNTED.search(self.text)
        inside = (int(counted[1]) - 1) / max(int(counted[2]), 1) if counted else 0.0
        if not self._stages:
            return inside
        total = sum(share for _, share in self._stages)
        before = sum(share for _, share in self._stages[: max(self.number - 1, 0)])
        own = self._stages[self.number - 1][1] if self.number else 0.0
        return (before + inside * own) / total

    @property
    def elapsed(self) -> float:
        """Time since the beginning [s]."""
        return self._clock() - self._began

    @property
    def left(self) -> float | None:
        """Expected time to the end [s]; None while too little is done to tell, or later than expected."""
        if not _EARLY <= self._share < 1:
            return None
        at_update = (self._updated - self._began) * (1 - self._share) / self._share
        left = at_update - (self._clock() - self._updated)
        return left if left > 0 else None

    def line(self) -> str:
        """Returns stage, time left and message in a line."""
        where = [f"{self.number} of {len(self._stages)}"] if self.number else []
        left = [] if self.left is None else [f"about {duration(self.left)} left"]
        head = ", ".join(where + left)
        return f"{head}: {self.text}" if head else self.text


class Lines:
    """Prints lines of progress where there is no terminal: at the beginning of each stage, and sometimes within."""

    def __init__(self, stages: Stages, show: Callable[[str], None], first: float = FIRST_LINE) -> None:
        """Takes what is followed, a function that prints a line, and the time before the first one [s]."""
        self._stages, self._show, self._first = stages, show, first
        self._printed, self._number = 0.0, 0

    def update(self, text: str) -> None:
        """Takes a message; prints it where it is due."""
        stages = self._stages
        stages.update(text)
        now = stages.elapsed
        due = stages.number > self._number or now - self._printed >= _BETWEEN_LINES
        if now >= self._first and due:
            self._show(f"[{duration(now) if now >= 1 else '0 s'}] {stages.line()}")
            self._printed, self._number = now, stages.number
