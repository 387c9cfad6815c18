"""Characteristics of a run or of a scan of runs: settling time, ringing, crossings.

A characteristic is NaN if the run does not have it: it never arrives, never settles, or does not
ring. A missing value must not be mistaken for zero.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import nan
from typing import NamedTuple

import numpy as np

from armsim.arm.dynamics import Region
from armsim.arm.parameters import AxisParameters
from armsim.arm.simulate import Trajectory, simulate
from armsim.checks import reals

#: Region of the rise: preamplifier at its upper limit, teeth engaged.
HELD = Region(preamplifier=1, power=0, contact=1, friction=0)
#: Half-width of the settling band as a share of the final velocity.
SETTLED = 0.02
#: Largest number of switching events in a second of a loop that is taken as stable.
BUZZING = 200


def _curve(t: object, signal: object, level: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and values above a level, as two rows of the same length; or a ValueError."""
    curve = reals("t", t), reals("signal", signal) - level
    first, second = (part.shape for part in curve)
    if first != second or len(first) != 1 or first == (0,):
        raise ValueError(f"t, signal have shapes {first}, {second}; two rows (n,) are needed")
    return curve


def settling_time(t: np.ndarray, signal: np.ndarray, final: float, band: float) -> float:
    """Time after which a signal stays within a band around its final value.

    Parameters
    ----------
    t, signal : (n,) arrays
        Times and values; the signal is interpolated linearly.
    final, band : float
        Final value and half-width of the band.

    Returns
    -------
    float
        ``t[0]`` if the signal never leaves the band, NaN if it is outside at the end or is NaN.
    """
    t, away = _curve(t, signal, final)
    excess = np.abs(away) - band
    outside = np.flatnonzero(~(excess <= 0))  # a NaN is not inside
    return _zero_after(outside[-1] if outside.size else -1, t, excess)


def arrival_time(t: np.ndarray, signal: np.ndarray, level: float) -> float:
    """Time at which a signal first reaches a level, from below or from above.

    Parameters
    ----------
    t, signal : (n,) arrays
        Times and values; the signal is interpolated linearly.
    level : float
        The level.

    Returns
    -------
    float
        ``t[0]`` if the signal starts at the level, NaN if it never reaches it.
    """
    t, left = _curve(t, signal, level)
    reached = np.flatnonzero(left * np.sign(left[0]) <= 0)
    return _zero_after(reached[0] - 1 if reached.size else t.size - 1, t, left)


def _zero_after(n: int, t: np.ndarray, values: np.ndarray) -> float:
    """Time of the zero after sample n; the first time if n is -1, NaN after the last sample."""
    if n < 0:
        return float(t[0])
    if n == t.size - 1:
        return nan
    share = values[n] / (values[n] - values[n + 1])
    return float(t[n] + share * (t[n + 1] - t[n]))


def overshoot(signal: np.ndarray, final: float, band: float) -> float:
    """Share of the final value by which a signal (n,) passes it.

    Zero if the signal comes into the band around the final value and never passes the value; NaN if
    it never comes into the band.
    """
    share = np.asarray(signal) / final - 1
    return max(0.0, float(share.max())) if (share >= -band / abs(final)).any() else nan


def time_within(run: Trajectory, inside: Callable[[Region], bool], t_end: float) -> float:
    """Time in s that an exact run spends in certain regions.

    Parameters
    ----------
    run : Trajectory
        Exact run.
    inside : callable
        Returns whether a region counts.
    t_end : float
        Only the time before `t_end` counts. If it is NaN, so is the result.
    """
    cuts = np.minimum([0.0, *(event.time for event in run.events), t_end], t_end)
    regions = [*run.regions(run.t[:1]), *(event.after for event in run.events)]
    return float(np.diff(cuts) @ [bool(inside(where)) for where in regions])


def pulling(run: Trajectory, interval: float = 1e-6) -> tuple[float, float]:
    """Return by how much the teeth of an exact run pull, in N, and for what share of their contact.

    The damper of the paper's eq. (14) makes the gear force negative for a moment before teeth part.
    Both are 0 if the teeth only push, and NaN if they are never in contact.

    Parameters
    ----------
    run : Trajectory
        Exact run.
    interval : float
        Interval in s at which the force is sampled.
    """
    p, t = run.parameters, np.arange(0.0, run.t_end, interval)
    y, force = run(t), run.auxiliary(t)["f_g"]
    x = p.r_g * y[2] - y[0]
    contact = np.sign(x) * (np.abs(x) > p.H)
    pull = np.maximum(0.0, -contact * force)[contact != 0]
    return (float(pull.max()), float((pull > 0).mean())) if pull.size else (nan, nan)


def rise_rate(run: Callable[[np.ndarray], np.ndarray], begin: float, end: float) -> float:
    """Rate r in 1/s of the curve a - b exp(-r t) fitted to the arm velocity by least squares.

    Parameters
    ----------
    run : Trajectory
        Any callable that returns states (7, n) at n times.
    begin, end : float
        First and last time of the fit.

    Returns
    -------
    float
        NaN if `begin` is not before `end`, the velocity is constant, or the fit does not converge.
    """
    from scipy.optimize import curve_fit  # slow to import

    if not begin < end:
        return nan
    t = np.linspace(begin, end, 2001)
    velocity = run(t)[1]
    if np.ptp(velocity) <= 1e-12 * np.abs(velocity).max():
        return nan
    try:
        found, _ = curve_fit(lambda t, a, b, r: a - b * np.exp(-r * t), t, velocity, [1, 1, 1])
    except RuntimeError:
        return nan
    return float(found[2])


def rise(run: Trajectory) -> float:
    """Rate in 1/s of the rise after a step of the set velocity: `rise_rate` from 0.1 s on.

    The fit ends at nine tenths of the time at which the arm first has the set velocity. The result
    is NaN if the arm never has it, or too early for a fit.
    """
    t, goal = np.linspace(0, run.t_end, 20_001), 0.1 * float(run.set_velocity(0.0))
    return rise_rate(run, 0.1, 0.9 * arrival_time(t, run(t)[1], goal))


def initial_slope(run: Callable[[np.ndarray], np.ndarray]) -> float:
    """Slope in m/s² of a straight line fitted to the arm velocity in the first 0.1 s."""
    t = np.linspace(0.0, 0.1, 1001)
    return float(np.polyfit(t, run(t)[1], 1)[0])


def nearest(
    function: Callable[[float], float], grid: Sequence[float] | np.ndarray, target: float
) -> tuple[list[float], bool]:
    """Arguments at which a function comes closest to a target, the closest one first.

    Parameters
    ----------
    function, grid, target
        As for `crossings`.

    Returns
    -------
    arguments : list of float
        All roots; if there is none, the two sides of each jump; empty without either.
    met : bool
        Whether they are roots.
    """
    roots, jumps = crossings(function, grid, target)
    near = roots or [jump + side for jump in jumps for side in (-1e-9, 1e-9)]
    return sorted(near, key=lambda x: abs(function(x) - target)), bool(roots)


def crossings(
    function: Callable[[float], float], grid: Sequence[float] | np.ndarray, target: float = 0.0
) -> tuple[list[float], list[float]]:
    """Arguments at which a function crosses a target, searched for between the points of a grid.

    Parameters
    ----------
    function : callable
        It may jump, and may be NaN. Intervals with a NaN at an end are not searched.
    grid : (n,) array_like
        Increasing arguments. Two crossings in one interval are not found.
    target : float
        Function value at a crossing.

    Returns
    -------
    roots : list of float
        Where the function has the target as its value.
    jumps : list of float
        Where it jumps across the target: the function has no root there.
    """
    from scipy.optimize import brentq  # slow to import

    def excess(x: float) -> float:
        return function(x) - target

    roots, jumps = list[float](), list[float]()
    for left, right in pairwise(map(float, grid)):
        ends = excess(left), excess(right)
        if not np.isfinite(ends).all() or (ends[0] > 0) == (ends[1] > 0):
            continue
        root = float(brentq(excess, left, right, xtol=1e-12, rtol=1e-14))
        near = max(1e-9 * (right - left), 4e-12)  # a continuous function hardly changes over it
        step = excess(min(root + near, right)) - excess(max(root - near, left))
        (jumps if abs(step) > 1e-3 * abs(ends[1] - ends[0]) else roots).append(root)
    return roots, jumps


def ringing(t: np.ndarray, signal: np.ndarray) -> tuple[float, float]:
    """Frequency and decay rate of a damped oscillation.

    Both are least-squares fits to the extrema, which are refined by parabolas. The amplitude is the
    difference between successive extrema, so no mean value is needed.

    Parameters
    ----------
    t, signal : (n,) arrays
        Equally spaced times and the signal.

    Returns
    -------
    frequency : float
        In hertz if `t` is in seconds.
    decay_rate : float
        The rate r of exp(-r t), in 1/s.

    Both are NaN if the signal has fewer than three extrema that stand out from rounding errors.
    """
    t, signal = _curve(t, signal)
    slope = np.diff(signal)
    moving = np.flatnonzero(slope)  # two equal samples can be a top
    top = moving[:-1][slope[moving[:-1]] * slope[moving[1:]] < 0] + 1
    left, middle, right = signal[top - 1], signal[top], signal[top + 1]
    shift = (left - right) / (2 * ((left - middle) + (right - middle)))  # never 0 at a top
    times = t[top] + shift * (t[1] - t[0])
    values = middle - shift * (left - right) / 4
    amplitudes = np.abs(np.diff(values))
    rounding = amplitudes <= 1e-12 * np.abs(signal).max(initial=0.0)
    last = int(np.argmax(rounding)) if rounding.any() else amplitudes.size
    if last < 2:
        return nan, nan
    times, amplitudes = times[: last + 1], amplitudes[:last]
    half_period = np.polyfit(np.arange(times.size), times, 1)[0]
    decay_rate = -np.polyfit(times[:-1], np.log(amplitudes), 1)[0]
    return float(1 / (2 * half_period)), float(decay_rate)


def loop_ringing(run: Trajectory) -> tuple[float, float]:
    """Ringing of the arm velocity after the last event of an exact run.

    Parameters
    ----------
    run : Trajectory
        Exact run. The first 0.03 s after the last event are skipped, so that the fast modes decay;
        the next 0.6 s are evaluated.

    Returns
    -------
    frequency, decay_rate : float
        See `ringing`; NaN if the run ends too early.
    """
    begin = (run.events[-1].time if run.events else 0.0) + 0.03
    if begin + 0.6 > run.t[-1]:
        return nan, nan
    times = np.linspace(begin, begin + 0.6, 6001)
    return ringing(times, run(times)[1])


def gear_ringing(run: Trajectory) -> tuple[float, float]:
    """Ringing of the gear force from 0.01 s to 0.08 s, while the preamplifier is at its limit.

    The mean force falls slowly as the arm gains speed; `ringing`, which uses differences of
    extrema, allows for that.

    Returns
    -------
    frequency, decay_rate : float
        See `ringing`; NaN if the run leaves the region `HELD` in that time.
    """
    times = np.linspace(0.01, 0.08, 7001)
    if set(run.regions(times)) != {HELD}:
        return nan, nan
    return ringing(times, run.auxiliary(times)["f_g"])


class StepQuality(NamedTuple):
    """Quality of the arm velocity after a step of the set velocity."""

    settling: float  #: s, NaN if it does not settle
    overshoot: float  #: as a share of the final velocity; NaN if it never arrives
    frequency: float  #: Hz, of the ringing; NaN if there is none
    decay: float  #: 1/s, of the ringing; NaN if there is none


def step_quality(p: AxisParameters, volts: float = 10.0, t_end: float = 6.0) -> StepQuality:
    """Simulate a step of the set velocity and evaluate its quality.

    A loop that chatters between its limits, with more than `BUZZING` events in the first second, is
    simulated for that second only.

    Parameters
    ----------
    p : AxisParameters
        The axis, with the gain K_1 for which 10 V gives 1 m/s.
    volts : float
        Height of the step.
    t_end : float
        Length of the run in s.
    """
    run, final = simulate(p, volts, min(t_end, 1.0)), 0.1 * volts
    if len(run.events) <= BUZZING:
        run = simulate(p, volts, t_end)
    t, band = np.linspace(0, run.t_end, 4001), SETTLED * abs(final)
    velocity = run(t)[1]
    settling = settling_time(t, velocity, final, band)
    return StepQuality(settling, overshoot(velocity, final, band), *loop_ringing(run))
