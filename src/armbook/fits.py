"""Fitted parameters in the book: their units, their digits, and distances in standard errors."""

from collections.abc import Iterable

import numpy as np

from armsim.arm.identify import Fit

#: SI units of the fitted parameters; in figures and tables some are shown in others.
UNITS = {"V_L": "V", "B_a": "N s/m", "b_g": "N s/m", "K_g": "N/m", "F_0": "N"}
_SHOWN = {"K_g": "kN/m"}
SCALE = {name: 1e-3 if name in _SHOWN else 1.0 for name in UNITS}


def label(name: str) -> str:
    """Name and unit of a parameter for an axis or a table."""
    unit = _SHOWN.get(name, UNITS[name])
    return f"${name}$ / ({unit})" if "/" in unit else f"${name}$ / {unit}"


def digits(value: float, error: float, scale: float = 1.0) -> str:
    """Text of a value to a tenth of its error, both multiplied by `scale`; a dash for NaN."""
    places = max(0, 1 - int(np.floor(np.log10(scale * error))))
    return f"{scale * value:.{places}f}" if np.isfinite(value) else "–"


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
