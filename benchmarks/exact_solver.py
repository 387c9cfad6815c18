"""Cost and error of the exact solver, against LSODA, CVODE and DOP853 with the same equations.

Each repetition solves one second of the published step response with new parameters, by every
solver in turn, so that all see the same state of the machine; the ratio is that of the pair. The
error is that at the end, relative to each state's largest value, against the 35 digits of
tests/reference. Run with ``python benchmarks/exact_solver.py``.
"""

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from armbook.peers import peers
from armbook.problems import Equations, Solve
from armsim.arm import AxisParameters, simulate, simulate_many
from armsim.arm.dynamics import constants, rhs
from reportkit.timing import machine

REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "published_step.json"
RTOL = 1e-8
ATOL = RTOL * 1e-2 * np.array([1, 1, 100, 100, 1e3, 1e5, 10])  # of a size with each state
SPAN, START, VOLTS = np.array([0.0, 1.0]), np.zeros(7), 10.0
ARM = Equations(rhs, ())
PEERS = ("CVODE BDF", "CVODE Adams", "SciPy odeint", "SciPy LSODA", "SciPy DOP853")


def exact(p: AxisParameters) -> np.ndarray:
    return simulate(p, VOLTS, 1.0)(1.0)


def exact_with_curve(p: AxisParameters) -> np.ndarray:
    return simulate(p, VOLTS, 1.0).y[:, -1]


def peer(solve: Solve) -> Callable[[AxisParameters], np.ndarray]:
    return lambda p: solve(ARM, SPAN, START, (VOLTS, constants(p)))[1][:, -1]


SOLVERS: dict[str, Callable[[AxisParameters], np.ndarray]] = {
    "exact": exact,
    "exact, with 1000 points": exact_with_curve,
} | {name: peer(solve) for name, solve in peers(RTOL, ATOL).items() if name in PEERS}


def timed(function: Callable, axes: list[AxisParameters]) -> float:
    """Processor seconds a call; the parameters are other ones at every call."""
    begin = process_time()
    for p in axes:
        function(p)
    return (process_time() - begin) / len(axes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=15)
    parser.add_argument("--batch", type=int, default=20_000, help="runs of the batch")
    arguments = parser.parse_args()
    published = AxisParameters.paper_x_axis()
    wanted = json.loads(REFERENCE.read_text())
    final = np.array([float(v) for v in wanted["samples"][-1]["y"]])
    largest = np.array([float(v) for v in wanted["y_largest"]])
    random = np.random.default_rng(0)

    def axes(count: int) -> list[AxisParameters]:
        return [published.replace(T_p=0.04 * f) for f in random.uniform(0.99, 1.01, count)]

    errors = {name: (np.abs(f(published) - final) / largest).max() for name, f in SOLVERS.items()}
    times: dict[str, list[float]] = {name: [] for name in SOLVERS}
    for _ in range(arguments.repetitions):
        for name, function in SOLVERS.items():
            times[name].append(timed(function, axes(200 if name.startswith("exact") else 1)))
    print(f"one second of the published step; rtol {RTOL:g}; {arguments.repetitions} repetitions\n")
    print(f"{'':24} {'fastest':>10} {'median':>10} {'ratio (quartiles)':>22} {'error':>9}")
    for name, seconds in times.items():
        ratios = np.array(seconds) / np.array(times["exact"])
        low, middle, high = np.quantile(ratios, [0.25, 0.5, 0.75])
        print(
            f"{name:24} {1e6 * min(seconds):7.0f} µs {1e6 * np.median(seconds):7.0f} µs "
            f"{middle:8.0f} ({low:.0f} to {high:.0f}) {errors[name]:9.1e}"
        )
    fastest = min((name for name in PEERS if name in times), key=lambda name: min(times[name]))
    ratio = np.median(np.array(times[fastest]) / np.array(times["exact"]))
    print(
        f"\nagainst the fastest peer, {fastest}: {ratio:.0f} times faster, and "
        f"{np.log10(errors[fastest] / errors['exact']):.1f} digits more accurate"
    )

    many = axes(arguments.batch)
    simulate_many(many[:100])
    for threads in (1, 2):
        best = math.inf
        for _ in range(5):
            begin = perf_counter()
            simulate_many(many, threads=threads)
            best = min(best, perf_counter() - begin)
        print(f"batch of {len(many)}, {threads} threads: {len(many) / best:.0f} runs a second")
    (row,) = machine().itertuples(index=False)
    print(f"\n{row.machine}; {row.software}; load {row.load}")


if __name__ == "__main__":
    main()
