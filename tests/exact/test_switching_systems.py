"""The examples of the page "Your own switching system", and what `System` says to its user."""

import logging
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from scipy.optimize import brentq

from armsim import machine_code
from armsim.exact import System, piecewise_affine
from armsim.methods import IntegrationError

ROOT = Path(__file__).parents[2]
EPSILON = np.finfo(float).eps


# --- the examples against their closed forms ------------------------------------------------------


def rounding(count):
    """Relative error of a time that is the sum of `count` intervals, each with 2 ε of its own.

    Each sum is rounded by at most ε/2 of itself, so the errors of n sums are at most n ε/2 of the
    last. In a state they come to no more, as every example forgets or repeats its past.
    """
    return (2 + count / 2) * EPSILON


def times(run):
    return [event.time for event in run.events]


@pytest.mark.parametrize("outside", [5.0, -8.0])
def test_the_thermostat_switches_at_its_closed_form(outside):
    thermostat = import_module("thermostat")
    constants = 0.25, 8.0, 19.0, 21.0
    run = thermostat.solve(15.0, 500.0, outside, constants)
    expected = thermostat.switching_times(len(run.events), 15.0, outside, constants)
    assert len(expected) > 400
    assert times(run) == pytest.approx(expected, rel=rounding(len(expected)), abs=0)
    assert run.y[0].max() <= 21.0 + 1e-14
    assert run(run.t[run.t > expected[0]]).min() >= 19.0 - 1e-14


@pytest.mark.parametrize("duty", [0.1, 0.4, 0.75])
def test_the_buck_converter_follows_its_matrix_exponentials(duty):
    buck, count = import_module("buck_converter"), 400
    constants = 100e-6, 100e-6, 2.0, 10e-6, duty
    period = constants[3]
    run = buck.solve(count + 0.5 * duty, 12.0, constants)
    ends = [event.time for event in run.events if event.before == buck.OFF]
    assert ends == pytest.approx(period * np.arange(1, count + 1), rel=rounding(2 * count), abs=0)
    states, steady = buck.after_periods(count, 12.0, constants)
    # The products of up to `count` matrices have an error of their own, as large again.
    error = np.abs(run(np.array(ends))[:2] - states[:, 1:]).max(axis=1) / np.abs(states).max(axis=1)
    assert error.max() <= 2 * rounding(2 * count)
    # After 400 periods of 0.025 decay times each, what is left of the start is exp(-10).
    assert run(ends[-1])[:2] == pytest.approx(steady, rel=1e-3)
    later = np.arange(200, count) * period + 1e-9
    assert run(later)[0].min() > 0.0  # the coil conducts all the time


@pytest.mark.parametrize(("restitution", "slowest"), [(0.8, 0.01), (0.95, 1e-3), (0.3, 0.5)])
def test_the_ball_bounces_at_its_closed_form_and_stops(restitution, slowest):
    ball = import_module("bouncing_ball")
    constants = restitution, slowest
    run = ball.solve(1.0, 50.0, 9.81, constants)
    expected, speeds = ball.impacts(1.0, 9.81, constants)
    assert times(run) == pytest.approx(expected, rel=rounding(len(expected)), abs=0)
    rebounds = [run(time)[1] for time in times(run)[:-1]]
    # A speed is the product of as many factors as there were impacts.
    assert rebounds == pytest.approx(speeds[1:], rel=2 * rounding(len(expected)), abs=0)
    last = run.events[-1]
    assert (last.before, last.after) == (ball.FLIES, ball.RESTS)
    assert restitution * speeds[-1] < slowest <= speeds[-1]
    assert (run(np.linspace(last.time, 50.0, 9)) == 0.0).all()
    # The times of all bounces that are left out have the sum of a geometric series.
    whole = math.sqrt(2 / 9.81) * (1 + restitution) / (1 - restitution)
    left_out = 2 * restitution * speeds[-1] / 9.81 / (1 - restitution)
    assert last.time + left_out == pytest.approx(whole, rel=rounding(len(expected)))


@pytest.mark.parametrize("belt", [0.01, 0.1, 1.0])
def test_the_block_sticks_and_slips_at_its_closed_form(belt):
    block = import_module("block_on_belt")
    constants = mass, stiffness, belt, holds, drags = 1.0, 100.0, belt, 5.0, 3.0
    run = block.solve(50.0, constants)
    expected = block.switching_times(len(run.events), constants)
    assert len(expected) > 15
    assert times(run) == pytest.approx(expected, rel=rounding(len(expected)), abs=0)
    # A slip is an arc of a circle around drags / stiffness, in x and v / rate.
    rate = math.sqrt(stiffness / mass)
    radius = math.hypot((holds - drags) / stiffness, belt / rate)
    middle = (run.events[0].time + run.events[1].time) / 2
    assert run(middle) == pytest.approx([drags / stiffness, -radius * rate], rel=1e-13)


def test_the_page_shows_the_examples_and_nothing_else():
    page = (ROOT / "book" / "switching_systems.md").read_text(encoding="utf-8")
    for path in (ROOT / "examples").glob("*.py"):
        assert page.count(f"{{literalinclude}} ../examples/{path.name}") == 2
    assert "```python" not in page


# --- what a mode may contain ----------------------------------------------------------------------

SPIRAL = 100


def probe(mode, u, constants, out):
    """Rise to 1 in mode 0; then nothing moves, but for one entry. Or a growing spiral."""
    case, value = constants
    if case == SPIRAL:
        out.A[0, 0] = out.A[1, 1] = 1.0
        out.A[0, 1], out.A[1, 0] = u, -u
        out.normal[0, 0] = 1.0
        if mode == 0:
            out.lower[0], out.upper[0] = -value, value
    elif mode == 0:
        out.A[1, 1] = -1.0
        out.b[0] = 1.0
        out.normal[0, 0] = 1.0
        out.lower[0], out.upper[0] = -5.0, 1.0
        out.normal[1, 1], out.upper[1] = 1.0, 10.0
    elif case == 1:
        out.A[0, 1] = value
    elif case == 2:
        out.b[1] = value
    elif case == 3:
        out.normal[1, 0] = value
    elif case == 4:
        out.lower[1] = value
    elif case == 5:
        out.upper[1] = value
    elif case == 6:
        out.lower[0], out.upper[0] = 2.0, value


def after_probe(mode, guard, side, z, constants):
    return mode + 1


PROBE = System(probe, after_probe, guards=2, matrices=2)


def solve_probe(case, value=math.nan, z0=(0.0, 3.0), t_end=4.0, u=0.0):
    return PROBE.solve(z0, 0, (0.0, t_end), [(0.0, u)], (case, value))


@pytest.mark.parametrize(
    ("case", "value", "name"),
    [
        (1, math.nan, "A[0, 1] = nan"),
        (1, math.inf, "A[0, 1] = inf"),
        (2, math.nan, "b[1] = nan"),
        (3, math.nan, "normal[1, 0] = nan"),
        (4, math.nan, "lower[1] = nan, upper[1] = inf"),
        (5, math.nan, "lower[1] = -inf, upper[1] = nan"),
        (6, 1.5, "lower[0] = 2.0, upper[0] = 1.5"),
    ],
)
def test_an_entry_that_is_not_allowed_is_named_with_its_mode_and_time(case, value, name):
    with pytest.raises(IntegrationError) as stopped:
        solve_probe(case, value)
    message = str(stopped.value)
    assert message.startswith("exact solution stopped at t = 1: mode 1 is not allowed with ")
    assert f" {name} (" in message


def test_a_mode_starts_from_zeros_without_limits_each_time():
    """Mode 1 sets nothing, so nothing is left of mode 0, in which both states move."""
    run = solve_probe(0)
    assert [event.after for event in run.events] == [1]
    later = run(np.array([1.0, 2.0, 4.0]))
    assert later == pytest.approx(np.repeat([[1.0], [3 * math.exp(-1)]], 3, axis=1), rel=1e-15)
    assert run.room.here.lower.tolist() == [-math.inf] * 2
    assert not run.room.here.normal.any()


@pytest.mark.parametrize("limit", [1e3, 1e160, 1e300])
@pytest.mark.parametrize("start", [1.0, 1e100])
def test_a_limit_however_large_is_reached_at_its_time(limit, start):
    end = math.log(1e307 / start)  # beyond, the state would overflow
    (event,) = solve_probe(SPIRAL, max(limit, 2 * start), (start, 0.0), end).events
    assert event.time == pytest.approx(math.log(max(limit, 2 * start) / start), rel=1e-14)


def test_a_growing_spiral_reaches_a_large_limit():
    """The first state is exp(t) cos 2t."""
    limit = 1e300
    (event,) = solve_probe(SPIRAL, limit, (1.0, 0.0), 700.0, u=2.0).events

    def gap(t):
        return t + math.log(abs(math.cos(2 * t))) - math.log(limit)

    grid = np.arange(math.log(limit), math.log(limit) + 4, 1e-3)
    first = next(t for t in grid if gap(t) >= 0)
    assert event.time == pytest.approx(brentq(gap, first - 1e-3, first, xtol=1e-14), rel=1e-14)


# --- compilation ----------------------------------------------------------------------------------


class Impatient:
    """A timer that is up at once."""

    def __init__(self, interval, function, arguments):
        self.start = lambda: function(*arguments)

    def cancel(self):
        pass


def test_a_compilation_is_announced_once(monkeypatch, caplog):
    monkeypatch.setattr(machine_code.threading, "Timer", Impatient)
    system = System(probe, after_probe, guards=2, matrices=2)
    for _ in range(2):
        system.solve([0.0, 3.0], 0, (0.0, 4.0), [(0.0, 0.0)], (0, 0.0))
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert record.getMessage() == (
        "armsim: compiling the exact solver with probe and after_probe; this takes some ten seconds"
    )


def test_a_compilation_in_time_is_silent(caplog):
    with machine_code.announced("nothing", probe):
        pass
    assert not caplog.records


def misspelt(mode, u, constants, out):
    out.a[0, 0] = -1.0


def helper(x):
    return x


def calls_python(mode, u, constants, out):
    out.A[0, 0] = helper(-1.0)


@njit
def few_arguments(mode, u, constants):
    pass


def unsupported(mode, u, constants, out):
    with open("file") as file:
        out.A[0, 0] = float(file.read())


def mixed(mode, guard, side, z, constants):
    return "slides" if mode == 0 else 1


@pytest.mark.parametrize(
    ("equations", "successor", "message"),
    [
        (misspelt, after_probe, "misspelt: Unknown attribute 'a' of type Mode"),
        (calls_python, after_probe, "calls_python: Untyped global name 'helper'"),
        (few_arguments, after_probe, "few_arguments: Cannot bind .* too many positional"),
        (unsupported, after_probe, "unsupported and after_probe: The 'with .* is not supported"),
        (probe, mixed, 'mixed: Cannot unify .* File .*test_switching_systems.py", line'),
        (3, after_probe, "not a function .got type <class 'int'>"),
    ],
)
def test_what_numba_cannot_compile_is_one_line(equations, successor, message):
    system = System(equations, successor, guards=2, matrices=1)
    with pytest.raises(TypeError, match=message) as refused:
        system.solve([1.0, 0.0], 0, (0.0, 1.0), constants=(0, 1.0))
    assert "\n" not in str(refused.value)


def half(mode, guard, side, z, constants):
    return mode + side / 2


def nothing(mode, guard, side, z, constants):
    pass


@pytest.mark.parametrize(
    ("successor", "returned"),
    [(half, "half returns a float64"), (nothing, "nothing returns a none")],
)
def test_the_next_mode_is_an_integer(successor, returned):
    system = System(probe, successor, guards=2, matrices=1)
    with pytest.raises(TypeError, match=f"{returned} as the next mode; an integer is needed"):
        system.solve([1.0, 0.0], 0, (0.0, 1.0), constants=(0, 1.0))


def test_a_system_that_is_compiled_runs_once_and_does_nothing_else(monkeypatch):
    """To find the types of the arguments again takes as long as a hundred events."""
    thermostat, calls = import_module("thermostat"), []
    arguments = 15.0, 500.0, 5.0, (0.25, 6.0, 19.0, 21.0)
    solver = thermostat.solve(*arguments) and thermostat.ROOM._run
    monkeypatch.setattr(piecewise_affine, "typeof", None)
    count = lambda *given: calls.append(given) or solver(*given)  # noqa: E731
    monkeypatch.setitem(thermostat.ROOM.__dict__, "_run", count)
    assert len(thermostat.solve(*arguments).events) > 600
    assert len(calls) == 1


def test_code_of_a_notebook_is_found_by_the_next_kernel(tmp_path, monkeypatch):
    """A cell is compiled from a file that does not exist and is named after the process."""
    monkeypatch.setattr(machine_code.config, "CACHE_DIR", str(tmp_path))

    def hits(process, text="return 2.0 * x"):
        cell = compile(f"def double(x):\n    {text}", f"/no/ipykernel_{process}/1.py", "exec")
        names = {"__name__": "__main__"}
        exec(cell, names)
        names = {"double": njit(names["double"])}
        function = machine_code.generated("def run(x):\n    return double(x)\n", names)
        assert function(1.5) == 3.0
        return sum(function.stats.cache_hits.values())

    assert [hits(1), hits(2), hits(3, "return x + x"), hits(4, "return x + x")] == [0, 1, 0, 1]
    assert len(list(tmp_path.rglob("*.nbc"))) == 1


# --- arguments and solutions ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"z0": "rest"}, "z0 = 'rest': real numbers are needed"),
        ({"z0": []}, "z0 = .*: one row"),
        ({"mode": 1.0}, "mode = 1.0 is a float; an integer is needed"),
        ({"t_span": 3.0}, "t_span = 3.0: one row of 2 finite numbers"),
        ({"t_span": (0.0, 1.0, 2.0)}, "t_span = .*: one row of 2 finite numbers"),
        ({"t_span": (1.0, 0.0)}, "t_span = .* must rise"),
        ({"inputs": []}, "inputs = .*: pairs .time, input. are needed"),
        ({"inputs": 5.0}, "inputs = 5.0: pairs .time, input. are needed"),
        ({"inputs": [(0.0, "on")]}, "inputs = .*: pairs .time, input. are needed"),
        ({"inputs": [([0.0], 1.0)]}, "times of inputs = .*: one row of one or more finite"),
        ({"constants": {"mass": 1.0}}, "numba cannot compile probe .*: Cannot determine .* 'dict'"),
        ({"max_events": -1}, "max_events = -1 is not allowed"),
    ],
)
def test_an_argument_that_is_not_allowed_is_named(changes, message):
    arguments = {"z0": [0.0, 3.0], "mode": 0, "t_span": (0.0, 1.0), "constants": (0, 1.0)}
    with pytest.raises((TypeError, ValueError), match=message):
        PROBE.solve(**arguments | changes)


@pytest.mark.parametrize(("guards", "matrices"), [(-1, 1), (1, 0), (1.0, 1)])
def test_the_sizes_of_a_system_are_checked(guards, matrices):
    with pytest.raises((TypeError, ValueError), match="guards = |matrices = "):
        System(probe, after_probe, guards, matrices).solve([0.0], 0, (0.0, 1.0))


def test_times_form_one_row():
    run = solve_probe(0)
    for call in (run, run.modes):
        with pytest.raises(ValueError, match=r"t has shape \(2, 2\); a number or one row"):
            call([[0.0, 1.0], [2.0, 3.0]])
        with pytest.raises(ValueError, match="t = 5.0 is outside the run"):
            call(5.0)
    assert run([]).shape == (2, 0)
    assert run.modes(0.5) == [0]


def test_a_solution_is_printed_in_one_line():
    assert repr(solve_probe(0)) == "<ExactSolution from t = 0 to 4: 2 states, 2 pieces, 1 events>"
