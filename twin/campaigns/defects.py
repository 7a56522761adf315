"""Defects that the readings of a channel show by themselves: frozen, saturated or noisy stretches, missing rows.

A resting hub behind a coarse converter repeats its reading, and so does a bridge that nothing bends. Where the noise
s of a channel is not below the step q of its converter, two successive readings are equal with probability
q / (s sqrt(4 pi)): a long run of equal readings is no measurement. Elsewhere equal readings alone say nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import label, median_filter

from twin.campaigns.readings import sample_clock
from twin.recording import CHANNEL_UNITS, Recording, Sensor

_FEWEST = 200  # readings of a channel that can be judged
_RUN = 12  # equal readings in a row that may be a frozen channel
_CHANCE = 1e-9  # probability in a recording below which equal readings are no measurement
_ONCE_MORE = 1e-2  # the same at the other end of a converter that saturates
_BESIDE = 64  # readings on either side of a run, and of a window, that tell the noise
_JUMP = 12.0  # noise levels, or steps of the converter, of a jump on release
_ABRUPT = 3.0  # times the steps behind it: what leaves a rest by itself starts slowly
_TOP = 3  # equal readings at the extreme that make a plateau; behind a coarse converter, plateaus
_PILE = 8  # equal pairs of readings at the extreme
_BEYOND = 3  # outliers that may lie beyond it
_COARSE_RANGE = 100  # steps of its converter that a saturated channel covers
_NOISY = 6.0  # times its usual noise that a channel has in a bad segment
_NOISY_SPAN = 0.1  # s, window in which the noise is told
_NOISY_SHARE = 1 / 3  # of a recording; what is noisy for longer is noisy
_ORDERS = (4, 8)
_RINGS = 0.4  # correlation beyond the reach of the differences from which it is a vibration
_LISTED = 3  # stretches that a note names


def without_defects(
    recordings: Iterable[Recording], sensors: Mapping[str, Sensor]
) -> tuple[list[Recording], list[str]]:
    """Returns the recordings, NaN where a channel is frozen, saturated or in a bad segment, and what was found.

    Each channel of each recording is judged by itself. Missing rows and readings are noted too.
    """
    kept, notes = [], []
    for recording in recordings:
        clean, said = _cleaned(recording, sensors)
        kept.append(clean)
        notes += [*_missing(recording), *said]
    return kept, notes


def _cleaned(recording: Recording, sensors: Mapping[str, Sensor]) -> tuple[Recording, list[str]]:
    channels, notes = dict(recording.channels), []
    for channel in recording.measured():
        if channel == "hub_angle" and recording.clamped:
            continue
        noise = sensors[channel].noise or 0.0
        readings = _Readings.of(recording, channel, channels[channel], noise)
        for kind in (_saturated, _frozen, _noisy):
            if readings is None:
                break
            bad, said = kind(readings)
            if bad.any():
                channels[channel] = channels[channel].copy()
                channels[channel][readings.index[bad]] = np.nan
                notes.append(f"{recording.name}: {channel} {said}")
                readings = _Readings.of(recording, channel, channels[channel], noise)
    return recording.replace(channels=channels) if notes else recording, notes


@dataclass(frozen=True)
class _Readings:
    """The readings of one channel that are there (n).

    Attributes:
      channel: its name.
      index: (n) of each in the recording.
      time, values, command: (n), SI.
      declared: standard deviation of its noise, 0 where not declared.
      step: of its converter, as successive readings show it.
      runs: (first, last) of each run of `_RUN` equal readings.
      lively: readings outside these runs (m).
      noise: (k x m) of these, the sizes of differences that white noise of variance 1 gives variance 1.
    """

    channel: str
    index: np.ndarray
    time: np.ndarray
    values: np.ndarray
    command: np.ndarray
    declared: float
    step: float
    runs: tuple[tuple[int, int], ...]
    lively: np.ndarray
    noise: np.ndarray

    @classmethod
    def of(cls, recording: Recording, channel: str, raw: np.ndarray, declared: float) -> _Readings | None:
        """The readings of a channel (n, some NaN); None where they are too few or never change."""
        index = np.flatnonzero(np.isfinite(raw))
        if len(index) < _FEWEST or np.ptp(raw[index]) == 0:
            return None
        time, values = recording.time[index], raw[index]
        changes = np.sort(np.abs(np.diff(values)))
        changes = changes[changes > 0]
        # A turn lost or found in unwrapping makes a few changes that are no multiple of the step.
        step = float(changes[min(4, len(changes) - 1)])
        runs = tuple((a, b) for a, b in _equal_runs(values) if b - a + 1 >= _RUN)
        alive = np.ones(len(values), dtype=bool)
        for first, last in runs:
            alive[first : last + 1] = False
        lively = np.flatnonzero(alive)
        if len(lively) < _BESIDE:
            return None
        noise = np.abs(_differences(time[lively], values[lively]))
        command = recording["torque_command"][index]
        return cls(channel, index, time, values, command, declared, step, runs, lively, noise)

    def chance(self, noise: float, pairs: np.ndarray) -> float:
        """Probability that two successive readings are equal, at least the share that is among these pairs (k)."""
        share = (np.count_nonzero(pairs) + 1) / (len(pairs) + 2)
        return max(self.step / (noise * np.sqrt(4 * np.pi)), share)

    def noisy_at_rest(self) -> bool:
        """Whether the channel is seen to have its noise where it does not move."""
        windows = len(self.lively) // _BESIDE
        values = self.values[self.lively][: windows * _BESIDE].reshape(windows, _BESIDE)
        sizes = self.noise[:, : windows * _BESIDE].reshape(-1, windows, _BESIDE)
        level = 1.4826 * np.median(sizes, axis=2).min(axis=0)
        return bool(np.count_nonzero((level >= self.step) & (values.std(axis=1) < 1.5 * level)) >= 2)


def _differences(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Divided differences (k x n) that pass white noise with its variance and hardly anything that is smooth.

    By the time stamps and by the count: it may be the stamps that scatter.
    """
    count = np.arange(len(time), dtype=float)
    stamps = (time - time[0]) / np.median(np.diff(time))
    return np.array([_difference(axis, values, order) for order in _ORDERS for axis in (stamps, count)])


def _difference(axis: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    at = sliding_window_view(axis, order + 1)
    weights = np.empty(at.shape)
    for j in range(order + 1):
        weights[:, j] = 1 / np.prod(np.delete(at[:, j : j + 1] - at, j, axis=1), axis=1)
    found = (weights * sliding_window_view(values, order + 1)).sum(axis=1) / np.linalg.norm(weights, axis=1)
    return np.pad(found, order // 2, mode="edge")


def _equal_runs(values: np.ndarray) -> list[tuple[int, int]]:
    """(first, last) of each run of at least two equal values."""
    stretches, count = label(np.diff(values) == 0)
    edges = np.flatnonzero(np.diff(np.r_[0, stretches > 0, 0]))
    return [(int(a), int(b)) for a, b in edges.reshape(count, 2)]


# Frozen channels


def _frozen(readings: _Readings) -> tuple[np.ndarray, str]:
    """Readings (n) that repeat one another though the channel has noise, or though it moves."""
    found = [(a, b) for a, b in readings.runs if _noise_is_gone(readings, a, b) or _moves_on(readings, a, b)]
    bad = np.zeros(len(readings.values), dtype=bool)
    for first, last in found:
        bad[first : last + 1] = True
    held = ", ".join(dict.fromkeys(_said(readings, readings.values[a]) for a, _ in found[:_LISTED]))
    return bad, f"stays at {held} {_when(readings, found)}; left out there"


def _noise_is_gone(readings: _Readings, first: int, last: int) -> bool:
    middle = int(np.searchsorted(readings.lively, first))
    before, after = slice(max(0, middle - _BESIDE), middle), slice(middle, middle + _BESIDE)
    sides = [s for s in (before, after) if len(readings.lively[s]) >= _BESIDE // 2]
    at_start = len(readings.lively[before]) < _BESIDE // 2
    if not sides:
        return False
    noise = 1.4826 * min(float(np.median(readings.noise[:, s], axis=1).min()) for s in sides)
    about = [readings.values[readings.lively[s]] for s in sides]
    if noise < _step(np.concatenate(about), readings.step):
        return False
    chance = max(readings.chance(noise, np.diff(values) == 0) for values in about)
    if len(readings.values) * chance ** (last - first) > _CHANCE:
        return False
    if readings.channel == "motor_torque":
        # An amplifier that is asked for nothing may deliver exactly that.
        return float(np.ptp(readings.command[first : last + 1])) > _JUMP * noise
    if readings.channel != "hub_angle" and not at_start:
        return True
    # A wiper may be noisy in motion alone.
    return readings.noisy_at_rest() or _jumps(readings, last, noise)


def _step(values: np.ndarray, least: float) -> float:
    """Step of the converter among these readings (n): decimals may be cut where a value is large."""
    levels = np.unique(values)
    return max(least, float(np.diff(levels).min())) if len(levels) > 1 else least


def _moves_on(readings: _Readings, first: int, last: int) -> bool:
    """Whether a channel that repeats itself moves steadily right before, and elsewhere right behind."""
    if readings.channel == "motor_torque" or first < 4 or last + 6 > len(readings.values):
        return False
    before = np.diff(readings.values[first - 4 : first + 1])
    after = np.diff(readings.values[last + 1 : last + 6])
    steady = (_steady(before, readings.step), _steady(after, readings.step))
    return all(steady) and _jumps(readings, last, readings.declared)


def _steady(steps: np.ndarray, least: float) -> bool:
    sizes = np.abs(steps)
    one_way = abs(np.sign(steps).sum()) == len(steps)
    return bool(one_way and sizes.min() > 1.5 * least and sizes.max() < 3 * sizes.min())


def _jumps(readings: _Readings, last: int, noise: float) -> bool:
    behind = np.abs(np.diff(readings.values[last : last + 6]))
    if len(behind) < 5:
        return False
    return bool(behind[0] > _JUMP * max(noise, readings.step) and behind[0] > _ABRUPT * behind[1:].max())


# Saturated converters


def _saturated(readings: _Readings) -> tuple[np.ndarray, str]:
    """Readings (n) that pile up at exactly the largest or the smallest value."""
    values = readings.values
    bad = np.zeros(len(values), dtype=bool)
    plateaus: list[tuple[int, int]] = []
    levels: list[str] = []
    if readings.channel == "motor_torque":
        return bad, ""  # a torque stays at its limit, and at 0
    # A converter that surely ends on one side does on the other, be it reached but once.
    for sign in (1.0, -1.0, 1.0):
        for level in np.unique(sign * values)[::-1][: _BEYOND + 1]:
            runs = [(a, b) for a, b in _equal_runs(values) if sign * values[a] == level]
            new = not bad[sign * values == level].any()
            beyond = np.count_nonzero(sign * values > level)
            if new and beyond <= _BEYOND and _piled_up(readings, runs, sign, bool(levels)):
                bad |= sign * values == level
                plateaus += runs
                levels.append(_said(readings, sign * level))
                break
    return bad, f"is saturated at {' and '.join(levels)} {_when(readings, sorted(plateaus))}; left out there"


def _piled_up(readings: _Readings, runs: Sequence[tuple[int, int]], sign: float, other: bool) -> bool:
    """Whether these runs of equal readings at an extreme are too many; `other`: those at the other one are."""
    # What never moved before its first change lies at an extreme too.
    flat = [(a, b) for a, b in runs if b - a + 1 >= _TOP and a > 0]
    pairs = sum(b - a for a, b in runs if a > 0)
    # A single stretch of a hub that does not move is a frozen one, if anything.
    fewest = 2 if readings.channel == "hub_angle" else 1
    if len(flat) < fewest or pairs < (_TOP - 1 if other else _PILE):
        return False
    noise = 1.4826 * float(np.median(readings.noise, axis=1).min())
    outer = sign * readings.values >= np.quantile(sign * readings.values, 0.8)
    if noise >= _step(readings.values[outer], readings.step):
        if readings.channel == "hub_angle" and not readings.noisy_at_rest():
            return False
        elsewhere = readings.values != readings.values[runs[0][0]]
        equal = (np.diff(readings.values) == 0)[elsewhere[:-1]]
        chance = readings.chance(noise, equal) ** pairs
        return bool(len(readings.values) * chance < (_ONCE_MORE if other else _CHANCE))
    if readings.channel == "hub_angle":
        return False  # it may rest at its farthest
    # Behind a coarse converter a peak is flat too, but not where the channel comes and leaves at full speed.
    if np.ptp(readings.values) < _COARSE_RANGE * readings.step:
        return False
    return sum(_cut_off(sign * readings.values, a, b, 6 * readings.step) for a, b in flat) >= _TOP


def _cut_off(values: np.ndarray, first: int, last: int, least: float) -> bool:
    if first < 3 or last + 4 > len(values):
        return False
    rise, fall = np.diff(values[first - 3 : first]), -np.diff(values[last + 1 : last + 4])
    return bool(min(rise[-1], fall[0]) > least and min(rise[0], fall[-1]) > least / 2)


# Bad segments


def _noisy(readings: _Readings) -> tuple[np.ndarray, str]:
    """Readings (n) in stretches with many times the channel's usual noise."""
    period = float(np.median(np.diff(readings.time)))
    window = 2 * max(_BESIDE, round(_NOISY_SPAN / period)) // 2 + 1
    none = np.zeros(len(readings.values), dtype=bool), ""
    if len(readings.lively) < 4 * window:
        return none
    # Most channels have no noisy half of a window anywhere.
    halves = len(readings.lively) // (window // 2)
    blocks = readings.noise[:, : halves * (window // 2)].reshape(-1, halves, window // 2)
    level = 1.4826 * np.median(blocks, axis=2).min(axis=0)
    least = max(readings.declared, readings.step / np.sqrt(12), float(np.median(level)))
    if level.max() < _NOISY * least / 2:
        return none
    level = _levels(readings.noise, window)
    usual = np.maximum(np.median(level), max(readings.declared, readings.step / np.sqrt(12)))
    limit = np.full(len(level), _NOISY * usual)
    if readings.channel == "motor_torque":
        # A torque follows its command, with the noise that a controller puts into it.
        asked = np.abs(_differences(readings.time[readings.lively], readings.command[readings.lively]))
        limit = np.maximum(limit, _NOISY * _levels(asked, window))
    stretches, count = label(level > limit / 2)
    signed = _difference(np.arange(len(readings.lively), dtype=float), readings.values[readings.lively], 4)
    bad, found, times = none[0].copy(), [], []
    for number in range(1, count + 1):
        inside = np.flatnonzero(stretches == number)
        coarse = _NOISY * _step(readings.values[readings.lively[inside]], readings.step) / np.sqrt(12)
        if (
            np.count_nonzero((level > limit)[inside]) < window * 3 // 4
            or np.median(level[inside]) < coarse
            or _rings(signed[inside])
        ):
            continue
        # Within half a window of its ends the differences tell where the noise begins and ends.
        near = slice(max(0, inside[0] - window // 2), inside[-1] + window // 2 + 1)
        strong = near.start + np.flatnonzero(np.abs(signed[near]) > 4 * usual)
        first, last = int(readings.lively[strong[0]]), int(readings.lively[strong[-1]])
        bad[first : last + 1] = True
        found.append((first, last))
        times.append(float(np.median(level[inside])) / usual)
    if not found or bad.sum() > _NOISY_SHARE * len(bad):
        return none
    return bad, f"has {max(times):.0f} times its usual noise {_when(readings, found)}; left out there"


def _levels(sizes: np.ndarray, window: int) -> np.ndarray:
    """Noise about each reading (m) from the sizes of differences (k x m), the least that any of them tells."""
    return 1.4826 * median_filter(sizes, (1, window), mode="nearest").min(axis=0)


def _rings(differences: np.ndarray) -> bool:
    """Whether differences of order 4 (n) go on beyond the noise: a vibration does, white noise does not."""
    centred = np.clip(differences, *np.quantile(differences, (0.02, 0.98)))
    lags = range(_ORDERS[0] + 1, min(4 * _ORDERS[0] + 9, len(centred) // 2))
    power = float(centred @ centred)
    return any(abs(float(centred[lag:] @ centred[:-lag])) > _RINGS * power for lag in lags)


# Missing rows and readings


def _missing(recording: Recording) -> list[str]:
    """A note on the rows and readings that are missing, if any are."""
    rows = _rows_missing(recording.time)
    empty = {c: int(np.count_nonzero(np.isnan(recording[c]))) for c in recording.measured()}
    counts = [(rows, "rows"), *((n, f"readings of {c}") for c, n in empty.items() if n < len(recording))]
    said = [f"{n} {what}" for n, what in counts if n]
    return [f"{recording.name}: {', '.join(said)} are missing"] if said else []


def _rows_missing(time: np.ndarray) -> int:
    """Ticks of a uniform clock without a row; 0 where the stamps follow no clock."""
    if len(time) < _FEWEST:
        return 0
    ticks = sample_clock(time)
    steps = np.diff(time if ticks is None else ticks)
    steps = steps / np.median(steps)
    on_clock = np.abs(steps - np.round(steps)) < 0.1
    return int(np.sum(np.round(steps) - 1)) if on_clock.mean() > 0.98 else 0


# What is said


def _said(readings: _Readings, value: float) -> str:
    unit = CHANNEL_UNITS[readings.channel]
    return f"{value:g}{'' if unit == '1' else f' {unit}'}"


def _when(readings: _Readings, stretches: Sequence[tuple[int, int]]) -> str:
    """When the stretches are; many as a whole."""
    if len(stretches) > _LISTED:
        first, last = readings.time[stretches[0][0]], readings.time[stretches[-1][1]]
        return f"in {len(stretches)} stretches from {first:.2f} to {last:.2f} s"
    spans = [f"from {readings.time[a]:.2f} to {readings.time[b]:.2f} s" for a, b in stretches]
    return " and ".join(spans)
