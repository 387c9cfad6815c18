"""Numbers read off a step response: settling time, ringing."""

import numpy as np


def settling_time(t: np.ndarray, signal: np.ndarray, final: float, band: float) -> float:
    """Time after which a signal stays within a band around its final value.

    Parameters
    ----------
    t, signal : (n,) arrays
        Times and values; between them the signal is taken as linear.
    final, band : float
        Final value and half-width of the band.

    Returns
    -------
    float
        ``t[0]`` if the signal never leaves the band, NaN if it is still outside at the end.
    """
    excess = np.abs(np.asarray(signal) - final) - band
    outside = np.flatnonzero(excess > 0)
    if outside.size == 0:
        return float(t[0])
    last = int(outside[-1])
    if last == len(t) - 1:
        return float("nan")
    inside = excess[last] / (excess[last] - excess[last + 1])
    return float(t[last] + inside * (t[last + 1] - t[last]))


def ringing(t: np.ndarray, signal: np.ndarray) -> tuple[float, float]:
    """Frequency and decay rate of a damped oscillation.

    Both are least-squares fits through the extrema, whose places are refined by parabolas. The
    amplitude is the difference between one extremum and the next, which needs no mean value.

    Parameters
    ----------
    t, signal : (n,) arrays
        Equally spaced times and the signal, with at least three extrema between them.

    Returns
    -------
    frequency : float
        In hertz if `t` is in seconds.
    decay_rate : float
        The rate r of exp(-r t), in 1/s.

    Raises
    ------
    ValueError
        If there are fewer than three extrema.
    """
    t, signal = np.asarray(t, dtype=float), np.asarray(signal, dtype=float)
    slope = np.diff(signal)
    top = np.flatnonzero(slope[:-1] * slope[1:] < 0) + 1
    if top.size < 3:
        raise ValueError(f"the signal has {top.size} extrema; at least 3 are needed")
    left, middle, right = signal[top - 1], signal[top], signal[top + 1]
    shift = (left - right) / (2 * (left - 2 * middle + right))
    times = t[top] + shift * (t[1] - t[0])
    values = middle - shift * (left - right) / 4
    amplitudes = np.abs(np.diff(values))
    half_period = np.polyfit(np.arange(times.size), times, 1)[0]
    decay_rate = -np.polyfit(times[:-1], np.log(amplitudes), 1)[0]
    return float(1 / (2 * half_period)), float(decay_rate)
