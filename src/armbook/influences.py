"""Influences on the step response: elasticities, and each nonlinearity alone."""

from collections.abc import Callable, Iterable

import numpy as np

from armsim.arm import AxisParameters, simulate
from armsim.arm.linear import UNLIMITED

#: The parameters that make each nonlinearity.
NONLINEARITIES = {"backlash": ["H"], "static friction": ["F_0"], "limits": ["V_L", "V_M"]}


def elasticities(
    measured: Callable[[AxisParameters], np.ndarray], p: AxisParameters, names: Iterable[str]
) -> dict[str, np.ndarray]:
    """Relative changes of quantities for a relative change of each of some parameters.

    Parameters
    ----------
    measured : callable
        Returns the quantities (n,) of an axis.
    p : AxisParameters
        The axis.
    names : iterable of str
        Its parameters; each is made larger and smaller by 1 %.

    Returns
    -------
    dict
        By parameter, d log(quantity) / d log(parameter) of each quantity.
    """
    found = {}
    for name in names:
        more, less = (measured(p.replace(**{name: f * getattr(p, name)})) for f in (1.01, 0.99))
        found[name] = np.log(more / less) / np.log(1.01 / 0.99)
    return found


def effects(p: AxisParameters, volts: float) -> dict[str, list[float]]:
    """Effect of each nonlinearity on the arm velocity in the second after a step.

    Returns
    -------
    dict
        By nonlinearity two largest changes in per cent of the final velocity: when it is taken out
        of the full model, and when it is the only one in the model without any.
    """
    t = np.linspace(0, 1, 20_001)

    def velocity(**changes: float) -> np.ndarray:
        return simulate(p.replace(**changes), volts, 1.0)(t)[1]

    full, linear, found = velocity(), velocity(**UNLIMITED), {}
    for told, names in NONLINEARITIES.items():
        taken_out = velocity(**{name: UNLIMITED[name] for name in names}) - full
        alone = velocity(**UNLIMITED | {name: getattr(p, name) for name in names}) - linear
        found[told] = [float(100 * np.abs(c).max() / (0.1 * volts)) for c in (taken_out, alone)]
    return found
