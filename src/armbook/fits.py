"""The notebook of the parameter fit: its input, and distances from a fit in standard errors."""

import tomllib
from collections.abc import Iterable
from timeit import repeat
from typing import Any

import numpy as np
from joblib import cpu_count

from armsim.arm.files import read_axis, read_measurement
from armsim.arm.identify import Fit, posed
from armsim.paths import DATA


def read(measurements: str, axis: str, bounds: str, **_: Any) -> tuple[tuple, dict[str, Any]]:
    """Read the record, its axis and instrument, and the bounds that the notebook is given.

    Raises
    ------
    ValueError, OSError
        If a file or the text of the bounds will not do; the message is one line.
    """
    record = read_measurement(measurements or DATA / "measurements" / "x_axis_test.csv")
    case = record, *read_axis(axis or DATA / "axes" / "x.toml")
    try:
        return case, tomllib.loads(f"of = {{ {bounds} }}")["of"]
    except (ValueError, RecursionError):
        raise ValueError(f"bounds = {bounds!r}: expected NAME = [LOW, HIGH], …") from None


def checked(parameters: dict[str, Any]) -> str:
    """Check the notebook's parameters as `read` and the fit do; tell if it will take minutes."""
    case, bounds = read(**parameters)
    problem = posed(*case, None, bounds)
    middle = (problem.low + problem.high) / 2
    one = min(repeat(lambda: problem.model([middle]), number=1, repeat=3))
    # Number of runs, and seconds of 85 runs of fixed steps, as measured with a record of 20 s.
    runs = 150 * parameters["starts"] + 1000 + 5 * parameters["refits"] / cpu_count()
    fixed = 85 * 2e-7 * problem.measurement.elapsed[-1] / parameters["fine_step"]
    minutes = (runs * one + fixed) / 60
    told = f", about {minutes:.0f} minutes; fewer refits and a larger fine_step take less"
    return told if minutes > 2 else ""


def in_errors(fit: Fit, values: Iterable[float]) -> np.ndarray:
    """Return how far `values` (k,) lie above the estimates of a fit, in its standard errors."""
    return (np.array([*values]) - fit.values) / fit.standard_errors


def off_parabola(distances: np.ndarray, rise: np.ndarray, reach: float = 2.1) -> float:
    """Return the largest difference of a profile likelihood from the parabola of a linear model.

    Parameters
    ----------
    distances, rise : (n,) arrays
        Distance from the estimate in standard errors, and rise of χ² there.
    reach : float
        Only where the distance is smaller.
    """
    near = np.abs(distances) < reach
    return float(np.abs(rise - distances**2)[near].max())
