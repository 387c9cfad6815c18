"""How fast an error falls with the step: the observed order of a method."""

from collections.abc import Sequence
from math import inf, nan

import numpy as np


def observed_order(
    steps: Sequence[float] | np.ndarray,
    errors: Sequence[float] | np.ndarray,
    *,
    smallest: float = 1e-12,
    largest: float = inf,
    finest: int | None = None,
) -> float:
    """Slope of the least-squares line through log(error) over log(step).

    Parameters
    ----------
    steps, errors : (n,) array_like
        Step sizes, positive, and the errors with them.
    smallest, largest : float
        Only errors between the two are used: below, an error is rounding; above, it says nothing
        of the limit. What is not finite is left out.
    finest : int, optional
        Use only so many of them, those with the smallest steps.

    Returns
    -------
    float
        NaN if fewer than two errors can be used.

    Examples
    --------
    >>> h = np.array([0.1, 0.05, 0.025])
    >>> observed_order(h, 3 * h**4)
    4.0
    """
    steps, errors = np.asarray(steps, dtype=float), np.asarray(errors, dtype=float)
    usable = np.flatnonzero((errors > smallest) & (errors < largest))
    usable = usable[np.argsort(steps[usable])][:finest]
    if usable.size < 2:
        return nan
    slope = np.polyfit(np.log(steps[usable]), np.log(errors[usable]), 1)[0]
    return round(float(slope), 12)
