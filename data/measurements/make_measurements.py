"""Make the synthetic records of this folder again: python data/measurements/make_measurements.py.

A motion with the true parameters of ``truth.toml`` is seen through an instrument: white noise, bias
and drift of the accelerometer, an encoder and converters of limited resolution.
"""

import sys
import tomllib
from pathlib import Path

import numpy as np
from numba import njit

from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import constants, rhs
from armsim.arm.files import read_axis, write_measurement
from armsim.arm.measurement import Measurement, signals
from armsim.arm.slave_control import SlaveControl, Track
from armsim.methods import integrate, tableaux

HERE = Path(__file__).resolve().parent
TRUTH = tomllib.loads((HERE / "truth.toml").read_text(encoding="utf-8"))

TEST, MOVE = "Test run", "Programmed move"
STRAIGHT = "viscous friction in proportion to the speed, as in the model"
CURVED = "viscous friction curved with the speed, which the model does not have"
HEAD = """\
SYNTHETIC: computed by make_measurements.py, not measured.
{what} of the x axis; {friction}.
True parameters, instrument and seed: truth.toml. Constants of the axis: data/axes/x.toml."""


def true_axis() -> AxisParameters:
    axis, _ = read_axis(HERE.parent / "axes" / "x.toml")
    return axis.replace(K_1=axis.K_1, **TRUTH["axis"])


def run() -> tuple[np.ndarray, np.ndarray]:
    """Times of the samples and the set velocity from each on."""
    r = TRUTH["run"]
    t = np.round(np.arange(round(r["end"] / r["interval"]) + 1) * r["interval"], 9)
    return t, np.where((t >= r["start"]) & (t < r["stop"]), 10.0, 0.0)


def programmed_move(p: AxisParameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times of the samples, set velocity from each on and states of the programmed move."""
    m, law = TRUTH["move"], dict(TRUTH["control"])
    track = Track.trapezoid(*(law.pop(name) for name in ("distance", "velocity", "acceleration")))
    t = np.round(np.arange(round(m["end"] / m["interval"]) + 1) * m["interval"], 9)
    run = simulate(p, control=SlaveControl(track=track, **law), t_end=t[-1])
    return t, run.set_velocity(t + 1e-9), run(t)  # at a sample, what it puts out


@njit
def curved_rhs(t, y, volts, k, B_2, per_M):
    """The state equations with B_2 (|v| - 1) v more friction."""
    d0, d1, d2, d3, d4, d5, d6 = rhs(t, y, volts, k)
    return d0, d1 - B_2 * (abs(y[1]) - 1) * y[1] * per_M, d2, d3, d4, d5, d6


def curved_states(p: AxisParameters, t: np.ndarray) -> np.ndarray:
    """States at the samples, to 1e-3 of the noise: tight adaptive steps that land on the inputs."""
    r, y = TRUTH["run"], np.zeros((7, t.size))
    k = (constants(p), TRUTH["curved"]["B_2"], 1 / p.M)
    rtol, scale = 1e-9, np.array([1e-3, 1e-2, 1, 10, 1e3, 1e5, 10])
    now = y[:, 0]
    for first, last, volts in ((r["start"], r["stop"], 10.0), (r["stop"], t[-1], 0.0)):
        part = integrate(curved_rhs, (first, last), now, tableaux.DP5, args=(volts, *k), rtol=rtol,
                         atol=rtol * scale, max_steps=10_000_000)  # fmt: skip
        inside = (t >= first) & (t <= last)
        y[:, inside], now = part(t[inside]), part.y[:, -1]
    return y


def instrument(ideal: np.ndarray, t: np.ndarray, r_g: float, rng: np.random.Generator):
    """Position, velocity and acceleration (3, n) as the instrument gives them."""
    i = TRUTH["instrument"]
    seen = ideal.copy()
    seen[2] += i["acceleration_bias"] + i["acceleration_drift"] * t
    names = ("position", "velocity", "acceleration")
    seen += np.array([[i[f"{name}_noise"]] for name in names]) * rng.standard_normal(seen.shape)
    steps = [2 * np.pi * r_g / i["counts"]]
    steps += [2 * i[f"{name}_range"] / 2 ** i[f"{name}_bits"] for name in names[1:]]
    return np.array(
        [np.round(np.rint(row / q) * q, 9) + 0.0 for row, q in zip(seen, steps, strict=True)]
    )


def main(folder: Path = HERE) -> None:
    p, (t, volts) = true_axis(), run()
    changes = [(t[n], volts[n]) for n in np.flatnonzero(np.diff(volts, prepend=0.0))]
    records = {
        "x_axis_test.csv": (t, volts, simulate(p, changes, t[-1])(t), TEST, STRAIGHT),
        "x_axis_test_curved.csv": (t, volts, curved_states(p, t), TEST, CURVED),
        "x_axis_move.csv": (*programmed_move(p), MOVE, STRAIGHT),
    }
    seeds = np.random.SeedSequence(TRUTH["seed"]).spawn(len(records))
    for seed, (name, (t, volts, y, what, friction)) in zip(seeds, records.items(), strict=True):
        seen = instrument(signals(y, t, p), t, p.r_g, np.random.default_rng(seed))
        record = Measurement(t, volts, *seen)
        write_measurement(folder / name, record, HEAD.format(what=what, friction=friction))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
