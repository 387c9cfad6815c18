"""The exact solution of the arm: references of 35 digits, invariants, random axes, failures."""

import itertools
import json
import math
from pathlib import Path

import flint
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armsim.arm import AxisParameters, modes, simulate, simulate_many
from armsim.arm.dynamics import (
    STUCK,
    Region,
    auxiliary_variables,
    constants,
    derivative,
    without_offsets,
)
from armsim.exact import piecewise_affine
from armsim.exact.piecewise_affine import Mode
from armsim.methods import IntegrationError, tableaux

P = AxisParameters.paper_x_axis()
REFERENCES = sorted((Path(__file__).parents[1] / "reference").glob("*.json"))


def number(value):
    """A float of the references: a number, hexadecimal or decimal."""
    if isinstance(value, str) and "0x" in value:
        return float.fromhex(value)
    return float(value)


# --- against 35 digits ----------------------------------------------------------------------------


@pytest.mark.parametrize("file", REFERENCES, ids=lambda file: file.stem)
def test_agrees_with_the_reference(file):
    wanted = json.loads(file.read_text())
    p = AxisParameters(**{name: number(value) for name, value in wanted["parameters"].items()})
    schedule = [(number(t), number(u)) for t, u in wanted["set_velocity"]]
    start = [number(v) for v in wanted["y_initial"]]
    run = simulate(p, schedule, number(wanted["t_end"]), y0=start)

    assert [tuple(e.before) for e in run.events] == [tuple(e["before"]) for e in wanted["events"]]
    assert [tuple(e.after) for e in run.events] == [tuple(e["after"]) for e in wanted["events"]]
    for event, other in zip(run.events, wanted["events"], strict=True):
        assert event.time == pytest.approx(number(other["time"]), abs=1e-14)

    times = np.array([number(sample["t"]) for sample in wanted["samples"]])
    states = np.array([[number(v) for v in sample["y"]] for sample in wanted["samples"]]).T
    largest = np.array([number(v) for v in wanted["y_largest"]])
    largest[largest == 0] = 1.0
    # At an impact the current changes by 10⁻¹³ of itself while a time changes by its last digit;
    # the runs are allowed twenty of these digits, and 10⁻¹³ everywhere.
    before, after = np.maximum(times - 1e-9, 0.0), np.minimum(times + 1e-9, run.t_end)
    digit = np.abs(run(after) - run(before)) / (after - before) * np.spacing(times)
    error = np.abs(run(times) - states) - 20 * digit
    assert np.all(error.max(axis=1) <= 1e-13 * largest)


# --- the equations are those of dynamics ----------------------------------------------------------


def local(y, p):
    """Coordinates of `switching`: y0, x, y1, y3, y4, y5, y6."""
    return np.array([y[0], p.r_g * y[2] - y[0], y[1], y[3], y[4], y[5], y[6]])


@pytest.mark.parametrize("speed", range(5))
def test_every_mode_has_the_equations_of_its_region(speed):
    rng = np.random.default_rng(speed)
    pair = constants(P), without_offsets(constants(P))
    for branches in itertools.product((-1, 0, 1), repeat=3):
        mode = ((branches[0] + 1) * 9 + (branches[1] + 1) * 3 + branches[2] + 1) * 5 + speed
        where = modes.region_of_number(mode)
        assert where[:3] == branches
        assert where.friction == (0, -1, STUCK, 1, 0)[speed]
        here = Mode(np.empty((7, 7)), np.empty(7), np.empty((4, 7)), np.empty(4), np.empty(4))
        modes.equations(mode, 7.0, pair, here)
        y = rng.normal(size=7) * [1, 1, 100, 100, 10, 1000, 10]
        if where.friction == STUCK:
            y[1] = 0.0
        slope = np.array(derivative(y, 7.0, constants(P), where))
        terms = np.abs(here.A) @ np.abs(local(y, P)) + np.abs(here.b)
        assert np.all(np.abs(here.A @ local(y, P) + here.b - local(slope, P)) <= 1e-12 * terms)
        assert np.all(here.lower < here.upper)


# --- invariants of any run ------------------------------------------------------------------------


def dense_times(run, panels=1000, nodes=20):
    """Gauss points and weights that resolve every piece, its beginning finest."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    edges = np.concatenate((run.solution.room.start[:, 0], [run.solution.end]))
    cuts = []
    for a, b in itertools.pairwise(edges):
        even = np.linspace(a, b, max(2, math.ceil((b - a) * panels)))
        fine = a + (even[1] - a) * 0.5 ** np.arange(1, 12)
        cuts.append(np.unique(np.concatenate((even, fine))))
    edges = np.unique(np.concatenate(cuts))
    h = np.diff(edges)
    times = edges[:-1, None] + h[:, None] * (x + 1) / 2
    return times.ravel(), (h[:, None] * w / 2).ravel()


def energy(run, t):
    """Kinetic, magnetic and elastic energy at times, in joules."""
    p, y = run.parameters, run(t)
    contact = np.array([where.contact for where in run.regions(t)])
    stretch = contact * (p.r_g * y[2] - y[0]) - np.abs(contact) * p.H
    return 0.5 * (
        p.M * y[1] ** 2
        + p.J_m * y[3] ** 2
        + p.L_a * y[6] ** 2
        + p.K_g * np.where(contact == 0, 0.0, stretch) ** 2
    )


def energy_defect(run):
    """Energy at the end minus what came in, relative to all that was turned over."""
    p = run.parameters
    t, weights = dense_times(run)
    y, more = run(t), run.auxiliary(t)
    contact = np.array([where.contact for where in run.regions(t)]) != 0
    supply = more["v_m"] * y[6]
    losses = (
        p.R_a * y[6] ** 2
        + p.B_m * y[3] ** 2
        + p.B_a * y[1] ** 2
        + more["F_s"] * y[1]
        + contact * p.b_g * (p.r_g * y[3] - y[1]) ** 2
    )
    ends = np.array([0.0, run.solution.end])
    first, last = energy(run, ends)
    turnover = weights @ (np.abs(supply) + np.abs(losses)) + first + last
    return (last - first - weights @ (supply - losses)) / max(turnover, 1e-300)


def assert_stays_in_its_regions(run):
    """Between events every signal is on the side of its limits that the region says."""
    p = run.parameters
    t, _ = dense_times(run, panels=300, nodes=3)
    y, regions = run(t), np.array(run.regions(t))
    f_g = auxiliary_variables(p, y, run.regions(t))["f_g"]
    v_c = y[4] + p.T_z * y[5]
    limited = np.where(regions[:, 0] == 0, v_c, regions[:, 0] * p.V_L)
    v_m = p.K_e * (limited - y[6] / p.K_i)
    x = p.r_g * y[2] - y[0]
    noise = 1e-9 * np.abs(y).max(axis=1)
    for branch, signal, limit, slack in (
        (regions[:, 0], v_c, p.V_L, 1e-9 * p.V_L + noise[4]),
        (regions[:, 1], v_m, p.V_M, 1e-9 * p.V_M + p.K_e * (noise[4] + noise[6] / p.K_i)),
        (regions[:, 2], x, p.H, 1e-9 * p.H + p.r_g * 1e-6 * noise[2]),
    ):
        if limit > 0:
            assert np.all(np.abs(signal[branch == 0]) <= limit + slack)
            assert np.all((branch * signal)[branch != 0] >= limit - slack)
    if p.F_0 > 0 and p.v_s > 0:
        friction, y1 = regions[:, 3], y[1]
        assert np.all(y1[friction == STUCK] == 0)
        assert np.all(np.abs(f_g[friction == STUCK]) <= p.F_0 * (1 + 1e-6) + 1e-6)
        assert np.all(np.abs(y1[friction == 0]) >= p.v_s * (1 - 1e-9))
        slow = np.abs(friction) == 1
        assert np.all((friction * y1)[slow] >= -noise[1])
        assert np.all(np.abs(y1)[slow] <= p.v_s + noise[1])


def assert_continuous(run):
    """No state jumps at an event, but y1 by rounding when it is put to zero."""
    ends = np.array([event.time for event in run.events if event.time > 0])
    if ends.size:
        before, after = run(np.nextafter(ends, 0)), run(ends)
        change = np.abs(after - before).max(axis=1)
        assert np.all(change <= 1e-9 * np.abs(run.y).max(axis=1))


SCENARIOS = {
    "published step": ({}, 10.0, 1.0),
    "small step": ({}, 0.05, 1.0),
    "reversal": ({}, [(0.0, 8.0), (0.3, -8.0)], 0.9),
    "stop": ({"F_0": 60.0}, [(0.0, 3.0), (0.25, 0.0)], 1.2),
    "wide play": ({"H": 1e-3, "F_0": 400.0, "v_s": 0.05}, 10.0, 1.0),
    "no play": ({"H": 0.0}, [(0.0, 5.0), (0.1, -5.0)], 0.4),
    "no static friction": ({"F_0": 0.0}, [(0.0, 5.0), (0.1, -5.0)], 0.4),
    "no threshold": ({"v_s": 0.0}, [(0.0, 5.0), (0.1, -5.0)], 0.4),
    "no friction at all": (
        {"F_0": 0.0, "B_a": 0.0, "B_m": 0.0, "b_g": 0.0},
        [(0.0, 1.0), (0.1, -1.0)],
        0.3,
    ),
    "double pole of the preamplifier": ({"T_r": 0.01, "T_p": 0.01}, 5.0, 0.5),
    "pole on the zero": ({"T_p": 0.00705}, 5.0, 0.3),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_energy_balances_and_every_piece_stays_in_its_region(name):
    changes, schedule, t_end = SCENARIOS[name]
    run = simulate(P.replace(**changes), schedule, t_end)
    assert abs(energy_defect(run)) < 1e-11
    assert_stays_in_its_regions(run)
    assert_continuous(run)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_runge_kutta_run_tends_to_it(name):
    """With the step, in proportion: each event costs the method an error of first order."""
    changes, schedule, t_end = SCENARIOS[name]
    p, t_end = P.replace(**changes), min(t_end, 0.4)
    run = simulate(p, schedule, t_end)
    largest = np.abs(run.y).max(axis=1) + 1e-9

    def distance(step_size):
        other = simulate(p, schedule, t_end, method=tableaux.RK6, step_size=step_size)
        return (np.abs(run(other.t) - other.y).max(axis=1) / largest).max()

    coarse, fine = distance(8e-6), distance(5e-7)
    assert fine < 5e-3  # the current, just after an event that comes late by part of a step
    assert fine < coarse / 3 or fine < 1e-9


def random_axis(rng):
    """Parameters within a factor of two of the paper's, special values now and then."""

    def near(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    factors = "R_a L_a K_b J_m K_t r_g M T_z T_r K_i K_e V_M V_L b_g K_g".split()
    changes = {name: getattr(P, name) * near(0.5, 2.0) for name in factors}
    changes |= {"T_p": near(0.0071, 4.74), "K_2": near(80, 870)}
    ranges = {"B_m": (1e-4, 1e-2), "B_a": (10, 1e3), "H": (1e-6, 2e-3), "F_0": (1, 500)}
    for name, (low, high) in (ranges | {"v_s": (1e-3, 0.1)}).items():
        changes[name] = 0.0 if rng.random() < 0.1 else near(low, high)
    count = int(rng.integers(1, 5))
    starts = [0.0, *np.sort(rng.uniform(0.01, 0.6, count - 1)).tolist()]
    schedule = [(t, float(rng.choice([0.0, rng.uniform(-10, 10)]))) for t in starts]
    return AxisParameters.paper_x_axis(**changes), schedule


def test_a_thousand_random_axes_run_without_failure():
    rng = np.random.default_rng(2008)
    events = []
    for n in range(1000):
        p, schedule = random_axis(rng)
        run = simulate(p, schedule, 0.8)
        events.append(len(run.events))
        assert np.isfinite(run(0.8)).all()
        assert all(a.after == b.before for a, b in itertools.pairwise(run.events))
        if n % 25 == 0 and len(run.events) < 500:
            assert abs(energy_defect(run)) < 1e-10
            assert_stays_in_its_regions(run)
            assert_continuous(run)
    assert np.mean(events) > 20


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.floats(-1, 1), min_size=7, max_size=7),
    st.floats(1e-6, 0.2),
)
def test_from_any_start_a_run_continues_where_it_was_cut(seed, y, cut):
    p, schedule = random_axis(np.random.default_rng(seed))
    volts, t_end = schedule[0][1], 0.25
    y0 = np.round(y, 3) * [1.0, 0.5, 100.0, 100.0, 10.0, 1e3, 10.0]
    whole = simulate(p, volts, t_end, y0=y0)
    assert np.array_equal(whole(0.0)[[0, 1, 3, 4, 5, 6]], y0[[0, 1, 3, 4, 5, 6]])
    assert_stays_in_its_regions(whole)
    rest = simulate(p, volts, t_end - cut, y0=whole(cut))
    scale = np.abs(whole.y).max(axis=1) + 1e-9
    times = np.linspace(0, t_end - cut, 100)
    # y0 and y2 are of metres and their difference is what the gear feels, so a cut rounds it; the
    # many impacts of some of these runs multiply that
    difference = np.abs(rest(times) - whole(cut + times)).max(axis=1)
    assert np.all(difference <= 1e-6 * scale)


# --- physics --------------------------------------------------------------------------------------


def largest_error_of_a_piece(run, count=20):
    """Over each of some pieces, against the matrix exponential in ball arithmetic of 500 bits."""
    room, p = run.solution.room, run.parameters
    here = Mode(np.empty((7, 7)), np.empty(7), np.empty((4, 7)), np.empty(4), np.empty(4))
    n, worst = len(room.start), 0.0
    edges = np.append(room.start[:, 0], run.solution.end)

    def states(times):
        out = np.empty((times.size, 7))
        piecewise_affine.sample(room, times, out)
        return out

    at_ends = states(np.nextafter(edges[1:], 0.0))
    even = states(np.linspace(0.0, run.solution.end, 2001))
    largest = np.abs([*even, *at_ends]).max(axis=0) + 1e-300
    for piece in sorted({*range(min(n, count)), *np.linspace(0, n - 1, count).astype(int)}):
        pair = constants(p), without_offsets(constants(p))
        modes.equations(int(room.label[piece, 0]), 10.0, pair, here)
        time = flint.arb(np.nextafter(edges[piece + 1], 0.0)) - flint.arb(edges[piece])
        with flint.ctx.workprec(500):
            rows = np.column_stack((here.A, here.b)).tolist()
            power = (flint.arb_mat([*rows, 8 * [0.0]]) * time).exp()
            start = flint.arb_mat([[float(v)] for v in (*room.start[piece, 1:8], 1.0)])
            wanted = np.array([float(v.mid()) for v in (power * start).entries()[:7]])
        worst = max(worst, (np.abs(at_ends[piece] - wanted) / largest).max())
    return worst


@pytest.mark.parametrize(
    "changes",
    [{}]
    + [{"T_r": P.T_p * factor} for factor in (1.0, 1 + 1e-9, 1 + 1e-4, 1.01, 1.02, 1.1)]
    + [{"K_1": 1e-12}, {"K_2": 0.0}, {"K_2": 1e-12}, {"K_g": 1e-6}]
    + [{"L_a": L} for L in (1e-6, 1e-9, 1e-10, 5e-12, 1e-12)],
    ids=str,
)
def test_no_piece_loses_digits(changes):
    """Equal lags, vanishing gains and springs, and an armature 10⁹ times too fast."""
    run = simulate(P.replace(**changes), 10.0, 1.0)
    assert largest_error_of_a_piece(run) <= min(1e-12, run.solution.loss)


def test_a_vanishing_inductance_leaves_the_arm_without_it():
    """The speed at the end differs from that at 1 pH in proportion to the inductance."""
    speeds = [simulate(P.replace(L_a=L), 10.0, 1.0)(1.0)[1] for L in (1e-9, 1e-10, 5e-12, 1e-12)]
    differences = np.array(speeds[:3]) - speeds[3]
    assert differences / [999e-12, 99e-12, 4e-12] == pytest.approx(
        differences[0] / 999e-12, rel=1e-2
    )


def test_an_inductance_too_small_for_nine_digits_is_an_error():
    with pytest.raises(IntegrationError, match=r"t = 0\.79.* more than 1e-09 of the solution"):
        simulate(P.replace(L_a=1e-14), 10.0, 1.0)


def test_a_start_too_large_for_numbers_is_an_error_that_says_when():
    with pytest.raises(IntegrationError, match="t = 0: the solution is not finite"):
        simulate(P, 10.0, 0.5, y0=[1e300] * 7)


def test_an_arm_that_is_not_driven_stays_exactly_where_it_is():
    run = simulate(P, 0.0, 1.0)
    assert run.events == ()
    assert np.array_equal(run.y, np.zeros_like(run.y))


def test_a_mirrored_input_gives_the_mirrored_run():
    run = simulate(P, [(0.0, 8.0), (0.3, -8.0)], 0.9)
    mirror = simulate(P, [(0.0, -8.0), (0.3, 8.0)], 0.9)
    times = np.linspace(0, 0.9, 1001)
    scale = np.abs(run.y).max(axis=1)
    difference = np.abs(mirror(times) + run(times)).max(axis=1)
    assert np.all(difference <= 1e-13 * scale)  # rounding: the code has no side of its own
    assert [e.time for e in mirror.events] == pytest.approx([e.time for e in run.events], rel=1e-14)
    for event, other in zip(run.events, mirror.events, strict=True):
        flipped = [-b for b in event.after[:3]]
        assert list(other.after[:3]) == flipped


def test_a_stop_ends_at_rest_and_friction_holds_the_gear():
    run = simulate(P.replace(F_0=60.0), [(0.0, 3.0), (0.25, 0.0)], 1.2)
    assert run.events[-1].after.friction == STUCK
    t = np.linspace(run.events[-1].time, 1.2, 50)
    assert np.all(run(t)[1] == 0.0)
    assert np.ptp(run(t)[0]) == 0.0
    more = run.auxiliary(t)
    assert more["F_s"] == pytest.approx(more["f_g"], abs=1e-12)
    assert np.abs(more["f_g"]).max() <= 60.0


def test_a_gear_that_engages_tears_the_arm_loose_at_once():
    """The damping makes f_g jump above F_0: contact and friction change at one time."""
    event = simulate(P, 10.0, 0.01).events[3]
    assert (event.before.contact, event.after.contact) == (0, 1)
    assert (event.before.friction, event.after.friction) == (STUCK, 1)
    assert event.causes == (("contact", 1), ("friction", 1))


def test_a_start_at_the_repelling_threshold_gains_speed():
    p = P.replace(F_0=1000.0)
    y0 = [0.0, p.v_s, (p.H + 1e-4) / p.r_g, p.v_s / p.r_g, 0.0, 0.0, 0.0]
    run = simulate(p, 0.0, 1e-4, y0=y0)
    assert run.regions(run.t[:1])[0].friction == 0
    assert run(1e-4)[1] > p.v_s


def test_samples_are_held_exactly():
    """A run with samples is the chain of runs over each of them."""
    volts = [round(10240 * math.sin(4 * math.pi * 0.005 * k)) / 1024 for k in range(40)]
    schedule = [(0.005 * k, u) for k, u in enumerate(volts)]
    whole = simulate(P, schedule, 0.2)
    y = np.zeros(7)
    for u in volts:
        y = simulate(P, u, 0.005, y0=y)(0.005)
    assert np.all(np.abs(whole(0.2) - y) <= 1e-9 * np.abs(whole.y).max(axis=1))


# --- the trajectory -------------------------------------------------------------------------------


def test_the_trajectory_shows_the_run():
    schedule = [(0.0, 8.0), (0.3, -8.0)]
    run = simulate(P, schedule, 0.9)
    assert run.nfev == 0
    assert run.y.shape == (7, run.t.size)
    assert run(0.5).shape == (7,)
    assert run([0.1, 0.2]).shape == (7, 2)
    assert np.all(np.diff(run.t) > 0)
    assert (run.t[0], run.t[-1]) == (0.0, 0.9)
    assert {event.time for event in run.events} | {0.3} <= set(run.t.tolist())
    assert run.regions(run.t[:1]) == [run.events[0].before] == [Region(0, 0, 0, STUCK)]
    assert run.regions(np.array([run.events[5].time])) == [run.events[5].after]
    assert np.array_equal(run.auxiliary(run.t)["f_g"], run.auxiliary()["f_g"])
    with pytest.raises(ValueError, match="t = 0.95 is outside the run"):
        run(0.95)


def test_options_of_another_method_are_refused():
    for options in ({"step_size": 1e-5}, {"form": "exponential"}):
        with pytest.raises(ValueError, match="for a Runge-Kutta method"):
            simulate(P, **options)


def test_a_start_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="y0"):
        simulate(P, y0=[0, 0, 0, math.nan, 0, 0, 0])


def test_too_many_events_are_an_error_that_says_when(monkeypatch):
    monkeypatch.setitem(simulate.__globals__, "MAX_EVENTS", 5)
    with pytest.raises(IntegrationError, match=r"t = 0\.0055.*more than 5 events.*guard friction"):
        simulate(P)


# --- many runs ------------------------------------------------------------------------------------


def test_a_batch_gives_each_run_whatever_the_threads():
    rng = np.random.default_rng(1)
    axes = [P.replace(T_p=float(t), F_0=float(f)) for t, f in rng.uniform(0.03, 60, (150, 2))]
    schedule, times = [(0.0, 8.0), (0.2, -8.0)], [0.0, 0.1, 0.35]
    batch = simulate_many(axes, schedule, 0.4, times, threads=1)
    assert batch.shape == (150, 7, 3)
    assert np.array_equal(batch, simulate_many(axes, schedule, 0.4, times, threads=4))
    for axis, y in list(zip(axes, batch, strict=True))[::10]:
        assert np.array_equal(simulate(axis, schedule, 0.4)(times), y)
    assert simulate_many([], 10.0).shape == (0, 7, 1)


def test_a_batch_names_the_run_that_fails(monkeypatch):
    monkeypatch.setitem(simulate.__globals__, "MAX_EVENTS", 9)
    calm = P.replace(H=0.0, F_0=0.0)
    with pytest.raises(IntegrationError, match=r"parameters\[1\]: .* more than 9 events"):
        simulate_many([calm, P])


@pytest.mark.parametrize(
    ("options", "name"), [({"times": [2.0]}, "times"), ({"threads": 0}, "threads")]
)
def test_a_batch_checks_its_arguments(options, name):
    with pytest.raises(ValueError, match=name):
        simulate_many([P], **options)
