"""Processor times of functions, measured so that they can be compared."""

import gc
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
import pandas as pd
from joblib.externals.loky import get_reusable_executor

Clock = Callable[[], float]

#: A measurement lasts at least this many times the resolution of the clock.
RESOLUTIONS = 100
#: Clocks of processor time; the first one counts helper threads as well.
CLOCKS: dict[str, Clock] = {"process_time": time.process_time, "thread_time": time.thread_time}


@dataclass(frozen=True)
class Timing:
    """Repeated measurements of the processor time of some functions; see `measure`."""

    names: tuple[str, ...]
    seconds: np.ndarray  #: (repetitions, functions), of one call
    calls: np.ndarray  #: (repetitions, functions), calls that the measurement is the mean of
    place: np.ndarray  #: (repetitions, functions), in the order of the repetition, from 0
    clock: str
    resolution: float  #: s, of the clock, as measured

    @property
    def median(self) -> dict[str, float]:
        """Median seconds of one call, by name."""
        return dict(zip(self.names, np.median(self.seconds, axis=0).tolist(), strict=True))

    def quartiles(self, name: str) -> tuple[float, float, float]:
        """Lower quartile, median and upper quartile of the seconds of one function."""
        return _quartiles(self.of(name))

    def ratios(self, name: str, to: str) -> tuple[float, float, float]:
        """Quartiles and median, as in `quartiles`, of the ratios within each repetition."""
        return _quartiles(self.of(name) / self.of(to))

    def of(self, name: str) -> np.ndarray:
        """Seconds (repetitions,) of one function."""
        return self.seconds[:, self.names.index(name)]

    def frame(self) -> pd.DataFrame:
        """Every measurement, in the order in which they were taken; to be kept as CSV."""
        repetition, column = np.indices(self.seconds.shape)
        columns = {
            "repetition": repetition.ravel(),
            "place": self.place.ravel(),
            "function": np.array(self.names)[column.ravel()],
            "calls": self.calls.ravel(),
            "seconds": self.seconds.ravel(),
        }
        return pd.DataFrame(columns).sort_values(["repetition", "place"], ignore_index=True)


def measure(
    functions: Mapping[str, Callable[[], object]],
    repetitions: int = 7,
    *,
    shortest: float = 1e-3,
    seed: int = 0,
    clocks: Mapping[str, Clock] = CLOCKS,
    warm_up: bool = True,
    progress: Callable[[int], object] = lambda _: None,
) -> Timing:
    """Measure the processor time of functions in turn, so that a drift of the machine affects all.

    Every function is first called once without being measured. Then each repetition goes through
    all of them in a random order, and calls each as often as a measurement needs to last
    `shortest` and `RESOLUTIONS` times the resolution of the clock. Garbage is collected between
    repetitions.

    Parameters
    ----------
    functions : mapping of name to callable
        Called without arguments.
    repetitions : int
        Measurements of each function.
    shortest : float
        s, least duration of a measurement.
    seed : int
        Seed of the order within the repetitions.
    clocks : mapping of name to clock
        The first is taken unless another is more than twice as fine; then the finest.
    warm_up : bool
        False if the functions have been called already.
    progress : callable, optional
        Called with 1 after each measurement, as a progress bar's `update`.

    Returns
    -------
    Timing

    Raises
    ------
    ValueError
        If there is no function, or the number of repetitions is not positive.
    """
    if not functions or repetitions < 1:
        raise ValueError(
            f"{len(functions)} functions and {repetitions} repetitions; at least 1 is needed"
        )
    resolutions = {name: resolution(clock) for name, clock in clocks.items()}
    chosen, finest = next(iter(clocks)), min(resolutions, key=resolutions.__getitem__)
    if 2 * resolutions[finest] < resolutions[chosen]:
        chosen = finest
    clock, least = clocks[chosen], max(shortest, RESOLUTIONS * resolutions[chosen])
    names, todo = tuple(functions), list(functions.values())
    shape = repetitions, len(todo)
    seconds, calls, place = np.empty(shape), np.ones(shape, int), np.empty(shape, int)
    counts = np.ones(len(todo), int)
    random, collecting = np.random.default_rng(seed), gc.isenabled()
    for function in todo if warm_up else ():
        function()
    gc.freeze()  # existing objects are not searched in every collection
    try:
        for n in range(repetitions):
            gc.collect()
            gc.disable()
            for position, which in enumerate(random.permutation(len(todo))):
                counts[which], total = _long_enough(todo[which], counts[which], clock, least)
                calls[n, which], place[n, which] = counts[which], position
                seconds[n, which] = total / counts[which]
                progress(1)
    finally:
        gc.unfreeze()
        if collecting:
            gc.enable()
    return Timing(names, seconds, calls, place, chosen, resolutions[chosen])


def resolution(clock: Clock, samples: int = 100) -> float:
    """Return the median difference in s between successive unequal readings of a clock."""
    steps = np.empty(samples)
    for n in range(samples):
        now = before = clock()
        while now == before:
            now = clock()
        steps[n] = now - before
    return float(np.median(steps))


def spent() -> float:
    """Return the processor time in s so far, of this process and its children that have ended.

    Joblib keeps its idle workers. They are ended first, since the time of a living child does not
    count yet.
    """
    get_reusable_executor().shutdown()
    return sum(os.times()[:4])


def processor() -> str:
    """Return the name of the processor, as far as the system tells it."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    models = (line.partition(": ")[2] for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine()


def computer() -> str:
    """Return processor, number of processors and system in one phrase."""
    return f"{processor()}, {os.cpu_count()} processors, {platform.system()} {platform.machine()}"


def machine(
    packages: Sequence[str] = ("numpy", "numba", "scipy", "scikit-sundae"),
) -> pd.DataFrame:
    """Return computer, software and load as a table of one row.

    Parameters
    ----------
    packages : sequence of str
        Installed packages whose versions matter.
    """
    versions = [f"{name} {metadata.version(name)}" for name in packages]
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    software = ", ".join([f"Python {platform.python_version()}", *versions])
    return pd.DataFrame([{"machine": computer(), "software": software, "load": load}])


def _long_enough(
    function: Callable[[], object], count: int, clock: Clock, least: float
) -> tuple[int, float]:
    """Call a function `count` times, and double this until the calls take long enough."""
    while True:
        begin = clock()
        for _ in range(count):
            function()
        total = clock() - begin
        if total >= least:
            return count, total
        count *= 2


def _quartiles(values: np.ndarray) -> tuple[float, float, float]:
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75]).tolist()
    return low, middle, high
