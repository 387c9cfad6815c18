"""The step response of the nonlinear arm by DOP853 with located events, and its eigenvalues."""

import json

import numpy as np
from arm import (
    CURRENT,
    DATA,
    FREE,
    RISE,
    VELOCITY,
    changed,
    paper,
    state_matrix,
    steady,
    step,
)
from mpmath import mp
from scipy.linalg import expm
from scipy.optimize import brentq

VOLTS = 10.0  # V, which stand for 1 m/s
BAND, WIDE = 0.02, 0.05  # shares of the final velocity


def eigenvalues(p, region):
    """Eigenvalues of a region with 30 digits."""
    with mp.workdps(30):
        values = mp.eig(mp.matrix(state_matrix(p, region).tolist()), right=False)
        return np.array([complex(value) for value in values])


def oscillation(p, region, highest=200.0):
    """Frequency in Hz and decay rate of the least damped oscillation below a frequency."""
    values = eigenvalues(p, region)
    values = values[(values.imag > 1.0) & (values.imag < 2 * np.pi * highest)]
    least = values[values.real.argmax()]
    return least.imag / (2 * np.pi), -least.real


def slowest(p, region):
    """Smallest rate of decay; the position has none, and rounding leaves it a tiny one."""
    rates = -eigenvalues(p, region).real
    return rates[rates > 1e-6].min()


def elasticity(measure, name):
    """Relative change of a quantity for a relative change of a parameter."""
    p = paper()
    high, low = (measure(changed(p, **{name: factor * vars(p)[name]})) for factor in (1.01, 0.99))
    return np.log(high / low) / np.log(1.01 / 0.99)


def crossing(run, level, late):
    """The time at which the velocity passes a level, the last one before `late`, or the first."""
    t = np.linspace(0, run.t, 24_001)
    off = run(t)[1] - level
    found = np.flatnonzero(off[1:] * off[:-1] < 0)
    n = found[-1] if late else found[0]
    return brentq(lambda s: VELOCITY @ run(s)[:, 0] - level, t[n], t[n + 1], xtol=1e-13)


def settling(run, goal, band=BAND):
    """Last time at which the velocity is outside the band around its goal."""
    speed = run(np.linspace(0, run.t, 24_001))[1]
    side = np.sign(speed[np.abs(speed - goal) > band * goal][-1] - goal)
    return crossing(run, (1 + side * band) * goal, late=True)


def time_limited(run, t_end):
    """Time before `t_end` for which the preamplifier is at its limit."""
    ends = np.clip([*run.starts, run.t], 0, t_end)
    limited = [region.preamplifier != 0 for region in run.regions]
    return np.diff(ends) @ limited


def initial_slope(p):
    """Slope of a straight line through the velocity in the first tenth of a second."""
    t = np.linspace(0, 0.1, 1001)
    return np.polyfit(t, step(p, VOLTS, 0.1)(t)[1], 1)[0]


def current_while_limited(p):
    """Current at half of the time to 1 m/s while the preamplifier's limit holds, by the slow mode.

    The velocity rises as 1 - exp(-rate t) towards what the limit can sustain, and the current
    follows the back EMF at once.
    """
    loop = p.R_a + p.K_e / p.K_i
    unit = steady(changed(p, K_e=np.inf), 1.0)[0]  # motor current at 1 m/s
    final = p.K_e * p.V_L / (unit * loop + p.K_b / p.r_g)
    velocity = final * (1 - np.sqrt(1 - 1 / final))
    return (p.K_e * p.V_L - p.K_b * velocity / p.r_g) / loop


def published(p):
    """Values of the published run: a step of 10 V."""
    run, saturation = step(p, VOLTS, 1.2), p.K_i * p.V_L
    settled, arrival = settling(run, 1.0), crossing(run, 1.0, late=False)
    # after the last event the arm is linear: on to 6 s in one matrix exponential
    assert run.region == FREE and run.events[-1] < 0.9
    end = expm(run.tables(VOLTS)[0] * (6.0 - run.t)) @ run.z
    rising = CURRENT @ run(np.linspace(0, arrival, 100_001))
    rate, B, J = slowest(p, RISE), p.B_m + p.r_g**2 * p.B_a, p.J_m + p.r_g**2 * p.M
    slow = changed(p, K_e=100 * p.K_e)
    return {
        # integration at 1e-11, sharpened nowhere: six digits
        "share_at_limit": (100 * time_limited(run, settled) / settled, 1e-4),
        "current_share": (100 * CURRENT @ run(arrival / 2)[:, 0] / saturation, 1e-4),
        # one sample of 100 001 at each of the two ends
        "share_within_tenth": (100 * np.mean(rising >= 0.9 * saturation), 3e-3),
        # the transient has decayed by exp(-12 · 5) at 6 s; rounding is left
        "current_at_end": (CURRENT @ end, 1e-8),
        "steady_current": (steady(p, 1.0)[0], 1e-11),
        # the record reads it off the run, where the other modes are still at work: 1e-5
        "ringing_period": (1 / oscillation(p, FREE)[0], 1e-6),
        # a fit to the rise of a run meets the slow mode to 1e-5
        "rise_time_constant": (1 / rate, 1e-5),
        "friction_share": (100 * B / J / rate, 1e-2),
        # no start-up here, which takes milliseconds of a rise in which the current sinks by 0.1 %
        "current_share_large_K_e": (100 * current_while_limited(slow) / saturation, 1e-3),
    }


def modes(p):
    """Decay rates and elasticities from the eigenvalues."""
    smallest = changed(p, T_p=recorded("30_nonlinear_step_response", "smallest_T_p"))
    measures = {
        "gear_frequency": lambda q: oscillation(q, RISE)[0],
        "gear_decay": lambda q: oscillation(q, RISE)[1],
        "loop_decay": lambda q: oscillation(q, FREE)[1],
    }
    wanted = "gear_frequency K_g, gear_decay b_g, gear_decay K_2, loop_decay K_2"
    pairs = [pair.split() for pair in wanted.split(", ")]
    return {
        "decay_at_smallest_T_p": (oscillation(smallest, FREE)[1], 1e-8),
        "mode_decay": (oscillation(p, FREE)[1], 1e-8),
        "elasticity_rise_B_a": (elasticity(lambda q: slowest(q, RISE), "B_a"), 1e-3),
        # the slope is a straight line through 0.1 s of a run that is good to 1e-9
        "elasticity_slope_V_L": (elasticity(initial_slope, "V_L"), 1e-5),
        "elasticity_slope_K_2": (elasticity(initial_slope, "K_2"), 1e-5),
        "most_slope": (most(initial_slope, "M r_g K_b"), 1e-5),
        "most_rise": (most(lambda q: slowest(q, RISE), "M r_g K_b"), 1e-3),
        "most_gear_frequency": (most(measures["gear_frequency"], "M r_g J_m"), 4e-3),
        # the record fits the ringing of a run, these are of its mode: the decay rates, and so
        # their elasticities, differ by 0.3 %
        **{f"elasticity_{m}_{name}": (elasticity(measures[m], name), 4e-3) for m, name in pairs},
    }


def taken_out(p, volts):
    """Largest change of the velocity in per cent when one nonlinearity is taken out."""
    far, t = 1e9, np.linspace(0, 1, 20_001)
    without = {"backlash": {"H": 0.0}, "friction": {"F_0": 0.0}, "limits": {"V_L": far, "V_M": far}}
    full = step(p, volts, 1.0)(t)[1]
    return {
        name: 1000 / volts * np.abs(step(changed(p, **change), volts, 1.0)(t)[1] - full).max()
        for name, change in without.items()
    }


def most(measure, names):
    """Largest elasticity in size with some parameters; with the others it is smaller by far."""
    return max(abs(elasticity(measure, name)) for name in names.split())


def recorded(study, name):
    """A time constant at which the record measures something."""
    return json.loads((DATA / "expected" / f"{study}.json").read_text())[name]["value"]


def opinions():
    p = paper()
    found = published(p) | modes(p)
    for key, volts in (("large", VOLTS), ("small", 0.01 * VOLTS)):
        # largest of 20 001 samples, good to the curvature between them
        for name, change in taken_out(p, volts).items():
            found[f"without_{name}_{key}"] = change, 1e-4 * change
    found = {f"30_nonlinear_step_response::{name}": value for name, value in found.items()}
    measures = {
        "settled": lambda run: settling(run, 1.0),
        "wide": lambda run: settling(run, 1.0, WIDE),
        "arrival": lambda run: crossing(run, 1 - BAND, late=False),
    }
    for key, measure in measures.items():
        run = step(changed(p, T_p=recorded("20_linear_step_response", f"T_p_{key}")), VOLTS, 3.0)
        # ms; a root on the run here, in the record between samples 0.1 ms apart
        found[f"20_linear_step_response::limited_{key}"] = 1e3 * measure(run), 1e-3
    return found
