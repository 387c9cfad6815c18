"""What the step response depends on: elasticities, and one nonlinearity at a time."""

from collections.abc import Callable, Iterable

import numpy as np

from armsim.arm import AxisParameters, simulate
from armsim.arm.linear import UNLIMITED

#: The parameters that make each nonlinearity.
NONLINEARITIES = {"backlash": ["H"], "static friction": ["F_0"], "limits": ["V_L", "V_M"]}


def elasticities(
    measured: Callable[[AxisParameters], np.ndarray],
    p: AxisParameters,
    names: Iterable[str],
    change: float = 0.01,
) -> dict[str, np.ndarray]:
    """Relative changes of quantities for a relative change of each of some parameters.

    Parameters
    ----------
    measured : callable
        Returns the quantities (n,) of an axis.
    p : AxisParameters
        The axis.
    names : iterable of str
        Its parameters.
    change : float
        Each is made larger and smaller by this share.

    Returns
    -------
    dict
        By parameter, d log(quantity) / d log(parameter) of each quantity.
    """

    def with_factor(name: str, factor: float) -> np.ndarray:
        return measured(p.replace(**{name: factor * getattr(p, name)}))

    more, less = 1 + change, 1 - change
    return {
        name: np.log(with_factor(name, more) / with_factor(name, less)) / np.log(more / less)
        for name in names
    }


def effects(p: AxisParameters, volts: float) -> dict[str, tuple[float, float]]:
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

    def apart(one: np.ndarray, other: np.ndarray) -> float:
        return float(100 * np.abs(one - other).max() / (0.1 * volts))

    full, linear, found = velocity(), velocity(**UNLIMITED), {}
    for told, names in NONLINEARITIES.items():
        without = velocity(**{name: UNLIMITED[name] for name in names})
        alone = velocity(**UNLIMITED | {name: getattr(p, name) for name in names})
        found[told] = apart(without, full), apart(alone, linear)
    return found
