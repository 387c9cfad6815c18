"""Slave control unit: set velocity from track data, paper's Section 3.2 and Figure 2.

The master sends a position and a speed every 80 ms. Every 5 ms the unit reads the encoder on the
motor shaft and outputs a voltage that is held until the next sample. The paper states only that the
law combines position, velocity and integrated position. The law below, its gains, the encoder
resolution and the shape of the move are our choice.
"""

# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numba import njit

from armsim.checks import checked_count, checked_number, checked_type, reals
from armsim.choices import CHOICES

_MOVE, _CONTROL = CHOICES["move"], CHOICES["control"]

#: Constants of a unit for compiled code; `angle` is in rad per count, 0 for an ideal encoder.
Law = namedtuple("Law", "K_p K_I K_v delay angle period limit volts_per_speed")


@dataclass(frozen=True, repr=False)
class Track:
    """Track data: positions and speeds that the master sends at equal intervals.

    Between two track points the motion is their cubic Hermite interpolant. After the last one the
    arm should remain at rest.

    Parameters
    ----------
    position : tuple of float
        Positions in m at 0, `period`, 2 `period`, …
    speed : tuple of float
        Speeds in m/s at the same times; the last one is zero.
    period : float
        Interval between track points in s; 80 ms in the paper.

    Raises
    ------
    ValueError
        If there are fewer than two points, positions and speeds differ in number, a value is not
        finite, the last speed is not zero, or the period is not positive.
    """

    position: tuple[float, ...]
    speed: tuple[float, ...]
    period: float = 0.08

    def __post_init__(self) -> None:
        object.__setattr__(self, "period", checked_number("period", self.period, above=0.0))
        for name in ("position", "speed"):
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        if not 2 <= len(self.position) == len(self.speed):
            found = f"track of {len(self.position)} positions and {len(self.speed)} speeds"
            raise ValueError(f"{found}: as many of both are needed, and at least two")
        if not np.isfinite([self.position, self.speed]).all():
            raise ValueError("track: every position and speed must be finite")
        if self.speed[-1] != 0.0:
            raise ValueError(f"track ends with the speed {self.speed[-1]} m/s; it must be 0")

    def __repr__(self) -> str:
        return f"<Track of {len(self.position)} points, {self.period:g} s apart>"

    @classmethod
    def trapezoid(
        cls,
        distance: float = _MOVE["distance"],
        velocity: float = _MOVE["velocity"],
        acceleration: float = _MOVE["acceleration"],
        period: float = 0.08,
    ) -> Self:
        """Sample a move with a trapezoidal velocity profile.

        Parameters
        ----------
        distance : float
            Distance of the move in m; negative for a backward move.
        velocity, acceleration : float
            Maximum values in m/s and m/s²; a short move does not reach the velocity.
        period : float
            Interval between track points in s.
        """
        sizes = {"velocity": velocity, "acceleration": acceleration, "period": period}
        velocity, acceleration, period = (checked_number(*s, above=0.0) for s in sizes.items())
        distance = checked_number("distance", distance)
        length = abs(distance)
        top = min(velocity, math.sqrt(acceleration * length))
        rise = top / acceleration
        end = rise + (length / top if top > 0.0 else 0.0)
        t = period * np.arange(math.ceil(end / period - 1e-9) + 2)
        left = np.clip(end - t, 0.0, None)
        sections = left < rise, t < rise  # falling, rising; in between the speed is `top`
        speed = np.select(sections, (acceleration * left, acceleration * t), top)
        falling, rising = length - 0.5 * acceleration * left**2, 0.5 * acceleration * t**2
        position = np.select(sections, (falling, rising), top * (t - 0.5 * rise))
        sign = math.copysign(1.0, distance)
        return cls(tuple(sign * position), tuple(sign * speed), period)

    @property
    def duration(self) -> float:
        """Time in s after which the arm should remain at rest."""
        return self.period * (len(self.position) - 1)

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicHermiteSpline  # slow to import and rarely needed

        times = self.period * np.arange(len(self.position))
        return CubicHermiteSpline(times, self.position, self.speed)

    def __call__(self, t: np.ndarray | float) -> np.ndarray:
        """Position in m and speed in m/s (2, …) at the times `t` (…) in s."""
        inside = np.clip(reals("t", t), 0.0, self.duration)
        return np.array([self._spline(inside), self._spline(inside, 1)])


@dataclass(frozen=True, kw_only=True)
class SlaveControl:
    """Slave control unit of one axis: a sampled control law whose output is held.

    With the encoder position x̂, its difference quotient v̂ over one sample, the track position x
    and speed v, and e = x - x̂, the output at each sample is

        U = clip((v + K_p e + K_I ∫e dt + K_v (v - v̂)) · volts_per_speed, ±limit).

    The integral is frozen while the output is at its limit and e would drive it further.

    Parameters
    ----------
    track : Track
        Position and speed to follow.
    K_p : float
        Position gain in 1/s; our choice.
    K_I : float
        Integral gain in 1/s²; our choice.
    K_v : float
        Velocity gain; our choice.
    delay : int
        Number of samples from a reading to the output computed from it, the "D" of Figure 2.
    counts : int
        Encoder counts per motor revolution; our choice. 0 means an ideal encoder.
    period : float
        Sampling period in s (Section 3.2).
    limit : float
        Output limit in V.
    volts_per_speed : float
        Scale in V s/m; the paper sets K_1 so that 10 V gives 1 m/s (Section 4).

    Raises
    ------
    TypeError, ValueError
        If a value has the wrong type or is out of range.
    """

    track: Track = field(default_factory=Track.trapezoid)
    K_p: float = _CONTROL["K_p"]
    K_I: float = _CONTROL["K_I"]
    K_v: float = _CONTROL["K_v"]
    delay: int = _CONTROL["delay"]
    counts: int = _CONTROL["counts"]
    period: float = 0.005
    limit: float = 10.0
    volts_per_speed: float = 10.0

    def __post_init__(self) -> None:
        checked_type("track", self.track, Track)
        for name, value in [*vars(self).items()][1:]:
            count = name in ("delay", "counts")
            number = checked_number(name, value, above=0.0, zero=count or name.startswith("K_"))
            object.__setattr__(self, name, checked_count(name, value, 0) if count else number)

    @property
    def law(self) -> Law:
        """Constants of the unit for the compiled `put_out`."""
        angle = 2 * math.pi / self.counts if self.counts else 0.0
        return Law(*[(vars(self) | {"angle": angle})[name] for name in Law._fields])

    def samples(self, t_end: float) -> tuple[np.ndarray, np.ndarray]:
        """Sample times (j,) in s before `t_end`; position and speed (j, 2) of the track there."""
        times = self.period * np.arange(math.ceil(t_end / self.period - 1e-9))
        return times, np.ascontiguousarray(self.track(times).T)


#: Memory of a unit between samples: indices of ∫e dt in m s and of the last position in m; size.
INTEGRAL, POSITION, MEMORY = 0, 1, 2


@njit(error_model="numpy", nogil=True)
def put_out(n, angle, r_g, track, law, memory, volts):
    """Return the output at sample `n`, and store in `volts` the output for `delay` samples later.

    Parameters
    ----------
    n : int
        Index of the sample.
    angle : float
        Motor angle in rad.
    r_g : float
        Motor gear radius in m.
    track : (j, 2) array
        Position in m and speed in m/s at each sample.
    law : Law
    memory : (MEMORY,) array
        Zero before the first sample.
    volts : (j,) array
        Outputs in V; zero before the first sample.
    """
    if law.angle > 0.0:
        angle = law.angle * math.floor(angle / law.angle + 0.5)
    x = r_g * angle
    speed = (x - memory[POSITION]) / law.period if n > 0 else 0.0
    memory[POSITION] = x
    error = track[n, 0] - x
    integral = memory[INTEGRAL] + error * law.period
    wanted = track[n, 1] + law.K_p * error + law.K_v * (track[n, 1] - speed)
    output = (wanted + law.K_I * integral) * law.volts_per_speed
    if abs(output) <= law.limit or output * error < 0.0:
        memory[INTEGRAL] = integral
    if n + law.delay < volts.size:
        volts[n + law.delay] = min(max(output, -law.limit), law.limit)
    return volts[n]
