"""Reference solutions of the nonlinear arm to 35 digits, with proof: see README.md.

All numbers are balls: a midpoint, and a radius that provably covers every rounding and truncation
error. The package is asked for parameter values only; the equations stand here a second time.
"""

import argparse
import dataclasses
import json
import math
import time
from collections import namedtuple
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from flint import arb, arb_mat, arb_poly, ctx, fmpq

from armsim.arm import AxisParameters, simulate
from armsim.methods import tableaux

Region = namedtuple("Region", "preamplifier power contact friction")  # -1, 0, +1; friction also
STUCK = 2  # static friction holds the arm at rest, y1 = 0
AT_REST = [0.0] * 7, Region(0, 0, 0, STUCK)
VOLTS = [round(10240 * math.sin(4 * math.pi * (0.005 * k))) / 1024 for k in range(200)]

Scenario = namedtuple("Scenario", "changes set_velocity t_end y_initial region", defaults=AT_REST)
SCENARIOS = {
    "published_step": Scenario({}, [(0.0, 10.0)], 1.0),
    "wide_backlash": Scenario({"H": 1e-3, "F_0": 400.0, "v_s": 0.05}, [(0.0, 10.0)], 1.0),
    "reversal": Scenario({}, [(0.0, 8.0), (0.3, -8.0)], 0.9),
    "stop_in_sticking": Scenario({"F_0": 60.0}, [(0.0, 3.0), (0.25, 0.0)], 1.2),
    "sampled_input": Scenario({}, [(0.005 * k, u) for k, u in enumerate(VOLTS)], 1.0),
    "stick_slip": Scenario(  # starts in motion, on the negative flank of a lightly damped gear
        {"b_g": 40.0, "H": 1e-4, "F_0": 150.0, "v_s": 0.02},
        [(0.0, 1.0), (0.15, -1.0), (0.3, 1.0)],
        0.5,
        [0.0, 0.1, -0.02, -10.0, 0.0, 0.0, 2.0],
        Region(0, 0, -1, 0),
    ),
}


def model(p, region, volts, side):
    """Write eq. (10)-(15) in one region as linear forms in z = (y0, ..., y6, 1), in fractions.

    Parameters
    ----------
    p : namespace of Fractions
        Parameters, the exact values of the 64-bit floats.
    region : Region
        Branch of each nonlinearity.
    volts : Fraction
        Set velocity U.
    side : int
        Sign of y1, needed where static friction has vanished.

    Returns
    -------
    rates : (8, 8) array
        Of dz/dt.
    guards : dict
        Forms that are positive inside the region, by (name, sign) of the surface that they watch.
    f_g : (8,) array
        Gear force.
    """
    *y, one = np.array([[Fraction(i == j) for j in range(8)] for i in range(8)])
    preamplifier, power, contact, friction = region

    v_c_free = y[4] + p.T_z * y[5]  # (11)
    v_c = preamplifier * p.V_L * one if preamplifier else v_c_free
    v_m_free = p.K_e * (v_c - y[6] / p.K_i)  # (12)
    v_m = power * p.V_M * one if power else v_m_free
    x = p.r_g * y[2] - y[0]  # (13)
    f_g = (x - contact * p.H * one) * p.K_g + (p.r_g * y[3] - y[1]) * p.b_g  # (14)
    f_g = f_g if contact else 0 * one
    F_s = f_g - p.B_a * y[1] if friction == STUCK else friction * p.F_0 * one  # (15)
    lags = p.K_1 * volts * one - p.K_2 * p.K_t * y[3] - y[4] - (p.T_p + p.T_r) * y[5]
    rates = [  # (10), its misprints corrected: y5 is divided by T_p T_r, the motor's inertia is J_m
        y[1],
        (-p.B_a * y[1] - F_s + f_g) / p.M,
        y[3],
        (-p.B_m * y[3] - p.r_g * f_g + p.K_b * y[6]) / p.J_m,
        y[5],
        lags / (p.T_p * p.T_r),
        (v_m - p.R_a * y[6] - p.K_b * y[3]) / p.L_a,
        0 * one,
    ]

    guards = {}
    limits = (v_c_free, p.V_L), (v_m_free, p.V_M), (x, p.H)
    for name, branch, (form, limit) in zip(Region._fields, region, limits, strict=False):
        if branch:
            guards[name, branch] = branch * form - limit * one
        else:
            guards |= {(name, sign): limit * one - sign * form for sign in (1, -1)}
    if friction == STUCK:
        guards |= {("hold", sign): p.F_0 * one - sign * f_g for sign in (1, -1)}
    elif friction:
        guards["speed", friction] = p.v_s * one - friction * y[1]
        guards["rest", 0] = friction * y[1]
    else:
        guards["speed", side] = side * y[1] - p.v_s * one
    return np.array(rates), guards, f_g


def beyond(p, region, key, z):
    """Region beyond the surface reached, and the order of the zero of guards that vanish there."""
    name, sign = key
    stuck = region.friction == STUCK
    if name == "hold":  # |f_g| has reached F_0: the arm starts with zero velocity and acceleration
        return region._replace(friction=sign), {("rest", 0): 2}
    if name == "speed":
        return region._replace(friction=0 if region.friction else sign), {key: 1}
    if name != "rest":
        region = region._replace(**{name: 0 if getattr(region, name) else sign})
    if name == "rest" or (name == "contact" and stuck):  # f_g, now known, decides on sticking
        f_g = (matrix([model(p, region, 0, 0)[2]]) * z)[0, 0]
        slips = region.contact and sign_of(abs(f_g) - matrix([[p.F_0]])[0, 0]) > 0
        return region._replace(friction=sign_of(f_g) if slips else STUCK), {key: 1, ("rest", 0): 1}
    return region, {key: 1}


def matrix(rows):
    """Matrix of balls around fractions."""
    return arb_mat([[arb(fmpq(v.numerator, v.denominator)) for v in row] for row in rows])


def absolute(a):
    """Matrix of absolute values."""
    return arb_mat([[abs(v) for v in row] for row in a.tolist()])


def largest(values):
    """Upper bound of some balls."""
    return max(v.upper() for v in values)


def sign_of(value):
    """Sign of a ball; one that reaches zero is an error."""
    if not (value > 0 or value < 0):
        raise ArithmeticError(f"the sign of {value.str(5)} is not certain; raise the precision")
    return 1 if value > 0 else -1


class Piece:
    """Motion in one region under one input, z(t) = exp(A t) z, where t counts from its start.

    `zeros` gives, for guards that are exactly zero at the start, the order of that zero.
    """

    def __init__(self, p, region, volts, start, z, zeros):
        rates, guards, _ = model(p, region, volts, 0 if region.friction else sign_of(z[1, 0]))
        self.region, self.start, self.z, self.zeros = region, start, z, zeros
        self.A, self.keys = matrix(rates), list(guards)
        # Guards, then their rates of change: d/dt (form @ z) = form @ rates @ z.
        self.forms = matrix([*guards.values(), *(form @ rates for form in guards.values())])
        # Weights d that make the norm max_i (|A| d)_i / d_i of A nearly as small as it can be.
        a = abs(rates.astype(float))
        a /= 1.2 * max(abs(np.linalg.eigvals(a)))
        self.d = arb_mat([[abs(float(v))] for v in np.linalg.solve(np.eye(8) - a, np.ones(8))])
        self.norm = self.size(absolute(self.A) * self.d)
        for key, value in zip(self.keys, (self.forms * z).entries(), strict=False):
            if not (value.contains(0) if key in zeros else value > 0):
                raise ArithmeticError(f"t = {start.str(9)}: guard {key} is {value.str(9)}")

    def size(self, z):
        """Upper bound of the norm max_i |z_i| / d_i."""
        return largest(abs(v) / d for v, d in zip(z.entries(), self.d.entries(), strict=True))

    def state(self, t):
        """State z at the time `t`, in one step from the start."""
        return (self.A * t).exp() * self.z

    def series(self, z, h):
        """Taylor series of guards and their rates, for times from 0 to `h` after the state `z`.

        The last coefficient is a ball that covers the remainder: from there on the terms fall at
        least as fast as a geometric series of ratio norm h / (n + 1).
        """
        terms, n, scale = [z], 0, arb(1)
        while not scale < arb(2) ** (-ctx.prec - 64):
            n += 1
            scale *= self.norm * h / n
            terms.append(self.A * terms[-1] / n)
        last = self.size(terms.pop()) / (1 - self.norm * h / (n + 1))
        rows = (self.forms * arb_mat([t.entries() for t in terms]).transpose()).tolist()
        bounds = (absolute(self.forms) * self.d * last).entries()
        rows = [[*row, (-b).union(b)] for row, b in zip(rows, bounds, strict=True)]
        return zip(self.keys, rows, rows[len(self.keys) :], strict=False)

    def first_event(self, end, step):
        """Time and key of the first zero of a guard before the time `end`, or None."""
        offset = arb(0)
        while not offset >= end:
            roots = []
            z = self.state(offset) if offset > 0 else self.z
            for n, (key, row, rates) in enumerate(self.series(z, step * 1.01)):
                g, rate, order = arb_poly(row), arb_poly(rates), self.zeros.get(key, 0)
                divided = arb_poly(row[order:]) if order and offset == 0 else None
                if bracket := first_root(g, rate, arb(0), step, divided):
                    root = refined(g, rate, *bracket)
                    middle = offset + root.mid()  # one more Newton step, past the series' rounding
                    value = (self.forms * self.state(middle))[n, 0]
                    roots.append((middle - value / rate(root), key))
            if roots:
                first = min(roots, key=lambda item: item[0].mid())
                for root, key in roots:  # an error if the order of events is not certain
                    assert key == first[1] or sign_of(root - first[0]) > 0
                return first if sign_of(end - first[0]) > 0 else None
            offset += step
        return None


def first_root(g, rate, a, b, divided):
    """Bracket the first zero of a guard in (a, b], or prove that there is none.

    Parameters
    ----------
    g, rate : arb_poly
        Guard, positive at or just after `a`, and its rate of change.
    a, b : arb
        Exact ends of the interval.
    divided : arb_poly or None
        g(t) / t^k if g has a zero of order k at t = 0.

    Returns
    -------
    (arb, arb) or None
        Interval on which g falls strictly, from positive to negative; None proves g > 0 on (a, b].
    """
    inside, middle = a.union(b), (a + b) / 2
    if divided and a == 0:
        if divided(inside) > 0:
            return None
    else:
        slope = rate(inside)
        if slope > 0 or g(middle) + slope * (inside - middle) > 0:
            return None
        if slope < 0:
            return None if sign_of(g(b)) > 0 else (a, b)
    if b - a < arb(2) ** -80:
        raise ArithmeticError("a guard stays undecided; raise the precision")
    left = first_root(g, rate, a, middle, divided)
    return left or first_root(g, rate, middle, b, divided)


def refined(g, rate, a, b):
    """Enclose the zero of a falling guard in [a, b]: bisection, then Newton's method in balls."""
    for _ in range(20):
        middle = (a + b) / 2
        a, b = (middle, b) if sign_of(g(middle)) > 0 else (a, middle)
    root, better = None, a.union(b)
    while root is None or better.rad() < root.rad() / 2:
        root, middle = better, better.mid()
        better = (middle - g(middle) / rate(root)).intersection(root)
    return better


def solve(p, scenario, step):
    """Pieces of a run, in order of time, and its events: (time, guard, before, after, z)."""
    z = arb_mat([[v] for v in [*scenario.y_initial, 1.0]])
    region, start, pieces, events = scenario.region, arb(0), [], []
    stops = [*(t for t, _ in scenario.set_velocity[1:]), scenario.t_end]
    for (_, volts), stop in zip(scenario.set_velocity, stops, strict=True):
        found, zeros = True, {}
        while found:
            piece = Piece(p, region, Fraction(volts), start, z, zeros)
            pieces.append(piece)
            found = piece.first_event(stop - start, step)
            if not found:
                start, z = arb(stop), piece.state(stop - start)
                continue
            start, z = start + found[0], piece.state(found[0])
            if (key := found[1])[0] == "rest":
                z[1, 0] = 0
            region, zeros = beyond(p, region, key, z)
            events.append((start, key[0], piece.region, region, z))
            print(f"  {float(start):.9f} s  {key[0]:13}{[*piece.region]} -> {[*region]}")
    return pieces, events


def document(scenario, precision, step):
    """Solve a scenario; return what its file holds (README.md)."""
    ctx.prec = precision
    parameters = dataclasses.asdict(AxisParameters.paper_x_axis(**scenario.changes))
    p = SimpleNamespace(**{name: Fraction(value) for name, value in parameters.items()})
    pieces, events = solve(p, scenario, arb(step))

    times = {k * scenario.t_end / 200 for k in range(201)}
    for t in (float(event[0]) for event in events):  # the floats around each event, and one later
        times |= {math.nextafter(t, 0), t, math.nextafter(t, 2), t + 1e-5}
    times = sorted(t for t in times if t <= scenario.t_end)
    ends = [*(piece.start for piece in pieces[1:]), arb(scenario.t_end)]
    spans = list(zip(pieces, ends, strict=True))
    within = [next(piece for piece, end in spans if piece.start <= t <= end) for t in times]
    states = [piece.state(t - piece.start) for piece, t in zip(within, times, strict=True)]

    def decimals(z):
        return [v.mid().str(35, radius=False) for v in z.entries()[:7]]

    def radius(balls):  # of the printed decimals around the exact values, rounded up
        errors = [abs(arb(v.mid().str(35, radius=False)) - v) for v in balls]
        return f"{1.01 * float(largest([arb(0), *errors])):.2e}"

    fields = "time", "guard", "before", "after", "y"
    story = [(t.mid().str(35, radius=False), *rest, decimals(z)) for t, *rest, z in events]
    return {
        "parameters": parameters,
        "set_velocity": scenario.set_velocity,
        "t_end": scenario.t_end,
        "y_initial": scenario.y_initial,
        "mode_initial": scenario.region,
        "event_time_radius": radius(event[0] for event in events),
        "y_largest": [float(largest(abs(z[i, 0]) for z in states)) for i in range(7)],
        "y_radius": [radius([z[i, 0] for z in states]) for i in range(7)],
        "events": [dict(zip(fields, event, strict=True)) for event in story],
        "samples": [{"t": t, "y": decimals(z)} for t, z in zip(times, states, strict=True)],
    }


def text(content):
    """JSON with one line for each event and each sample."""
    lines = [f'"{name}": {json.dumps(value)}' for name, value in content.items()]
    return "{\n" + ",\n".join(lines).replace("}, {", "},\n  {") + "\n}\n"


def distance(content):
    """Largest distance to a Runge-Kutta run of the package, relative to each state's maximum."""
    p = AxisParameters(**content["parameters"])
    options = {"method": tableaux.RK6, "step_size": 1e-6, "y0": content["y_initial"]}
    run = simulate(p, content["set_velocity"], content["t_end"], **options)
    y = np.array([sample["y"] for sample in content["samples"]], dtype=float).T
    error = abs(run(np.array([sample["t"] for sample in content["samples"]])) - y)
    return error.max(axis=1) / content["y_largest"]


def main():
    """Write the files, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", nargs="*", help=f"{', '.join(SCENARIOS)}; all if left out")
    parser.add_argument("--verify", action="store_true", help="check the files, write nothing")
    arguments = parser.parse_args()
    for name in arguments.scenario or SCENARIOS:
        began, file = time.perf_counter(), Path(__file__).with_name(f"{name}.json")
        print(name, flush=True)
        precision, step = (1400, 3 * 2.0**-14) if arguments.verify else (1024, 2.0**-12)
        content = document(SCENARIOS[name], precision, step)
        if not arguments.verify:
            file.write_text(text(content), encoding="utf-8")
        elif text(content) != file.read_text(encoding="utf-8"):
            raise SystemExit(f"{file.name}: another step and precision give other digits")
        else:
            print("  distance to Runge-Kutta:", *(f"{v:.0e}" for v in distance(content)))
        print(f"  {len(content['events'])} events, {time.perf_counter() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
