"""Distances from a fit in standard errors."""

from collections.abc import Iterable

import numpy as np

from armsim.arm.identify import Fit


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
