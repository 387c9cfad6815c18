"""Errors of RK5, RK6 and DP4 on the arm: fixed steps as affine maps, against exact matrix exponentials.

Where every stage of a step lies in the same region, the step is an affine map of the state, and many
steps are powers of one matrix. The other steps, at the events, are made stage by stage.
"""

import re
from fractions import Fraction
from functools import cache

import numpy as np
from arm import (
    CURRENT, FREE, ONE, REST, Region, amplifiers, changed, equations, gain, gear_force, guards, paper,
    read, step,
)  # fmt: skip
from move import linear_matrix
from scipy.linalg import expm

VOLTS, T_END, LINEAR_END = 10.0, 1.0, 0.02  # V, s, s
START = 2e-3  # s, after which the start is over
SIZES = np.geomspace(9e-5, 5e-6, 40)  # s
PAIRS = {"RK6_RK5": ("RK6", "RK5"), "DP4_RK6": ("DP4", "RK6")}
# what the report corrects in the printed tableaux: {(stage, slope): coefficient}
NOVEL = {(5, 1): Fraction(19372, 6561), (6, 3): Fraction(46732, 5247)}
METHODS = {
    "RK5": ("rk5", {(6, 1): Fraction(-3, 7)}),
    "RK6": ("rk6", {(7, 3): Fraction(43, 156)}),
    "DP5": ("ndp5", NOVEL),
    "DP4": ("ndp6", NOVEL),
}


def coefficients(formula):
    """Coefficients of the slopes k_1, k_2, … in a printed formula."""
    text = formula.split(r"(n\tau)", 1)[1]
    factor = re.search(r"\\frac\{(\d+)\}\{(\d+)\}\[", text)
    text = re.sub(r"\\frac\{\d+\}\{\d+\}\[|\\left|\\right|\\exp|\^i\b|\^\{ij\}|[()\[\] ]", "", text)
    text = re.sub(r"\\frac\{(k_\d)\}\{(\d+)\}", r"\\frac{1}{\2}\1", text)
    terms = re.findall(r"([+-]?)(?:\\frac\{(-?\d+)\}\{(\d+)\}|(\d+))?k_(\d)", text)
    scale = Fraction(int(factor[1]), int(factor[2])) if factor else 1
    return {
        int(k): scale * int(sign + "1") * Fraction(int(top or whole or 1), int(bottom or 1))
        for sign, top, bottom, whole, k in terms
    }


@cache
def tableau(name):
    """Stages (s, s) and weights (s,) of a method."""
    printed, corrections = METHODS[name]
    table = read("paper/tableaux.toml")[printed]
    size = len(table["stages"])
    a, b = np.zeros((size, size)), np.zeros(size)
    for i, formula in enumerate(table["stages"]):
        for j, value in coefficients(formula.replace("f'", "")).items():
            a[i, j - 1] = corrections.get((i + 1, j), value)
    for j, value in coefficients(table["weights"]).items():
        b[j - 1] = value
    assert abs(b.sum() - 1) < 1e-12
    return a, b


def stage_maps(a, b, h, matrix):
    """Matrices that take a state to the stages (s, n, n) of a step, and to the end of it (n, n)."""
    stages, slopes, one = [], [], np.eye(len(matrix))
    for row in a:
        stages.append(one + sum(x * slope for x, slope in zip(row, slopes, strict=False)))
        slopes.append(h * matrix @ stages[-1])
    return np.array(stages), one + np.tensordot(b, slopes, 1)


def powers(matrix, state, count):
    """States (count + 1, n) after 0, 1, …, count steps of a linear map, by doubling."""
    states = state[None]
    while len(states) <= count:
        states, matrix = np.concatenate([states, states @ matrix.T]), matrix @ matrix
    return states[: count + 1]


def side(value, limit):
    return int(value > limit) - int(value < -limit)


def region_of(p, z):
    """The region in which a state lies."""
    inner = Region(0, 0, side(z[2], p.H), 0)
    preamplifier = side(amplifiers(p, inner)[0] @ z, p.V_L)
    inner = inner._replace(preamplifier=preamplifier)
    power = side(amplifiers(p, inner)[1] @ z, p.V_M)
    slow = 1 if abs(z[1]) < p.v_s else 2
    # at rest, static friction holds what it can
    friction = slow * side(z[1], 0.0) or side(gear_force(p, inner) @ z, p.F_0)
    return inner._replace(power=power, friction=friction)


class FixedSteps:
    """A fixed-step method on the nonlinear arm."""

    def __init__(self, p, method, h):
        self.p, self.h, (self.a, self.b), self.known = p, h, tableau(method), {}

    def step(self, z):
        """One step, stage by stage, and the regions of its stages."""
        slopes, regions = [], []
        for row in self.a:
            stage = z + sum(x * slope for x, slope in zip(row, slopes, strict=False))
            regions.append(region_of(self.p, stage))
            slopes.append(self.h * equations_in(regions[-1]) @ stage)
        return z + self.b @ slopes, set(regions)

    def maps(self, region):
        """The step inside a region as a matrix, and the guards at all of its stages."""
        if region not in self.known:
            stages, whole = stage_maps(self.a, self.b, self.h, equations_in(region))
            self.known[region] = whole, (guards(self.p, region)[0] @ stages).reshape(-1, 8)
        return self.known[region]

    def inside(self, region, z, count):
        """States of at most `count` steps, all stages of which lie inside the region."""
        whole, rows = self.maps(region)
        states = powers(whole, z, count)
        outside = (states[:-1] @ rows.T > 0).any(axis=1)
        return states[1 : outside.argmax() + 1] if outside.any() else states[1:]

    def run(self, count):
        """States (count + 1, 8) from rest."""
        states = np.empty((count + 1, 8))
        states[0], n, stretch = ONE, 0, 8
        while n < count:
            states[n + 1], regions = self.step(states[n])
            n += 1
            while len(regions) == 1 and n < count:
                wanted = min(stretch, count - n)
                found = self.inside(*regions, states[n], wanted)
                states[n + 1 : n + 1 + len(found)] = found
                n += len(found)
                stretch = min(4 * stretch, 4096) if len(found) == wanted else 8
                if len(found) < wanted:
                    break
        return states


@cache
def equations_in(region):
    return equations(paper(), region, VOLTS)


class Exact:
    """The exact run: states at its events by DOP853, and matrix exponentials from there."""

    def __init__(self, p, t_end):
        run = step(p, VOLTS, t_end)
        first = [n for n, t in enumerate(run.starts) if t in (0.0, *run.events)]
        self.times = np.array([*(run.starts[n] for n in first), np.inf])
        self.states = [run.pieces[n](run.starts[n]) for n in first]
        self.regions = [run.regions[n] for n in first]
        fine = np.union1d(np.linspace(0, t_end, 20_001), np.linspace(0, START, 2001))
        self.largest = np.abs(states_of_paper(run(fine).T)).max(axis=0)

    def __call__(self, h, count):
        """States (count + 1, 8) at 0, h, 2 h, …"""
        states = np.empty((count + 1, 8))
        steps = np.clip(np.ceil(self.times / h), 0, count + 1).astype(int)
        pieces = zip(steps, steps[1:], self.times, self.states, self.regions, strict=False)
        for n, end, t, state, region in pieces:
            if n < end:
                matrix = equations_in(region)
                start = expm(matrix * (n * h - t)) @ state
                states[n:end] = powers(expm(matrix * h), start, end - n - 1)
        return states


def states_of_paper(z):
    """The seven states (n, 7), with the motor angle in place of the play."""
    y = z[:, :7].copy()
    y[:, 2] = (z[:, 2] + z[:, 0]) / paper().r_g
    return y


def norms(t, errors):
    """Each norm of relative errors (n, 7) at the steps."""
    rms = np.sqrt(np.trapezoid(errors**2, t, axis=0) / t[-1])
    late = errors[t > START].max()
    return {
        "whole": errors.max(), "late": late, "rms": rms.max(), "motion": errors[:, :2].max(),
        "end": errors[-1].max(),
    }  # fmt: skip


def nonlinear_errors(exact, sizes):
    """Norms of the errors {norm: {method: [one for each size]}}."""
    found = {}
    for h in sizes:
        count = int(T_END / h + 1e-9)
        truth, t = exact(h, count), h * np.arange(count + 1)
        for name in ("RK5", "RK6", "DP4"):
            off = states_of_paper(FixedSteps(paper(), name, h).run(count) - truth)
            for norm, value in norms(t, np.abs(off) / exact.largest).items():
                found.setdefault(norm, {}).setdefault(name, []).append(value)
    return found


def linear_errors():
    """Largest relative errors of position, velocity and current of the linear arm."""
    p = paper()
    matrix, start = linear_matrix(p), np.array([0.0, 0, 0, 0, VOLTS])
    outputs = np.array([[1.0, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 1, p.T_z, 0]])
    found = {}
    for h in SIZES:
        count = int(LINEAR_END / h + 1e-9)
        truth = powers(expm(h * matrix), start, count) @ outputs.T
        for name in ("RK5", "RK6", "DP4"):
            _, whole = stage_maps(*tableau(name), h, matrix)
            off = np.abs(powers(whole, start, count) @ outputs.T - truth).max(axis=0)
            found.setdefault(name, []).append((off / np.abs(truth).max(axis=0)).max())
    return found


def compared(errors):
    """How two methods compare: {pair: (median ratio, share of sizes with the first ahead in %)}."""
    found = {}
    for pair, names in PAIRS.items():
        one, other = (np.array(errors[name]) for name in names)
        ratio = (one / other)[np.minimum(one, other) > 1e-9]
        found[pair] = np.median(ratio), 100 * (ratio < 1).mean(), ratio.min(), ratio.max()
    return found
