"""Defects that the readings of one channel show without a model: frozen, saturated or noisy stretches, missing rows.

Equal successive readings alone prove no defect: a resting hub behind a coarse analogue-to-digital converter repeats its
reading, and so does the gauge of a link at rest. But where the noise s of a channel is at least the step q of its
converter, two successive readings are equal with probability q / (s sqrt(4 pi)), so that a long run of equal readings
is practically impossible unless the channel is frozen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import label, median_filter

from twin.campaigns.readings import sample_clock
from twin.recording import CHANNEL_UNITS, ON_HUB, Recording, Sensor, sample_period

_FEWEST = 200  # readings; a channel with fewer is not judged
_RUN = 12  # equal readings in a row from which a channel may be frozen
_CHANCE = 1e-9  # probability per recording of equal readings by chance, below which they are a defect
_SECOND_CHANCE = 1e-2  # the same at one end of a converter that is known to saturate at the other
_NEIGHBOURS = 64  # readings on either side of a run, and in a window, from which the noise is estimated
_JUMP = 12.0  # noise levels, or steps of the converter: least jump at the end of a frozen run
_ABRUPT = 3.0  # least ratio of that jump to the changes after it: true motion from rest starts slowly
_TOP = 3  # equal readings at an extreme that form a plateau; with a coarse converter, also fewest plateaus
_PILE = 8  # least number of equal successive pairs at an extreme
_BEYOND = 3  # most outliers beyond the extreme
_COARSE_RANGE = 100  # steps of the converter: least range of a channel that can be called saturated
_NOISY = 6.0  # ratio of noise to the channel's usual noise, from which a segment is bad
_NOISY_SPAN = 0.1  # s, window in which the noise is estimated
_NOISY_SHARE = 1 / 3  # largest share of bad segments; beyond it the whole channel is that noisy
_ORDERS = (4, 8)  # orders of the differences that estimate the noise
_VIBRATES = 0.4  # autocorrelation beyond the lag of the differences from which their size is vibration
_LISTED = 3  # most stretches that a note lists one by one


def without_defects(
    recordings: Iterable[Recording], sensors: Mapping[str, Sensor]
) -> tuple[list[Recording], list[str]]:
    """Returns the recordings, NaN where a channel is frozen, saturated or too noisy, and notes on what was found.

    Each channel of each recording is judged by itself. Missing rows and readings are noted too.
    """
    kept, notes = [], []
    for recording in recordings:
        clean, found = _cleaned(recording, sensors)
        kept.append(clean)
        notes += [*_missing_notes(recording), *found]
    return kept, notes


def _cleaned(recording: Recording, sensors: Mapping[str, Sensor]) -> tuple[Recording, list[str]]:
    channels, notes = dict(recording.channels), []
    for channel in recording.measured():
        if channel in ON_HUB and recording.clamped:
            continue
        noise = sensors[channel].noise or 0.0
        readings = _Readings.from_channel(recording, channel, channels[channel], noise)
        for defect in (_saturated, _frozen, _noisy):
            if readings is None:
                break
            bad, note = defect(readings)
            if bad.any():
                channels[channel] = channels[channel].copy()
                channels[channel][readings.index[bad]] = np.nan
                notes.append(f"{recording.name}: {channel} {note}")
                readings = _Readings.from_channel(recording, channel, channels[channel], noise)
    return recording.replace(channels=channels) if notes else recording, notes


@dataclass(frozen=True)
class _Readings:
    """The present readings of one channel (n).

    Attributes:
      channel: its name.
      index: (n) index of each in the recording.
      time, values, command: (n) instants, readings, commanded torque, SI.
      declared: declared standard deviation of its noise; 0 without one.
      step: step of its converter, estimated from successive readings.
      runs: first and last index of each run of at least `_RUN` equal readings.
      lively: (m) indices of the readings outside these runs.
      noise: (k, m) absolute differences of these, normalised to variance 1 for white noise of variance 1.
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
    def from_channel(
        cls, recording: Recording, channel: str, raw: np.ndarray, declared: float
    ) -> _Readings | None:
        """Returns the present readings of a channel, `raw` (some NaN); None where they are too few or never change."""
        index = np.flatnonzero(np.isfinite(raw))
        if len(index) < _FEWEST or np.ptp(raw[index]) == 0:
            return None
        time, values = recording.time[index], raw[index]
        changes = np.sort(np.abs(np.diff(values)))
        changes = changes[changes > 0]
        # Not the smallest change: unwrapping an angle makes a few changes that are no multiple of the step.
        step = float(changes[min(4, len(changes) - 1)])
        runs = tuple((a, b) for a, b in _equal_runs(values) if b - a + 1 >= _RUN)
        alive = np.ones(len(values), dtype=bool)
        for first, last in runs:
            alive[first : last + 1] = False
        lively = np.flatnonzero(alive)
        if len(lively) < _NEIGHBOURS:
            return None
        noise = np.abs(_differences(time[lively], values[lively]))
        command = recording["torque_command"][index]
        return cls(channel, index, time, values, command, declared, step, runs, lively, noise)

    def chance(self, noise: float, pairs: np.ndarray) -> float:
        """Probability that two successive readings are equal; at least the observed share, of the mask `pairs` (k)."""
        share = (np.count_nonzero(pairs) + 1) / (len(pairs) + 2)
        return max(self.step / (noise * np.sqrt(4 * np.pi)), share)

    def noisy_at_rest(self) -> bool:
        """Whether at least two windows without motion show noise of at least one step of the converter."""
        windows = len(self.lively) // _NEIGHBOURS
        values = self.values[self.lively][: windows * _NEIGHBOURS].reshape(windows, _NEIGHBOURS)
        sizes = self.noise[:, : windows * _NEIGHBOURS].reshape(-1, windows, _NEIGHBOURS)
        level = 1.4826 * np.median(sizes, axis=2).min(axis=0)
        return bool(np.count_nonzero((level >= self.step) & (values.std(axis=1) < 1.5 * level)) >= 2)


def _differences(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Normalised divided differences (k, n), which pass white noise with its variance and suppress smooth signals.

    By the time stamps and by the sample number, as it may be the stamps that jitter.
    """
    count = np.arange(len(time), dtype=float)
    stamps = (time - time[0]) / np.median(np.diff(time))
    return np.array([_difference(axis, values, order) for order in _ORDERS for axis in (stamps, count)])


def _difference(axis: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    """Divided difference (n) of an order over an axis (n), normalised to unit noise gain, padded at both ends."""
    at = sliding_window_view(axis, order + 1)
    weights = np.empty(at.shape)
    for j in range(order + 1):
        weights[:, j] = 1 / np.prod(np.delete(at[:, j : j + 1] - at, j, axis=1), axis=1)
    differences = (weights * sliding_window_view(values, order + 1)).sum(axis=1) / np.linalg.norm(
        weights, axis=1
    )
    return np.pad(differences, order // 2, mode="edge")


def _equal_runs(values: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each run of at least two equal values."""
    stretches, count = label(np.diff(values) == 0)
    edges = np.flatnonzero(np.diff(np.r_[0, stretches > 0, 0]))
    return [(int(a), int(b)) for a, b in edges.reshape(count, 2)]


# Frozen channels


def _frozen(readings: _Readings) -> tuple[np.ndarray, str]:
    """Mask (n) of readings that repeat although the channel has noise or moves, and a note on them."""
    runs = [
        (a, b) for a, b in readings.runs if _noise_vanishes(readings, a, b) or _moves_around(readings, a, b)
    ]
    bad = np.zeros(len(readings.values), dtype=bool)
    for first, last in runs:
        bad[first : last + 1] = True
    held = ", ".join(dict.fromkeys(_with_unit(readings, readings.values[a]) for a, _ in runs[:_LISTED]))
    return bad, f"stays at {held} {_time_text(readings, runs)}; left out there"


def _noise_vanishes(readings: _Readings, first: int, last: int) -> bool:
    """Whether a run of equal readings is too long to occur by chance, given the noise before and after it."""
    middle = int(np.searchsorted(readings.lively, first))
    before, after = slice(max(0, middle - _NEIGHBOURS), middle), slice(middle, middle + _NEIGHBOURS)
    sides = [s for s in (before, after) if len(readings.lively[s]) >= _NEIGHBOURS // 2]
    at_start = len(readings.lively[before]) < _NEIGHBOURS // 2
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
        # Without a command, an amplifier may deliver exactly zero.
        return float(np.ptp(readings.command[first : last + 1])) > _JUMP * noise
    if readings.channel not in ON_HUB and not at_start:
        return True
    # The wiper of a potentiometer may be noisy in motion only.
    return readings.noisy_at_rest() or _jumps(readings, last, noise)


def _step(values: np.ndarray, least: float) -> float:
    """Step of the converter among these readings (n), at least `least`: large values may have fewer decimals."""
    levels = np.unique(values)
    return max(least, float(np.diff(levels).min())) if len(levels) > 1 else least


def _moves_around(readings: _Readings, first: int, last: int) -> bool:
    """Whether a channel moves steadily right before and right after a run of equal readings, and jumps at its end."""
    if readings.channel == "motor_torque" or first < 4 or last + 6 > len(readings.values):
        return False
    before = np.diff(readings.values[first - 4 : first + 1])
    after = np.diff(readings.values[last + 1 : last + 6])
    steady = (_steady(before, readings.step), _steady(after, readings.step))
    return all(steady) and _jumps(readings, last, readings.declared)


def _steady(steps: np.ndarray, least: float) -> bool:
    """Whether changes (n) have one sign and similar sizes, all above 1.5 times `least`."""
    sizes = np.abs(steps)
    one_way = abs(np.sign(steps).sum()) == len(steps)
    return bool(one_way and sizes.min() > 1.5 * least and sizes.max() < 3 * sizes.min())


def _jumps(readings: _Readings, last: int, noise: float) -> bool:
    """Whether the change after reading `last` is large, and abrupt compared with those that follow."""
    after = np.abs(np.diff(readings.values[last : last + 6]))
    if len(after) < 5:
        return False
    return bool(after[0] > _JUMP * max(noise, readings.step) and after[0] > _ABRUPT * after[1:].max())


# Saturated converters


def _saturated(readings: _Readings) -> tuple[np.ndarray, str]:
    """Mask (n) of readings that accumulate at exactly the largest or smallest value, and a note on them."""
    values = readings.values
    bad = np.zeros(len(values), dtype=bool)
    plateaus: list[tuple[int, int]] = []
    levels: list[str] = []
    if readings.channel == "motor_torque":
        return bad, ""  # a torque may truly rest at its limit, and at 0
    # Once one side is known to saturate, weaker evidence suffices on the other: so the first side is tried again.
    for sign in (1.0, -1.0, 1.0):
        for level in np.unique(sign * values)[::-1][: _BEYOND + 1]:
            runs = [(a, b) for a, b in _equal_runs(values) if sign * values[a] == level]
            new = not bad[sign * values == level].any()
            beyond = np.count_nonzero(sign * values > level)
            if new and beyond <= _BEYOND and _piled_up(readings, runs, sign, bool(levels)):
                bad |= sign * values == level
                plateaus += runs
                levels.append(_with_unit(readings, sign * level))
                break
    when = _time_text(readings, sorted(plateaus))
    return bad, f"is saturated at {' and '.join(levels)} {when}; left out there"


def _piled_up(readings: _Readings, runs: Sequence[tuple[int, int]], sign: float, other: bool) -> bool:
    """Whether equal readings at an extreme are too many for chance.

    Args:
      readings: of the channel.
      runs: first and last index of each run of equal readings at the extreme.
      sign: 1 at the largest value, -1 at the smallest.
      other: whether the channel is known to saturate at the other extreme.
    """
    # A run at the start may be a rest before the first motion.
    flat = [(a, b) for a, b in runs if b - a + 1 >= _TOP and a > 0]
    pairs = sum(b - a for a, b in runs if a > 0)
    # A hub may rest at its extreme once.
    fewest = 2 if readings.channel in ON_HUB else 1
    if len(flat) < fewest or pairs < (_TOP - 1 if other else _PILE):
        return False
    noise = 1.4826 * float(np.median(readings.noise, axis=1).min())
    outer = sign * readings.values >= np.quantile(sign * readings.values, 0.8)
    if noise >= _step(readings.values[outer], readings.step):
        if readings.channel in ON_HUB and not readings.noisy_at_rest():
            return False
        elsewhere = readings.values != readings.values[runs[0][0]]
        equal = (np.diff(readings.values) == 0)[elsewhere[:-1]]
        chance = readings.chance(noise, equal) ** pairs
        return bool(len(readings.values) * chance < (_SECOND_CHANCE if other else _CHANCE))
    if readings.channel in ON_HUB:
        return False  # it may rest at its extreme
    # A coarse converter flattens true peaks too, but not where the channel arrives and leaves at full speed.
    if np.ptp(readings.values) < _COARSE_RANGE * readings.step:
        return False
    return sum(_cut_off(sign * readings.values, a, b, 6 * readings.step) for a, b in flat) >= _TOP


def _cut_off(values: np.ndarray, first: int, last: int, least: float) -> bool:
    """Whether values rise to a plateau and fall from it by more than `least` per sample."""
    if first < 3 or last + 4 > len(values):
        return False
    rise, fall = np.diff(values[first - 3 : first]), -np.diff(values[last + 1 : last + 4])
    return bool(min(rise[-1], fall[0]) > least and min(rise[0], fall[-1]) > least / 2)


# Bad segments


def _noisy(readings: _Readings) -> tuple[np.ndarray, str]:
    """Mask (n) of readings in segments with many times the channel's usual noise, and a note on them."""
    period = sample_period(readings.time)
    window = 2 * max(_NEIGHBOURS, round(_NOISY_SPAN / period)) // 2 + 1
    none = np.zeros(len(readings.values), dtype=bool), ""
    if len(readings.lively) < 4 * window:
        return none
    # Early exit, for most channels: noise of non-overlapping half windows.
    halves = len(readings.lively) // (window // 2)
    blocks = readings.noise[:, : halves * (window // 2)].reshape(-1, halves, window // 2)
    level = 1.4826 * np.median(blocks, axis=2).min(axis=0)
    least = max(readings.declared, readings.step / np.sqrt(12), float(np.median(level)))
    if level.max() < _NOISY * least / 2:
        return none
    level = _noise_levels(readings.noise, window)
    usual = np.maximum(np.median(level), max(readings.declared, readings.step / np.sqrt(12)))
    limit = np.full(len(level), _NOISY * usual)
    if readings.channel == "motor_torque":
        # A torque follows its command, including the noise that a controller feeds back.
        commanded = np.abs(_differences(readings.time[readings.lively], readings.command[readings.lively]))
        limit = np.maximum(limit, _NOISY * _noise_levels(commanded, window))
    stretches, count = label(level > limit / 2)
    signed = _difference(np.arange(len(readings.lively), dtype=float), readings.values[readings.lively], 4)
    bad, segments, times = none[0].copy(), [], []
    for number in range(1, count + 1):
        inside = np.flatnonzero(stretches == number)
        coarse = _NOISY * _step(readings.values[readings.lively[inside]], readings.step) / np.sqrt(12)
        if (
            np.count_nonzero((level > limit)[inside]) < window * 3 // 4
            or np.median(level[inside]) < coarse
            or _is_vibration(signed[inside])
        ):
            continue
        # Single large differences within half a window of its ends locate the segment's first and last reading.
        near = slice(max(0, inside[0] - window // 2), inside[-1] + window // 2 + 1)
        strong = near.start + np.flatnonzero(np.abs(signed[near]) > 4 * usual)
        first, last = int(readings.lively[strong[0]]), int(readings.lively[strong[-1]])
        bad[first : last + 1] = True
        segments.append((first, last))
        times.append(float(np.median(level[inside])) / usual)
    if not segments or bad.sum() > _NOISY_SHARE * len(bad):
        return none
    return bad, f"has {max(times):.0f} times its usual noise {_time_text(readings, segments)}; left out there"


def _noise_levels(sizes: np.ndarray, window: int) -> np.ndarray:
    """Local noise (m) from absolute differences (k, m): scaled moving median, the smallest of the k estimates."""
    return 1.4826 * median_filter(sizes, (1, window), mode="nearest").min(axis=0)


def _is_vibration(differences: np.ndarray) -> bool:
    """Whether differences of order 4 (n) are correlated beyond their order: of vibration, not of white noise."""
    centred = np.clip(differences, *np.quantile(differences, (0.02, 0.98)))
    lags = range(_ORDERS[0] + 1, min(4 * _ORDERS[0] + 9, len(centred) // 2))
    power = float(centred @ centred)
    return any(abs(float(centred[lag:] @ centred[:-lag])) > _VIBRATES * power for lag in lags)


# Missing rows and readings


def _missing_notes(recording: Recording) -> list[str]:
    """Returns a note on missing rows and readings, if there are any."""
    rows = _rows_missing(recording.time)
    empty = {c: int(np.count_nonzero(np.isnan(recording[c]))) for c in recording.measured()}
    counts = [(rows, "rows"), *((n, f"readings of {c}") for c, n in empty.items() if n < len(recording))]
    parts = [f"{n} {what}" for n, what in counts if n]
    return [f"{recording.name}: {', '.join(parts)} are missing"] if parts else []


def _rows_missing(time: np.ndarray) -> int:
    """Number of ticks of a uniform clock without a row; 0 where the time stamps follow no clock."""
    if len(time) < _FEWEST:
        return 0
    ticks = sample_clock(time)
    steps = np.diff(time if ticks is None else ticks)
    steps = steps / np.median(steps)
    on_clock = np.abs(steps - np.round(steps)) < 0.1
    return int(np.sum(np.round(steps) - 1)) if on_clock.mean() > 0.98 else 0


# Texts


def _with_unit(readings: _Readings, value: float) -> str:
    unit = CHANNEL_UNITS[readings.channel]
    return f"{value:g}{'' if unit == '1' else f' {unit}'}"


def _time_text(readings: _Readings, stretches: Sequence[tuple[int, int]]) -> str:
    """Times of stretches: of each, or of the first to the last where there are more than `_LISTED`."""
    if len(stretches) > _LISTED:
        first, last = readings.time[stretches[0][0]], readings.time[stretches[-1][1]]
        return f"in {len(stretches)} stretches from {first:.2f} to {last:.2f} s"
    spans = [f"from {readings.time[a]:.2f} to {readings.time[b]:.2f} s" for a, b in stretches]
    return " and ".join(spans)
