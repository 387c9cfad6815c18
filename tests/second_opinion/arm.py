"""The nonlinear arm, written anew from the model page and integrated with DOP853 between events.

The pinion-rack difference x is a state in place of the motor angle; states are in homogeneous
coordinates, so that every equation, force and guard is a row of numbers.
"""

import re
import tomllib
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

DATA = Path(__file__).resolve().parents[2] / "data"
PRINTED = "R_a L_a K_b J_m B_m K_t r_g H M T_z T_r K_2 K_i V_M V_L B_a b_g K_g".split()
POSITION, VELOCITY, PLAY, MOTOR, LAG, LAG_RATE, CURRENT, ONE = np.eye(8)


def read(name):
    return tomllib.loads((DATA / name).read_text(encoding="utf-8"))


def numbers(text):
    """Numbers in a printed value such as `80 to 870` or `$5.264 \\cdot 10^6$ N/m`."""
    text = re.sub(r"\$(.*?) \\cdot 10\^(\d+)\$", r"\1e\2", text)
    return [float(found) for found in re.findall(r"(?<![\w.])\d[\d.]*(?:e\d+)?", text)]


def printed(field):
    """Numbers printed for a parameter in Tables 3 to 5."""
    tables = read("paper/tables.toml")
    rows = [row for name in ("table3", "table4", "table5") for row in tables[name]]
    return next(
        numbers(row.get("value") or row["ndp"]) for row in rows if row.get("field") == field
    )


@cache
def paper():
    """Parameters of the x axis, with K_2 at its maximum and K_1 such that 10 V give 1 m/s."""
    values = {name: printed(name)[-1] for name in PRINTED}
    values |= {"T_p": read("axes/x.toml")["axis"]["T_p"]} | read("choices.toml")["axis"]["x"]
    p = SimpleNamespace(**values)
    return changed(p, K_1=gain(p))


def changed(p, **values):
    return SimpleNamespace(**vars(p) | values)


def steady(p, velocity):
    """Motor current, preamplifier output and motor velocity at a constant arm velocity."""
    motor = velocity / p.r_g
    current = (p.B_m * motor + p.r_g * p.B_a * velocity) / p.K_b
    voltage = p.R_a * current + p.K_b * motor
    return current, voltage / p.K_e + current / p.K_i, motor


def gain(p):
    """K_1 with which 10 V give 1 m/s."""
    _, output, motor = steady(p, 1.0)
    return (output + p.K_2 * p.K_t * motor) / 10.0


class Region(NamedTuple):
    """Which equations hold; friction is 0 at rest, ±1 below v_s and ±2 above it."""

    preamplifier: int
    power: int
    contact: int
    friction: int


REST = Region(0, 0, 0, 0)
RISE, FREE = Region(1, 0, 1, 2), Region(0, 0, 1, 2)  # preamplifier limited; nothing limited


def gear_force(p, region):
    if region.contact == 0:
        return 0 * ONE
    return (PLAY - region.contact * p.H * ONE) * p.K_g + (p.r_g * MOTOR - VELOCITY) * p.b_g


def amplifiers(p, region):
    """Preamplifier output before its limit; motor voltage before and after its limit."""
    output = LAG + p.T_z * LAG_RATE
    limited = region.preamplifier * p.V_L * ONE if region.preamplifier else output
    wanted = p.K_e * (limited - CURRENT / p.K_i)
    return output, wanted, region.power * p.V_M * ONE if region.power else wanted


def equations(p, region, volts):
    """Matrix (8, 8) of the state equations in homogeneous coordinates."""
    force, (_, _, voltage) = gear_force(p, region), amplifiers(p, region)
    friction = p.F_0 * region.friction * ONE if abs(region.friction) == 1 else 0 * ONE
    drive = p.K_1 * volts * ONE - p.K_2 * p.K_t * MOTOR
    return np.array([
        VELOCITY,
        (force - p.B_a * VELOCITY - friction) / p.M if region.friction else 0 * ONE,
        p.r_g * MOTOR - VELOCITY,
        (p.K_b * CURRENT - p.B_m * MOTOR - p.r_g * force) / p.J_m,
        LAG_RATE,
        (drive - LAG - (p.T_p + p.T_r) * LAG_RATE) / (p.T_p * p.T_r),
        (voltage - p.R_a * CURRENT - p.K_b * MOTOR) / p.L_a,
        0 * ONE,
    ])  # fmt: skip


def limiter(name, value, limit, state):
    """Guards of a variable with two limits: rows that become positive, and what follows."""
    if state:
        return [(limit * ONE - state * value, {name: 0})]
    return [(side * value - limit * ONE, {name: side}) for side in (1, -1)]


def friction_guards(p, region):
    if region.friction == 0:
        force = gear_force(p, region)
        return [(side * force - p.F_0 * ONE, {"friction": side}) for side in (1, -1)]
    side = 1 if region.friction > 0 else -1
    speed = side * VELOCITY
    if abs(region.friction) == 2:
        return [(p.v_s * ONE - speed, {"friction": side})]
    return [(speed - p.v_s * ONE, {"friction": 2 * side}), (-speed, {"friction": 0})]


def guards(p, region):
    """Rows of all guards of a region, and the changes of region that they announce."""
    output, wanted, _ = amplifiers(p, region)
    found = [
        *limiter("preamplifier", output, p.V_L, region.preamplifier),
        *limiter("power", wanted, p.V_M, region.power),
        *(limiter("contact", PLAY, p.H, region.contact) if p.H else ()),
        *friction_guards(p, region),
    ]
    rows, changes = zip(*found, strict=True)
    return np.array(rows), changes


class Run:
    """A run from rest: advanced from event to event, and evaluated by dense output."""

    WITHIN = np.array([0, 1e-4, 1e-3, 1e-2, 0.06, *np.linspace(0, 1, 9)[1:]])  # parts of a step

    def __init__(self, p, rtol=1e-11):
        self.p, self.rtol = p, rtol
        # without play the teeth never part, and both flanks have the same equations
        self.region = REST if p.H else REST._replace(contact=1)
        self.t, self.z = 0.0, ONE.copy()
        self.starts, self.pieces, self.regions, self.events = [], [], [], []
        self.known = {}

    def tables(self, volts):
        """Equations and guards of the present region."""
        key = self.region, volts
        if key not in self.known:
            matrix = equations(self.p, self.region, volts)
            self.known[key] = matrix, *guards(self.p, self.region)
        return self.known[key]

    def advance(self, volts, t_end):
        while self.t < t_end:
            self.to_event(volts, t_end)
        return self

    def to_event(self, volts, t_end):
        """Integrate until a guard becomes positive or the time is over."""
        matrix, rows, changes = self.tables(volts)
        # absolute tolerances: a hundredth of the relative one, for states of about these sizes
        atol = 1e-2 * self.rtol * np.array([1, 1, 1e-4, 100, 10, 1e3, 1, 1])
        solver = DOP853(lambda _, z: matrix @ z, self.t, self.z, t_end, rtol=self.rtol, atol=atol)
        while solver.status == "running":
            solver.step()
            piece = solver.dense_output()
            self.starts.append(piece.t_old)
            self.pieces.append(piece)
            self.regions.append(self.region)
            times = piece.t_old + self.WITHIN * (piece.t - piece.t_old)
            positive = (rows @ piece(times))[:, 1:] > 0
            if positive.any():
                found = [
                    (self.root(rows[n], piece, *times[k : k + 2]), n)
                    for n, k in enumerate(positive.argmax(axis=1))
                    if positive[n, k]
                ]
                time, n = min(found)
                return self.switch(time, piece(time), changes[n])
        self.t, self.z = solver.t, solver.y

    @staticmethod
    def root(row, piece, early, late):
        """Time between two times at which a guard becomes positive."""
        if row @ piece(early) >= 0:  # by rounding: the run has just come from there
            return early
        return brentq(lambda t: row @ piece(t), early, late, xtol=1e-18, rtol=1e-15)

    def switch(self, time, state, change):
        """Go on from a state in the region behind a guard."""
        self.t, self.z, self.region = time, state, self.region._replace(**change)
        self.events.append(time)
        if change.get("friction") == 0:
            state[VELOCITY.argmax()] = 0.0
        force = gear_force(self.p, self.region) @ state
        if self.region.friction == 0 and abs(force) > self.p.F_0:  # friction cannot hold the arm
            self.region = self.region._replace(friction=1 if force > 0 else -1)

    def __call__(self, times):
        """States (8, n) at increasing times."""
        times = np.atleast_1d(times)
        index = np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, None)
        states = np.empty((8, times.size))
        for n in np.unique(index):
            states[:, index == n] = self.pieces[n](times[index == n])
        return states


def step(p, volts, t_end):
    """Step response from rest."""
    return Run(p).advance(volts, t_end)


def state_matrix(p, region):
    """Matrix (7, 7) of a region without the constant terms."""
    return equations(p, region, 0.0)[:7, :7]
