"""A move under the slave control unit, and the tracking error of the arm."""

from dataclasses import dataclass, field

import numpy as np

from armsim.arm.linear import nearly_linear
from armsim.arm.parameters import AxisParameters
from armsim.arm.response import settling_time
from armsim.arm.simulate import Trajectory, simulate
from armsim.arm.slave_control import SlaveControl

#: Half-width in m of the band around the goal that counts as arrived.
BAND = 1e-3
#: Simulated time in s after the end of the track.
REST = 1.0


@dataclass(frozen=True, eq=False)
class Move:
    """A run of the arm and its track at the same fine times."""

    run: Trajectory
    t: np.ndarray = field(repr=False)  #: (n,) s
    y: np.ndarray = field(repr=False)  #: (7, n) states
    wanted: np.ndarray = field(repr=False)  #: (2, n) position in m and speed in m/s of the track

    @property
    def error(self) -> np.ndarray:
        """Position of the track minus that of the arm, (n,) in m."""
        return self.wanted[0] - self.y[0]

    @property
    def tracking_error(self) -> float:
        """Largest magnitude of the error, m."""
        return float(np.abs(self.error).max())

    @property
    def overshoot(self) -> float:
        """Largest distance by which the arm passes the goal, m."""
        goal = self.wanted[0, -1]
        return max(0.0, float((np.sign(goal) * (self.y[0] - goal)).max()))

    @property
    def arrival(self) -> float:
        """Time in s after which the arm stays within `BAND` of the goal; NaN if it does not."""
        return settling_time(self.t, self.y[0], self.wanted[0, -1], BAND)

    @property
    def share_at_limit(self) -> float:
        """Share of the track's duration for which the preamplifier is at its limit."""
        assert self.run.control is not None
        v_c, p = self.run.auxiliary(self.t)["v_c"], self.run.parameters
        return float((np.abs(v_c) >= p.V_L)[self.t < self.run.control.track.duration].mean())


def move(p: AxisParameters, control: SlaveControl) -> Move:
    """Simulate the move of a control unit exactly, from rest."""
    t_end = control.track.duration + REST
    run, t = simulate(p, control=control, t_end=t_end), np.linspace(0.0, t_end, 8001)
    return Move(run, t, run(t), control.track(t))


def linear_move(nonlinear: Move, gain: float = 1e5) -> Move:
    """Let a linear model of the same axis make a move under the same control unit.

    Parameters
    ----------
    nonlinear : Move
        The move of the axis itself.
    gain : float
        See `armsim.arm.linear.nearly_linear`.
    """
    assert nonlinear.run.control is not None
    return move(nearly_linear(nonlinear.run.parameters, gain), nonlinear.run.control)
