"""Numbers read off a step response: settling time, ringing."""

from typing import NamedTuple

import numpy as np

from armsim.arm.parameters import AxisParameters
from armsim.arm.simulate import Trajectory, simulate

#: Share of the final velocity within which it counts as settled.
SETTLED = 0.02
#: Switching events in a second beyond which the loop is taken to be unstable.
BUZZING = 200


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


def loop_ringing(run: Trajectory) -> tuple[float, float]:
    """Ringing of the arm's velocity after the last event of an exact run.

    Parameters
    ----------
    run : Trajectory
        With 0.63 s after its last event: 0.03 s in which the fast modes die, and 0.6 s to look at.

    Returns
    -------
    frequency, decay_rate : float
        As `ringing` gives them.

    Raises
    ------
    ValueError
        If the run ends too early, or there are fewer than three extrema.
    """
    begin = (run.events[-1].time if run.events else 0.0) + 0.03
    times = np.linspace(begin, begin + 0.6, 6001)
    return ringing(times, run(times)[1])


class StepQuality(NamedTuple):
    """How the arm's velocity answers a step of the set velocity."""

    settling: float  #: s, NaN if it does not settle
    overshoot: float  #: as a share of the final velocity
    frequency: float  #: Hz, of the ringing; NaN if there is none
    decay: float  #: 1/s, of the ringing; NaN if there is none


def step_quality(p: AxisParameters, volts: float = 10.0, t_end: float = 6.0) -> StepQuality:
    """Run a step of the set velocity and read off its quality.

    A loop that buzzes between its limits, with more than `BUZZING` events in the first second, is
    watched for that second only.

    Parameters
    ----------
    p : AxisParameters
        With the gain K_1 that makes 10 V stand for 1 m/s.
    volts : float
        Height of the step.
    t_end : float
        Length of the run in s.
    """
    run, final, length = simulate(p, volts, min(t_end, 1.0)), 0.1 * volts, min(t_end, 1.0)
    if len(run.events) <= BUZZING:
        run, length = simulate(p, volts, t_end), t_end
    t = np.linspace(0, length, 4001)
    velocity = run(t)[1]
    try:
        frequency, decay = loop_ringing(run)
    except ValueError:
        frequency = decay = float("nan")
    settling = settling_time(t, velocity, final, SETTLED * abs(final))
    return StepQuality(settling, float((velocity / final).max() - 1), frequency, decay)
