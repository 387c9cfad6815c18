"""Measured motion of an axis: the record, its instruments, and its integration."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armsim.arm.parameters import AxisParameters
from armsim.arm.simulate import Schedule
from armsim.checks import checked_number, reals

#: Columns of a record, in the order of `Measurement`, with the unit of each.
COLUMNS = dict(time="s", set_velocity="V", position="m", velocity="m/s", acceleration="m/s^2")
#: Smallest number of samples in a record: 60 values for about 7 unknowns.
MIN_SAMPLES = 20
#: A signal is clear above so many standard deviations, and sums differ from their signal by less
#: than this factor.
_CLEAR, _FACTOR = 10.0, 30.0
#: Largest deviation of a sampling interval as a share of the median; allows for rounded times.
_UNEVEN = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Measurement:
    """Recorded motion of one axis from rest, evenly sampled.

    Parameters
    ----------
    t : (n,) array_like
        Times of the samples in s.
    set_velocity : (n,) array_like
        Set velocity in V from each sample on. It is a digital output and therefore exact.
    position, velocity : (n,) array_like
        Arm motion inferred from the motor shaft: r_g y2 in m from an encoder, r_g y3 in m/s from
        the tachometer.
    acceleration : (n,) array_like
        Accelerometer on the arm, m/s², with an integrating converter: the mean of the derivative
        of y1 since the previous sample.

    Raises
    ------
    ValueError
        If the columns differ in length or a sample is invalid; the message names the sample.
    """

    t: np.ndarray
    set_velocity: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def __post_init__(self) -> None:
        columns = {name: reals(name, values) for name, values in vars(self).items()}
        shapes = {column.shape for column in columns.values()}
        if shapes != {(columns["t"].size,)}:
            raise ValueError(f"the five columns have shapes {shapes}; five rows (n,) are needed")
        vars(self).update(columns)
        for sample, text in faults(np.array([*columns.values()])):
            raise ValueError(text if sample is None else f"sample {sample}: {text}")

    def __repr__(self) -> str:
        return f"<Measurement of {self.t.size} samples from t = {self.t[0]:g} to {self.t[-1]:g}>"

    @property
    def elapsed(self) -> np.ndarray:
        """Times (n,) in s since the first sample."""
        return self.t - self.t[0]

    @property
    def schedule(self) -> Schedule:
        """Set velocity for `armsim.arm.simulate`, with times as in `elapsed`."""
        change = np.flatnonzero(np.diff(self.set_velocity, prepend=np.nan) != 0)
        times, volts = self.elapsed[change].tolist(), self.set_velocity[change].tolist()
        return tuple(zip(times, volts, strict=True))

    @property
    def signals(self) -> np.ndarray:
        """Position, velocity and acceleration, (3, n)."""
        return np.array([self.position, self.velocity, self.acceleration])


@dataclass(frozen=True, kw_only=True)
class Instrument:
    """Standard deviations of the noise in each signal, including quantisation.

    Parameters
    ----------
    position, velocity, acceleration : float
        Standard deviations in m, m/s and m/s², positive.

    Raises
    ------
    TypeError, ValueError
        If a value is not a finite positive number.
    """

    position: float
    velocity: float
    acceleration: float

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            object.__setattr__(self, name, checked_number(name, value, above=0.0))

    @property
    def deviations(self) -> np.ndarray:
        """The three standard deviations as a column, (3, 1)."""
        return np.array([[self.position], [self.velocity], [self.acceleration]])


def signals(y: np.ndarray, t: np.ndarray, p: AxisParameters) -> np.ndarray:
    """Signals of ideal instruments for a simulated motion.

    Parameters
    ----------
    y : (..., 7, n) array
        States at the samples; the first is at rest.
    t : (n,) array
        Times of the samples in s.
    p : AxisParameters
        Parameters of the axis.

    Returns
    -------
    (..., 3, n) array
        Position in m, velocity in m/s and acceleration in m/s². The acceleration is the exact mean
        over each interval, a difference of two velocities; the first is zero.
    """
    v = y[..., 1, :]
    mean = np.diff(v, prepend=v[..., :1]) / np.diff(t, prepend=2 * t[0] - t[1])
    return np.stack([p.r_g * y[..., 2, :], p.r_g * y[..., 3, :], mean], axis=-2)


def integrated(record: Measurement, rest: float) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the accelerometer to velocity and position, from rest to rest.

    Bias and drift are fitted where the velocity must be zero and subtracted from the whole record.

    Parameters
    ----------
    record : Measurement
        The record. Its acceleration is the mean over each interval, so sums of it give the velocity
        exactly.
    rest : float
        Time in s, as in `Measurement.elapsed`, after which the arm is at rest.

    Returns
    -------
    velocity, position : (n,) arrays
        In m/s and m. The position starts at zero and is integrated by the trapezoidal rule.
    """
    t = record.elapsed
    h = np.diff(t, prepend=2 * t[0] - t[1])
    raw = np.cumsum(record.acceleration * h)
    drifting = np.column_stack([t, t**2 / 2])
    still = t >= rest
    velocity = raw - drifting @ np.linalg.lstsq(drifting[still], raw[still], rcond=None)[0]
    return velocity, np.cumsum((velocity - 0.5 * np.diff(velocity, prepend=0.0)) * h)


def implausible(record: Measurement, axis: AxisParameters, noise: Instrument) -> Iterator[str]:
    """Yield why no constants near those of the axis can explain the record."""
    rows, errors, names = record.signals, noise.deviations.ravel(), [*COLUMNS][2:]
    top, seen = axis.r_g * axis.V_M / axis.K_b, np.abs(rows[1]).max()
    if seen > 5 * top + _CLEAR * errors[1]:
        yield f"velocity up to {seen:.3g} m/s; the limit V_M allows {top:.3g} m/s: check the units"
    if (np.abs(rows[:2, 0]) > _CLEAR * errors[:2]).any():
        yield f"begins at {rows[0, 0]:.4g} m, {rows[1, 0]:.4g} m/s; has to begin at rest, at 0 m"
    h, n = record.elapsed[1], record.t.size
    # An offset and a drift of an instrument add a parabola to a sum.
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, n), 3))
    # Between samples the velocity may be another; the acceleration is a mean.
    for k, aliased in enumerate((0.05 * seen, 0.0)):
        curves = np.array([rows[k], np.cumsum(rows[k + 1]) * h])
        sizes = np.linalg.norm(curves - curves @ basis @ basis.T, axis=1) / np.sqrt(n)
        unsure = errors[k], (errors[k + 1] + aliased) * h * np.sqrt(n)
        # The motor may move in the backlash, or in a soft gear, while the arm stands still.
        large = np.argmax(sizes) if k == 0 else 1
        if sizes[large] > max(_CLEAR * unsure[large], _FACTOR * sizes.min()):
            vary = f"{names[k]} varies by {sizes[0]:.3g}, summed {names[k + 1]} by {sizes[1]:.3g}"
            yield f"{vary} {COLUMNS[names[k]]}: check the units of both and of time"


def faults(columns: np.ndarray) -> Iterator[tuple[int | None, str]]:
    """Yield the faults of the five columns (5, n): the sample concerned, if any, and a message."""
    for n, name in np.argwhere(~np.isfinite(columns.T)):
        yield int(n), f"{list(COLUMNS)[name]} = {columns[name, n]} is not finite"
    t = columns[0]
    if t.size < MIN_SAMPLES:
        yield None, f"{t.size} samples; at least {MIN_SAMPLES} are needed"
    step = np.diff(t)
    for n in np.flatnonzero(step <= 0):
        what = "appears twice" if step[n] == 0 else f"comes after {t[n]}: it has to rise"
        yield int(n) + 1, f"time = {t[n + 1]} {what}"
    interval = np.median(step)
    for n in np.flatnonzero(np.abs(step - interval) > _UNEVEN * interval):
        others = f"the others are {interval:.6g} s apart, and the sampling has to be even"
        yield int(n) + 1, f"time = {t[n + 1]} is {step[n]:.6g} s after the sample before; {others}"
