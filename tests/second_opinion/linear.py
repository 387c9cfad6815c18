"""The linear arm by matrix exponentials: settling times, currents, and the limit of a rigid arm.

States are sampled densely with exponentials of the system matrix. A root finder locates every
extremum and crossing between the samples, and a bisection finds the time constants in question.
"""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import ceil, floor, log10, pi

import mpmath
import numpy as np
from printed_tableaux import repaired
from printed_values import load, numbers, range_of, x_axis
from scipy.linalg import expm
from scipy.optimize import brentq

U = 10.0  # V, for 1 m/s (Section 4)
ABOUT = 0.03  # s, in which the response reaches the steady state (Section 4)
TWO, FIVE = 0.02, 0.05  # shares of the final velocity that count as steady
SAMPLES, SPAN = 2**14, 1.0  # s
Parameters = dict[str, float]
Function = Callable[[float], float]


def seven_states(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Matrix, and what a volt at an input of gain 1 adds, of the model with its teeth engaged.

    States: arm velocity, deflection of the teeth, motor velocity, y_4, y_5, current. The two
    positions enter through the deflection only.
    """
    A, b = np.zeros((6, 6)), np.zeros(6)
    force = np.array([-p["b_g"], p["K_g"], p["r_g"] * p["b_g"], 0, 0, 0])
    voltage = p["K_e"] * np.array([0, 0, 0, 1, p["T_z"], -1 / p["K_i"]])
    A[0] = force / p["M"]
    A[0, 0] -= p["B_a"] / p["M"]
    A[1, [0, 2]] = -1, p["r_g"]
    A[2] = -p["r_g"] * force / p["J_m"]
    A[2, [2, 5]] += np.array([-p["B_m"], p["K_b"]]) / p["J_m"]
    A[3, 4] = 1
    A[4, [2, 3, 4]] = -p["K_2"] * p["K_t"], -1, -p["T_p"] - p["T_r"]
    b[4] = 1
    A[4], b[4] = A[4] / (p["T_p"] * p["T_r"]), b[4] / (p["T_p"] * p["T_r"])
    A[5] = voltage / p["L_a"]
    A[5, [2, 5]] -= np.array([p["K_b"], p["R_a"]]) / p["L_a"]
    return A, b


def set_velocity_gain(p: Parameters) -> float:
    """Gain K_1 with which the steady arm moves at 0.1 m/s per volt."""
    A, b = seven_states(p)
    return 0.1 / float(-np.linalg.solve(A, b)[0])


def four_states(p: Parameters) -> np.ndarray:
    """Matrix of the reduced model with its input: arm position, arm velocity, y_4, y_5, and 1."""
    J, B = p["J_m"] + p["r_g"] ** 2 * p["M"], p["B_m"] + p["r_g"] ** 2 * p["B_a"]
    A = np.zeros((5, 5))
    A[0, 1] = A[2, 3] = 1
    A[1, 1:4] = -B / J, *(p["r_g"] * p["K_b"] * p["K_i"] / J * np.array([1, p["T_z"]]))
    A[3, 1:4] = -p["K_2"] * p["K_t"] / p["r_g"], -1, -p["T_p"] - p["T_r"]
    A[3, 4] = set_velocity_gain(p) * U
    A[3] /= p["T_p"] * p["T_r"]
    return A


def sampled(A: np.ndarray, step: float, samples: int) -> np.ndarray:
    """States from rest at 0, step, 2 step, ...: twice as many with each squared exponential."""
    x, E = np.eye(len(A))[:, -1:], expm(A * step)
    while x.shape[1] < samples:
        x, E = np.hstack([x, E @ x]), E @ E
    return x[:, :samples]


class Response:
    """Step response of the reduced model for one time constant."""

    def __init__(self, p: Parameters):
        self.A, self.step = four_states(p), SPAN / SAMPLES
        self.x = sampled(self.A, self.step, SAMPLES)
        self.velocity = np.array([0, 1.0, 0, 0, 0])
        self.current = p["K_i"] * np.array([0, 0, 1.0, p["T_z"], 0])
        self.final = -np.linalg.solve(self.A[1:4, 1:4], self.A[1:4, 4])[0]

    def at(self, row: np.ndarray) -> Function:
        """Output as a function of time: from the last sample by its Taylor series."""
        terms = [row]
        for n in range(1, 20):  # the fastest rate is 8e3 1/s: a term is less than half the last
            terms.append(terms[-1] @ self.A / n)
        series = np.array(terms[::-1])

        def output(t: float) -> float:
            n = min(int(t / self.step), SAMPLES - 1)
            return float(np.polyval(series @ self.x[:, n], t - n * self.step))

        return output

    def extrema(self, row: np.ndarray) -> list[tuple[float, float]]:
        """Brackets in time around the extrema of an output."""
        slope = row @ self.A @ self.x
        where = np.flatnonzero(slope[1:-1] * slope[2:] < 0) + 1
        return [(n * self.step, (n + 1) * self.step) for n in where]

    def peak_current(self) -> float:
        """Largest current."""
        slope, output = self.at(self.current @ self.A), self.at(self.current)
        near = self.extrema(self.current)[:3]  # the first swings are the largest
        return max(output(brentq(slope, *bracket, xtol=1e-14)) for bracket in near)

    def settling_time(self, share: float) -> float:
        """Last time at which the velocity enters the band around its final value."""
        slope, output = self.at(self.velocity @ self.A), self.at(self.velocity)

        def outside(t: float) -> float:
            return abs(output(t) / self.final - 1) - share

        later = SPAN
        for low, high in reversed(self.extrema(self.velocity)):
            middle = int(low / self.step)
            if abs(self.velocity @ self.x[:, middle] / self.final - 1) > 0.9 * share:
                extremum = brentq(slope, low, high, xtol=1e-14)
                if outside(extremum) > 0:
                    return brentq(outside, extremum, later, xtol=1e-13)
                later = extremum
            else:
                later = low
        return brentq(outside, 0.0, later, xtol=1e-13)

    def arrival_time(self, share: float) -> float:
        """First time at which the velocity enters the band around its final value."""
        output = self.at(self.velocity)
        n = int(np.argmax(self.velocity @ self.x > (1 - share) * self.final))
        bracket = (n - 1) * self.step, n * self.step
        return brentq(lambda t: output(t) / self.final - 1 + share, *bracket, xtol=1e-13)


def nearest_to(target: float, time: Function, low: float, high: float) -> float:
    """Time constant whose time is nearest to the target, at a crossing or on a side of a jump."""
    grid = np.geomspace(low, high, 150)
    above = [time(T_p) > target for T_p in grid]
    sides = []
    for (a, b), (left, right) in zip(pairwise(grid), pairwise(above), strict=True):
        while left != right and b - a > 1e-10:
            middle = (a + b) / 2
            a, b = (middle, b) if (time(middle) > target) == left else (a, middle)
        sides += [a, b] if left != right else []
    return min(sides, key=lambda T_p: abs(time(T_p) - target))


def readings() -> dict[str, tuple[float, float]]:
    """Time constant, time and current of the response that settles in about 0.03 s."""
    p, found = x_axis(), {}
    rated = p["K_i"] * p["V_L"]

    @cache
    def response(T_p: float) -> Response:
        return Response(p | {"T_p": T_p})

    times = {
        "settled": lambda T_p: response(T_p).settling_time(TWO),
        "wide": lambda T_p: response(T_p).settling_time(FIVE),
        "arrival": lambda T_p: response(T_p).arrival_time(TWO),
    }
    for key, time in times.items():
        T_p = nearest_to(ABOUT, time, *range_of("T_p"))
        # T_p is located to 1e-10 s here. The notebook stops 1e-9 s away from a jump. It takes the
        # first arrival from samples, and 1 ms of T_p moves that by 4 µs only.
        found[f"T_p_{key}"] = float(T_p), 1e-6 if key == "arrival" else 1e-7
        found[f"time_{key}"] = 1e3 * time(T_p), 1e-5
        found[f"ratio_{key}"] = response(T_p).peak_current() / rated, 1e-5
    return found


def distance(gain: float) -> float:
    """Largest distance of the seven states without nonlinear parts from the reduced model, in %."""
    p = x_axis() | {"T_p": 1.0, "K_e": gain, "K_g": 1e6 * gain, "b_g": 100 * gain}
    reduced = Response(p)
    step = 1.25 * reduced.settling_time(TWO) / 400
    A, b = seven_states(p)
    full = np.zeros((7, 7))
    full[:6, :6], full[:6, 6] = A, b * set_velocity_gain(p) * U
    with mpmath.workdps(40):  # rates from 1 to 1e8 1/s
        E = mpmath.expm(mpmath.matrix(full) * step)
        states = [mpmath.matrix([0] * 6 + [1])]
        for _ in range(400):
            states.append(E * states[-1])
    velocity = reduced.velocity @ sampled(reduced.A, step, 401)
    error = np.abs(np.array([float(x[0]) for x in states]) - velocity)
    return float(100 * error.max() / np.abs(velocity).max())


def agreeing_digits(step: float = 1e-5) -> int:
    """Digits to which RK6 and matrix exponentials agree on position, velocity and current."""
    rows, weights = (np.array(part, dtype=float) for part in repaired("rk6"))
    worst = 0.0
    for T_p in (1.0, 0.25):
        p = x_axis() | {"T_p": T_p}
        response = Response(p)
        steps = ceil(1.25 * response.settling_time(TWO) / step)
        x = np.eye(5)[:, -1:].repeat(steps + 1, axis=1)
        for n in range(steps):
            k = np.zeros((7, 5))
            for stage in range(7):
                k[stage] = response.A @ (x[:, n] + step * (rows[stage] @ k))
            x[:, n + 1] = x[:, n] + step * (weights @ k)
        outputs = np.stack([np.eye(5)[0], response.velocity, response.current])
        exact = outputs @ sampled(response.A, step, steps + 1)
        error = np.abs(outputs @ x - exact).max(axis=1) / np.abs(exact).max(axis=1)
        worst = max(worst, error.max())
    return floor(-log10(worst))


def constants() -> dict[str, tuple[float, float]]:
    """What follows from single printed values."""
    p, tables = x_axis(), load("paper/tables.toml")
    rows = {row["symbol"]: row for row in tables["table5"]}
    limit, current = rows["V_L"], rows["I_M"]
    return {
        "10_model::rolloff": (1 / (2 * pi * p["T_r"]), 1e-9),  # rounding only
        "30_nonlinear_step_response::K_1": (set_velocity_gain(p), 1e-6),  # condition 2e8
        "52_parameter_fit::printed_K_i_V_L_novel": (p["K_i"] * numbers(limit["ndp"])[0], 1e-12),
        "52_parameter_fit::gain_needed_novel": (
            numbers(current["ndp"])[0] / numbers(limit["ndp"])[0],
            1e-12,
        ),
    }


def opinions() -> dict[str, tuple[float, float]]:
    """Recorded names with value and tolerance."""
    # of a percentage: rounding of the reduced model, 1e-12 of its velocity
    values = {f"distance_1e{n}": (distance(10.0**n), 1e-8) for n in (3, 4, 5)}
    # rounding errors may move the last digit
    values |= {"agreeing_digits": (agreeing_digits(), 1.0)} | readings()
    return constants() | {f"20_linear_step_response::{name}": pair for name, pair in values.items()}
