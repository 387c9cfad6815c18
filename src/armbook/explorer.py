"""Exact step responses, packed for the scripts that plot them and set the arm in motion."""

import base64
import json
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from armbook.events import story
from armsim.arm import AxisParameters, Trajectory, simulate
from armsim.arm.dynamics import Region, auxiliary_variables
from armsim.arm.linear import arm_mode
from armsim.arm.response import SETTLED, overshoot, settling_time
from armsim.machine_code import kept

#: Values that the sliders take: s, V/V, V. The published case is among them.
GRID: dict[str, tuple[float, ...]] = {
    "T_p": (0.021, 0.025, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.25, 0.5, 1.0, 4.74),
    "K_2": (100.0, 250.0, 400.0, 550.0, 700.0, 870.0),
    "set_velocity": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0),
}
PUBLISHED = {"T_p": 0.04, "K_2": 870.0, "set_velocity": 10.0}
T_END = 4.0  # s
#: Curves of a case, and the largest distance of each, as it is kept, from the solution at the
#: samples, as a share of its range. The first three are plotted, the others only animated.
CURVES = {
    "velocity": 0.004,
    "current": 0.004,
    "gear_force": 0.004,
    "difference": 0.01,
    "preamplifier": 0.02,
    "motor_voltage": 0.02,
}
#: Samples of a run: every 62.5 µs in 4 s, ten in a period of the fastest ringing; 16 bits count
#: them.
SAMPLES = 64_001


def sampled(run: Trajectory, t: np.ndarray) -> np.ndarray:
    """Values of `CURVES` at some times, in SI units, the pinion-rack difference in µm: (6, n)."""
    p, y = run.parameters, run(t)
    more = auxiliary_variables(p, y)
    difference = 1e6 * (p.r_g * y[2] - y[0])
    return np.array([y[1], y[6], more["f_g"], difference, more["v_c"], more["v_m"]])


def quality(run: Trajectory, t: np.ndarray, curves: np.ndarray, goal: float) -> dict[str, float]:
    """Numbers that the page shows of a run; NaN for what does not apply.

    Parameters
    ----------
    run : Trajectory
        Exact run from rest.
    t, curves : (n,) and (6, n) arrays
        Times and the values of `CURVES`.
    goal : float
        Final velocity in m/s.
    """
    velocity, band = curves[0], SETTLED * goal
    numbers = {
        "K_1": run.parameters.K_1,
        "final_velocity": velocity[-1],
        "overshoot": 100 * overshoot(velocity, goal, band),
        "settling_time": settling_time(t, velocity, goal, band),
        "decay": arm_mode(run.parameters)[1],
        "largest_current": np.abs(curves[1]).max(),
        "largest_force": np.abs(curves[2]).max(),
    }
    return {name: float(value) for name, value in numbers.items()}


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


def table(
    grid: Mapping[str, Sequence[float]] = GRID, t_end: float = T_END, share: float = 1.0
) -> dict[str, Any]:
    """Compute all cases and pack them for the page.

    Parameters
    ----------
    grid : mapping, optional
        Values of the three parameters, the published ones among them.
    t_end : float, optional
        End of each run in s.
    share : float, optional
        Factor of the tolerances in `CURVES`.

    Returns
    -------
    dict
        ``grid``; ``published``, places of that case in it; ``t_end`` and ``tick`` in s; ``play``
        in µm and ``limits`` of the animated signals; ``scale``, the unit of each curve's whole
        numbers; ``numbers``, those told as text for each case; ``counts``, how many points each
        curve has; ``points``, their times in ticks and values; ``words``, ``event_counts``,
        ``event_times`` and ``event_codes``: the place in ``words`` times 27, plus the branches of
        preamplifier, power stage and contact after the event, as digits of base 3. Long columns
        are in base64, little end first: the times of events as 64-bit floats, the others as 16-bit
        integers, unsigned but for the values.
    """
    t = np.linspace(0.0, t_end, SAMPLES)
    points, values, numbers, events = [], [], [], []
    for T_p, K_2, volts in product(*grid.values()):
        run = simulate(AxisParameters.paper_x_axis(T_p=T_p, K_2=K_2), volts, t_end)
        curves = sampled(run, t)
        for y, tolerance in zip(curves, CURVES.values(), strict=True):
            points.append(corners(t, y, share * tolerance * np.ptp(y)))
            values.append(y[points[-1]])
        numbers.append(quality(run, t, curves, 0.1 * volts))
        events.append(run.events)
    kinds = len(CURVES)
    scale = [max(np.abs(y).max() for y in values[k::kinds]) / 32767 for k in range(kinds)]
    whole = [np.rint(y / scale[n % kinds]).astype(int) for n, y in enumerate(values)]
    told = [(story(e.before, e.after), e.after) for some in events for e in some]
    words = sorted({text for text, _ in told})
    codes = [words.index(text) * 27 + _branches(after) for text, after in told]
    p = run.parameters
    return {
        "grid": {name: list(values) for name, values in grid.items()},
        "published": {name: list(grid[name]).index(value) for name, value in PUBLISHED.items()},
        "tick": t[1],
        "t_end": t_end,
        "play": 1e6 * p.H,
        "limits": {"preamplifier": p.V_L, "motor_voltage": p.V_M, "current": p.K_i * p.V_L},
        "curves": list(CURVES),
        "scale": scale,
        "numbers": [
            {name: float(f"{v:.4g}") if np.isfinite(v) else None for name, v in some.items()}
            for some in numbers
        ],
        "counts": _packed([places.size for places in points]),
        "points": _packed(
            np.concatenate([n for pair in zip(points, whole, strict=True) for n in pair])
        ),
        "words": words,
        "event_counts": _packed([len(some) for some in events]),
        "event_times": _packed([e.time for some in events for e in some], "<f8"),
        "event_codes": _packed(codes),
    }


def script(table: dict[str, Any], name: str) -> str:
    """Return a table as the element of a page where a script finds it without a server."""
    data = json.dumps(table, separators=(",", ":"))
    return f'<script type="application/json" id="{name}">{data}</script>\n'


def _branches(where: Region) -> int:
    return 9 * (where.preamplifier + 1) + 3 * (where.power + 1) + where.contact + 1


def _packed(numbers: Any, kind: str = "<i2") -> str:
    """Return numbers in base64; of unsigned ones the 16 bits are the same."""
    return base64.b64encode(np.asarray(numbers).astype(kind).tobytes()).decode()


def curves(table: dict[str, Any], case: int) -> list[np.ndarray]:
    """Unpack one case as the page does: of each curve the times and values (2, n)."""
    raw = [base64.b64decode(table[key]) for key in ("counts", "points")]
    counts, points = (np.frombuffer(numbers, "<i2") for numbers in raw)
    kinds = len(CURVES)
    drawn = np.split(points, 2 * np.cumsum(counts[:-1], dtype=int))[kinds * case :][:kinds]
    pairs = [(curve[: curve.size // 2].view("<u2"), curve[curve.size // 2 :]) for curve in drawn]
    return [
        np.array([times * table["tick"], values * unit])
        for (times, values), unit in zip(pairs, table["scale"], strict=True)
    ]


def distance(curve: np.ndarray, t: np.ndarray, exact: np.ndarray, tick: float) -> float:
    """Largest distance of a drawn curve from exact values, as a share of their range.

    The curve may be early or late by one tick, much less than a pixel, so that a jump
    of the gear force between two of them does not count.

    Parameters
    ----------
    curve : (2, n) array
        Times and values, as `curves` gives them.
    t, exact : (m,) arrays
        Times, not nearer to the ends than a tick, and the values there.
    tick : float
        Interval of the samples that the curve was made from.
    """
    shifts = np.linspace(-tick, tick, 9)
    near = np.array([np.interp(t + shift, *curve) for shift in shifts])
    off = np.maximum(exact - near.max(axis=0), near.min(axis=0) - exact)
    return float(off.max() / np.ptp(exact))
