"""Exact step responses, packed for the scripts that plot them and set the arm in motion."""

import base64
import json
from collections.abc import Mapping, Sequence
from itertools import chain, product
from typing import Any

import numpy as np

from armbook.events import story
from armsim.arm import AxisParameters, Trajectory, simulate
from armsim.arm.dynamics import auxiliary_variables
from armsim.arm.linear import arm_mode
from armsim.arm.response import SETTLED, overshoot, settling_time
from armsim.machine_code import kept
from armsim.paths import read_toml

_SETTINGS = read_toml("explorer.toml")
GRID: dict[str, list[float]] = _SETTINGS["grid"]  #: values that the sliders take
PUBLISHED: dict[str, float] = _SETTINGS["published"]  #: one of them each
#: The curves of a case, each with the share of its range by which it may differ from the solution.
CURVES: dict[str, float] = _SETTINGS["curves"]
T_END, SAMPLES = _SETTINGS["t_end"], _SETTINGS["samples"]


def sampled(run: Trajectory, t: np.ndarray) -> np.ndarray:
    """Values of `CURVES` at some times, in SI units, the pinion-rack difference in µm: (6, n)."""
    p, y = run.parameters, run(t)
    more = auxiliary_variables(p, y)
    difference = 1e6 * (p.r_g * y[2] - y[0])
    return np.array([y[1], y[6], more["f_g"], difference, more["v_c"], more["v_m"]])


def quality(
    run: Trajectory, t: np.ndarray, curves: np.ndarray, goal: float
) -> dict[str, float | None]:
    """Numbers that the page shows of a run, with four digits; None for what does not apply.

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
    return {name: float(f"{v:.4g}") if np.isfinite(v) else None for name, v in numbers.items()}


@kept()
def corners(t: np.ndarray, y: np.ndarray, tolerance: float) -> np.ndarray:
    """Places of the points between which straight lines stay within a tolerance of a curve."""
    keep = np.zeros(t.size, np.bool_)
    keep[0] = keep[-1] = True
    stack = [(0, t.size - 1)]
    while stack:
        a, b = stack.pop()
        slope, farthest, most = (y[b] - y[a]) / (t[b] - t[a]), a, tolerance
        for n in range(a + 1, b):
            off = abs(y[n] - (y[a] + slope * (t[n] - t[a])))
            if off > most:
                farthest, most = n, off
        if farthest > a:
            keep[farthest] = True
            stack.append((a, farthest))
            stack.append((farthest, b))
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
    each = [*chain(*events)]
    told = [story(event.before, event.after) for event in each]
    words = sorted({*told})
    branches = (np.dot([9, 3, 1], event.after[:3]) + 13 for event in each)
    codes = [27 * words.index(text) + n for text, n in zip(told, branches, strict=True)]
    p = run.parameters
    return {
        "grid": grid,
        "published": {name: grid[name].index(value) for name, value in PUBLISHED.items()},
        "tick": t[1],
        "t_end": t_end,
        "play": 1e6 * p.H,
        "limits": {"preamplifier": p.V_L, "motor_voltage": p.V_M, "current": p.K_i * p.V_L},
        "curves": list(CURVES),
        "scale": scale,
        "numbers": numbers,
        "counts": _packed([places.size for places in points]),
        "points": _packed(np.concatenate([*chain(*zip(points, whole, strict=True))])),
        "words": words,
        "event_counts": _packed([len(some) for some in events]),
        "event_times": _packed([event.time for event in each], "<f8"),
        "event_codes": _packed(codes),
    }


def script(table: dict[str, Any], name: str) -> str:
    """Return a table as the element of a page where a script finds it without a server."""
    data = json.dumps(table, separators=(",", ":"))
    return f'<script type="application/json" id="{name}">{data}</script>\n'


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
