"""Elasticities of power laws, and each nonlinearity alone by other solvers."""

import numpy as np
import pytest
from scipy.linalg import expm

from armbook.influences import NONLINEARITIES, effects, elasticities
from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import Region, affine
from armsim.methods import tableaux

P = AxisParameters.paper_x_axis()
T = np.linspace(0, 1, 2001)


def test_elasticities_of_power_laws_are_their_exponents():
    def measured(q):
        return np.array([q.M**2 * q.K_g, 3 / np.sqrt(q.K_g), q.B_a])

    found = elasticities(measured, P, ["M", "K_g"])
    assert found["M"] == pytest.approx([2, 0, 0], abs=1e-11)
    assert found["K_g"] == pytest.approx([1, -0.5, 0], abs=1e-11)


def velocity(p, volts):
    return simulate(p, volts, 1.0, method=tableaux.RK6, step_size=2e-6)(T)[1]


def linear(volts):
    """Velocity of the engaged arm without any limit, by the exponential of its matrix."""
    A, B, _ = affine(P.replace(H=0, F_0=0), Region(0, 0, 1, 0))
    bordered = np.zeros((8, 8))
    bordered[:7, :7], bordered[:7, 7] = A, B * volts
    step, state = expm(bordered * T[1]), np.eye(8)[7]
    found = [0.0]
    for _ in T[1:]:
        state = step @ state
        found.append(state[1])
    return np.array(found)


@pytest.mark.parametrize("volts", [10.0, 0.1])
def test_effects_by_other_solvers(volts):
    found, full, goal = effects(P, volts), velocity(P, volts), 0.1 * volts
    assert list(found) == list(NONLINEARITIES)
    far = {"V_L": 1e9, "V_M": 1e9}
    out = {"backlash": {"H": 0}, "static friction": {"F_0": 0}, "limits": far}
    alone = {"backlash": {"F_0": 0} | far, "static friction": {"H": 0} | far}
    alone["limits"] = {"H": 0, "F_0": 0}
    for name, (without, put_in) in found.items():
        taken = np.abs(velocity(P.replace(**out[name]), volts) - full).max()
        # 1 %: sampled ten times as seldom, with steps that do not land on events
        assert without == pytest.approx(100 * taken / goal, rel=1e-2)
        only = np.abs(velocity(P.replace(**alone[name]), volts) - linear(volts)).max()
        assert put_in == pytest.approx(100 * only / goal, rel=2e-2, abs=1e-3)
