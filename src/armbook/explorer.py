"""The table behind the page Explorer: exact step responses over a grid of three parameters."""

import base64
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import auxiliary_variables
from armsim.arm.response import SETTLED, settling_time
from armsim.machine_code import kept

#: Values that the sliders take: s, V/V, V. The published case is among them.
GRID: dict[str, tuple[float, ...]] = {
    "T_p": (0.021, 0.025, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.25, 0.5, 1.0, 4.74),
    "K_2": (100.0, 250.0, 400.0, 550.0, 700.0, 870.0),
    "set_velocity": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0),
}
PUBLISHED = {"T_p": 0.04, "K_2": 870.0, "set_velocity": 10.0}
T_END = 1.2  # s
CURVES = ("velocity", "current", "gear_force")
#: Largest distance of a drawn curve from the solution at `TIMES`, as a share of its range.
TOLERANCE = 0.004
#: Every 50 µs: a dozen times in a period of the fastest ringing, that of current and preamplifier.
TIMES = np.linspace(0.0, T_END, 24_001)


def response(T_p: float, K_2: float, set_velocity: float) -> tuple[np.ndarray, dict[str, float]]:
    """Run one case from rest.

    Parameters
    ----------
    T_p, K_2, set_velocity
        In s, V/V and V; K_1 follows from them by the paper's rule.

    Returns
    -------
    (3, n) array
        Velocity in m/s, current in A and gear force in N at `TIMES`.
    dict
        What the page tells as text: the velocity at the end, the largest velocity, current and
        force, and the settling time, NaN if it is beyond the end.
    """
    p = AxisParameters.paper_x_axis(T_p=T_p, K_2=K_2)
    y = simulate(p, set_velocity, T_END)(TIMES)
    force = auxiliary_variables(p, y)["f_g"]
    goal = 0.1 * set_velocity
    numbers = {
        "final_velocity": y[1, -1],
        "largest_velocity": y[1].max(),
        "settling_time": settling_time(TIMES, y[1], goal, SETTLED * goal),
        "largest_current": np.abs(y[6]).max(),
        "largest_force": np.abs(force).max(),
    }
    return np.array([y[1], y[6], force]), {name: float(v) for name, v in numbers.items()}


@kept()
def corners(t: np.ndarray, y: np.ndarray, tolerance: float) -> np.ndarray:
    """Places of the points between which straight lines stay within a tolerance of a curve."""
    keep = np.zeros(t.size, np.bool_)
    keep[0] = keep[-1] = True
    stack = [(0, t.size - 1)]
    while stack:
        a, b = stack.pop()
        line = y[a] + (y[b] - y[a]) / (t[b] - t[a]) * (t[a : b + 1] - t[a])
        off = np.abs(y[a : b + 1] - line)
        n = a + int(np.argmax(off))
        if off[n - a] > tolerance:
            keep[n] = True
            stack.append((a, n))
            stack.append((n, b))
    return np.flatnonzero(keep)


def table(grid: Mapping[str, Sequence[float]] = GRID) -> dict[str, Any]:
    """Compute all cases and pack them for the page.

    Parameters
    ----------
    grid : mapping, optional
        Values of the three parameters, the published ones among them.

    Returns
    -------
    dict
        ``grid``; ``published``, places of that case in it; ``t_end`` and ``tick`` in s;
        ``curves``; ``scale``, the unit of each curve's whole numbers; ``numbers``, those told as
        text for each case; ``counts``, how many points each curve has; and ``points``, their times
        in ticks and values. The last two are 16-bit integers in base64, little end first.
    """
    cases = [response(*case) for case in product(*grid.values())]
    scale = np.max([np.abs(curves).max(axis=1) for curves, _ in cases], axis=0) / 32767
    points = []  # of each curve in turn: places, and values there
    drawn = (pair for curves, _ in cases for pair in zip(curves, scale, strict=True))
    for y, unit in drawn:
        places = corners(TIMES, y, TOLERANCE * np.ptp(y))
        points += [places, np.rint(y[places] / unit)]
    return {
        "grid": {name: list(values) for name, values in grid.items()},
        "published": {name: list(grid[name]).index(value) for name, value in PUBLISHED.items()},
        "tick": TIMES[1],
        "t_end": T_END,
        "curves": CURVES,
        "scale": scale.tolist(),
        "numbers": [
            {name: float(f"{v:.4g}") if np.isfinite(v) else None for name, v in numbers.items()}
            for _, numbers in cases
        ],
        "counts": _packed(np.array([places.size for places in points[::2]])),
        "points": _packed(np.concatenate(points)),
    }


def _packed(numbers: np.ndarray) -> str:
    return base64.b64encode(numbers.astype("<i2").tobytes()).decode()


def curves(table: dict[str, Any], case: int) -> list[np.ndarray]:
    """Unpack one case as the page does: of each curve the times and values (2, n)."""
    raw = [base64.b64decode(table[key]) for key in ("counts", "points")]
    counts, points = (np.frombuffer(numbers, "<i2") for numbers in raw)
    drawn = np.split(points, 2 * np.cumsum(counts[:-1], dtype=int))[3 * case : 3 * case + 3]
    units = [np.array([[table["tick"]], [unit]]) for unit in table["scale"]]
    return [curve.reshape(2, -1) * unit for curve, unit in zip(drawn, units, strict=True)]


def distance(curve: np.ndarray, t: np.ndarray, exact: np.ndarray) -> float:
    """Largest distance of a drawn curve from exact values, as a share of their range.

    The curve may be early or late by one step of `TIMES`, much less than a pixel, so that a jump
    of the gear force between two of them does not count.

    Parameters
    ----------
    curve : (2, n) array
        Times and values, as `curves` gives them.
    t, exact : (m,) arrays
        Times, not nearer to the ends than a step, and the values there.
    """
    shifts = np.linspace(-TIMES[1], TIMES[1], 9)
    near = np.array([np.interp(t + shift, *curve) for shift in shifts])
    off = np.maximum(exact - near.max(axis=0), near.min(axis=0) - exact)
    return float(off.max() / np.ptp(exact))
