"""Tests of the measurement of times, with clocks that only the functions move."""

import contextlib
import gc
import itertools
import os

import numpy as np
import pandas as pd
import pytest
from joblib import Parallel, delayed

from reportkit import timing
from reportkit.timing import measure, resolution, spent


class Machine:
    """A clock that ticks when read, and functions that take a time of their own."""

    def __init__(self, tick=1e-6):
        self.now, self.tick, self.log = 0.0, tick, []

    def clock(self):
        self.now += self.tick
        return self.now

    def function(self, name, *seconds):
        durations = itertools.cycle(seconds)

        def run():
            self.log.append(name)
            self.now += next(durations)

        return run


@pytest.fixture
def machine():
    return Machine()


def measured(machine, functions, **options):
    return measure(functions, clock=machine.clock, **options)


def test_times_are_those_of_one_call(machine):
    functions = {"slow": machine.function("slow", 0.3), "fast": machine.function("fast", 0.1)}
    found = measured(machine, functions, repetitions=5)
    assert len(found.frame) == 5 * 2
    assert found.median == pytest.approx({"slow": 0.3, "fast": 0.1}, rel=1e-4)
    assert found.ratios("slow", to="fast") == pytest.approx((3, 3, 3), rel=1e-4)
    assert found.clock == "clock"
    assert found.resolution == pytest.approx(1e-6)


def test_the_interval_holds_the_median_as_often_as_it_says(machine):
    """Its ends are the order statistics of the ranks k and n + 1 - k of a binomial distribution."""
    ratios = (1 + np.random.default_rng(3).permutation(20) / 20).tolist()
    functions = {"a": machine.function("a", 1.0, *ratios), "b": machine.function("b", 1.0)}
    found = measured(machine, functions, repetitions=20)
    # P(B < 6) = 0.0207 <= 0.025 < P(B < 7) for B ~ Bin(20, 1/2), so the ranks are 6 and 15
    assert found.interval("a", to="b") == pytest.approx([1 + 5 / 20, 1 + 14 / 20], rel=1e-4)
    few = measured(machine, functions, repetitions=5)
    assert np.isnan(few.interval("a", to="b")).all()


def test_the_spread_is_that_of_the_most_unsteady_function(machine):
    times = [1.0, 1.0, 1.5, 1.2, 9.0, 1.1]  # a warm-up takes the first; the quartiles are 1.1, 1.5
    functions = {"a": machine.function("a", *times), "b": machine.function("b", 3.0)}
    found = measured(machine, functions, repetitions=5)
    assert found.spread == pytest.approx(0.4 / 1.2, rel=1e-4)


def test_it_stops_when_it_is_enough(machine):
    functions = {"one": machine.function("one", 1.0)}
    seen = []

    def enough(so_far):
        seen.append(len(so_far.frame))
        return len(seen) == 2

    assert len(measured(machine, functions, repetitions=99, enough=enough).frame) == 20
    assert seen == [10, 20]
    assert len(measured(machine, functions, repetitions=7).frame) == 7


def test_each_repetition_goes_once_through_all_in_its_own_order(machine):
    functions = {name: machine.function(name, 1.0) for name in "abcd"}
    found = measured(machine, functions, repetitions=6)
    warm_up, rounds = machine.log[:4], np.reshape(machine.log[4:], (6, 4))
    assert warm_up == list("abcd")
    assert all(sorted(one) == list("abcd") for one in rounds)
    assert len({tuple(one) for one in rounds}) > 1
    assert list(found.frame["function"]) == machine.log[4:]
    other = Machine()
    again = measured(other, {name: other.function(name, 1.0) for name in "abcd"}, repetitions=6)
    assert list(again.frame["function"]) == machine.log[4:]


def test_warm_up_is_not_counted(machine):
    first = itertools.chain([50.0], itertools.repeat(0.5))

    def compiled():
        machine.now += next(first)

    assert measured(machine, {"compiled": compiled}).median["compiled"] == pytest.approx(0.5, 1e-4)


def test_short_calls_are_repeated_until_the_clock_can_tell(machine):
    machine.tick = 1e-3
    found = measured(machine, {"short": machine.function("short", 1e-4)}, repetitions=3)
    assert (found.frame["calls"] == 1024).all()  # the first power of two that lasts 100 ticks
    assert found.median["short"] == pytest.approx(1e-4, rel=0.02)


def test_least_duration_can_be_asked_for(machine):
    found = measured(machine, {"f": machine.function("f", 1e-3)}, repetitions=2, shortest=0.1)
    assert (found.frame["calls"] == 128).all()


def test_ratios_are_paired_within_a_repetition(machine):
    """A machine that slows down tenfold leaves the ratio of the pair as it is."""
    slow = [0.2, *(0.2 * 10**n for n in range(4))]
    fast = [0.1, *(0.1 * 10**n for n in range(4))]
    functions = {"slow": machine.function("slow", *slow), "fast": machine.function("fast", *fast)}
    found = measured(machine, functions, repetitions=4)
    assert found.ratios("slow", to="fast") == pytest.approx((2, 2, 2), rel=1e-3)
    assert sorted(found.of("slow")) == pytest.approx([0.2, 2, 20, 200], rel=1e-3)


def test_ratios_are_quartiles_and_median(machine):
    slow = machine.function("slow", 1.0, 1.0, 2.0, 3.0, 5.0)  # the first is not counted
    found = measured(machine, {"slow": slow, "fast": machine.function("fast", 1.0)}, repetitions=4)
    assert found.ratios("slow", to="fast") == pytest.approx((1.75, 2.5, 3.5), rel=1e-3)


def test_frame_keeps_every_measurement(machine):
    functions = {"a": machine.function("a", 0.5), "b": machine.function("b", 0.25)}
    frame = measured(machine, functions, repetitions=3).frame
    assert list(frame.columns) == ["repetition", "place", "function", "calls", "seconds"]
    assert list(frame["repetition"]) == [0, 0, 1, 1, 2, 2]
    assert list(frame["place"]) == [0, 1] * 3
    assert set(frame["seconds"].round(4)) == {0.5, 0.25}


def test_resolution_passes_over_equal_readings():
    readings = itertools.chain.from_iterable([float(n)] * 3 for n in itertools.count())
    assert resolution(lambda: next(readings)) == 1.0


def test_progress_and_garbage_collection(machine, capsys):
    states = []
    measured(machine, {"f": lambda: (machine.function("f", 1.0)(), states.append(gc.isenabled()))},
             repetitions=3)  # fmt: skip
    assert "0/3" in capsys.readouterr().err
    assert states == [True, False, False, False]
    assert gc.isenabled()


def test_garbage_is_collected_again_after_an_error(machine):
    calls = itertools.count()

    def fails():
        if next(calls):
            raise ArithmeticError("lost")

    with pytest.raises(ArithmeticError):
        measured(machine, {"fails": fails})
    assert gc.isenabled()


@pytest.mark.parametrize(("functions", "repetitions"), [({}, 3), ({"f": print}, 0)])
def test_nothing_to_measure_is_refused(functions, repetitions):
    with pytest.raises(ValueError, match="at least 1 is needed"):
        measure(functions, repetitions)


def test_machine_names_its_software():
    (row,) = timing.machine(["numpy", "no-such-package", "pandas"]).to_dict("records")
    assert row["software"].startswith("Python 3")
    assert f"numpy {np.__version__}, pandas {pd.__version__}" in row["software"]
    assert timing.processor() in row["machine"]


def test_processor_time_of_children_counts_and_waiting_does_not(monkeypatch):
    """The system's times are of this process, coarse, of its children, and elapsed."""
    monkeypatch.setattr(timing.os, "times", lambda: os.times_result((1.0, 2.0, 4.0, 8.0, 16.0)))
    monkeypatch.setattr(timing.time, "process_time", lambda: 3.0)
    assert spent() == 15.0


def test_idle_workers_are_ended_before_their_time_is_read(monkeypatch):
    """A worker of joblib counts once it has ended, so none may be alive when the times are read."""
    pids = set(Parallel(n_jobs=2)(delayed(os.getpid)() for _ in range(4)))
    assert os.getpid() not in pids
    alive = []

    def times():
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, 0)
                alive.append(pid)
        return os.times_result((0.0, 0.0, 1.0, 0.0, 0.0))

    monkeypatch.setattr(timing.os, "times", times)
    monkeypatch.setattr(timing.time, "process_time", lambda: 0.0)
    assert spent() == 1.0
    assert alive == []
