"""Costs that can be counted: coefficients of a method, and the paper's metric for its evaluations.

The metric, the change of the cost from one step size to the next, is computed in fractions from
the evaluations of the right-hand side that one step makes when an integrator is run.
"""

from fractions import Fraction
from itertools import pairwise
from math import ceil

from amplifier import gill
from orders import evaluations
from printed_tableaux import Tableau, first_same_as_last, repaired

STEP_SIZES = [Fraction(80, 10**6) / 2**n for n in range(6)]  # s, the project's choice
DURATION = 1  # s
METHODS: dict[str, Tableau] = {
    "Euler": ([[Fraction(0)]], [Fraction(1)]),
    "Gill": tuple(gill()),
    "RK5": repaired("rk5"),
    "RK6": repaired("rk6"),
    "DP5": first_same_as_last(),
    "DP4": repaired("ndp6"),
}


def coefficients(tableau: Tableau) -> int:
    """Products of a coefficient and a stage in one step."""
    rows, weights = tableau
    return sum(bool(entry) for row in [*rows, weights] for entry in row)


def metric(tableau: Tableau) -> list[Fraction]:
    """Change of the evaluations in a run, in %, each time that the step is halved."""
    each = evaluations(tableau)
    costs = [each * ceil(DURATION / step) for step in STEP_SIZES]
    return [100 * abs(Fraction(new - prior, prior)) for prior, new in pairwise(costs)]


def opinions() -> dict[str, tuple[float, float]]:
    """Recorded names with value and tolerance; counts are exact, and 1e-9 is for their rounding."""
    metrics = {name: metric(tableau) for name, tableau in METHODS.items()}
    spreads = [max(row) - min(row) for row in zip(*metrics.values(), strict=True)]
    better = [a - b for a, b in zip(metrics["RK6"], metrics["DP4"], strict=True)]
    values = {
        "metric_cost": (metrics["DP4"][0], 1e-9),
        "metric_cost_spread": (max(spreads), 1e-9),
        "metric_cost_better": (max(better), 1e-9),
        "coefficients_DP4": (coefficients(METHODS["DP4"]), 0.0),
        "coefficients_RK6": (coefficients(METHODS["RK6"]), 0.0),
    }
    return {f"60_cpu_time::{name}": (float(value), tol) for name, (value, tol) in values.items()}
