"""Numbers read off a map of the step response over two parameters."""

import numpy as np


def peak(values: np.ndarray, T_p: np.ndarray, K_2: np.ndarray) -> tuple[float, float, float]:
    """Largest value of a map (m, n), and where it is: T_p of (n,) and K_2 of (m,).

    NaN in the map is left out; three NaN if there is nothing else.
    """
    if np.isnan(values).all():
        return np.nan, np.nan, np.nan
    row, column = np.unravel_index(np.nanargmax(values), values.shape)
    return float(values[row, column]), float(T_p[column]), float(K_2[row])


def spread(values: np.ndarray) -> float:
    """Largest ratio less one of two values in a column of a map, NaN left out."""
    return float(np.nanmax(np.nanmax(values, axis=0) / np.nanmin(values, axis=0)) - 1)


def missing_up_to(row: np.ndarray, x: np.ndarray) -> float:
    """Largest of the abscissae `x` (n,) up to which a row (n,) is NaN from its beginning.

    NaN if the row begins with a value. What is missing further on does not count.
    """
    return float(max(x[np.cumprod(np.isnan(row)) == 1], default=np.nan))
