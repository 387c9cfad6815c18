"""Comparable CPU times of functions."""

import gc
import os
import platform
import re
import time
import timeit
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from statistics import median

import numpy as np
import pandas as pd
from joblib.externals.loky import get_reusable_executor
from tqdm import tqdm

from reportkit.locks import alone

Clock = Callable[[], float]

#: A measurement lasts at least this many times the resolution of the clock.
RESOLUTIONS = 100
#: Packages whose versions matter for a time.
PACKAGES = ("numpy", "numba", "scipy", "scikit-sundae")
#: Columns of `Timing.frame`.
COLUMNS = ["repetition", "place", "function", "calls", "seconds"]


@dataclass(frozen=True, eq=False)
class Timing:
    """Repeated measurements of the processor time of some functions; see `measure`."""

    #: Each measurement, in the order in which they were taken, with its repetition and its place
    #: in that, the function, the number of calls, and the seconds of one call as their mean.
    frame: pd.DataFrame
    clock: str
    resolution: float  #: s, of the clock, as measured

    @property
    def median(self) -> dict[str, float]:
        """Median seconds of one call, by name."""
        return self.frame.groupby("function")["seconds"].median().to_dict()

    def of(self, name: str) -> np.ndarray:
        """Seconds (repetitions,) of one function."""
        return self.frame.groupby("function")["seconds"].get_group(name).to_numpy()

    def ratios(self, name: str, to: str) -> list[float]:
        """Lower quartile, median and upper quartile of the ratios within each repetition."""
        return np.quantile(self.of(name) / self.of(to), [0.25, 0.5, 0.75]).tolist()

    @property
    def spread(self) -> float:
        """Largest range of the middle half of a function's times, as a share of its median."""
        seconds = self.frame.groupby("function")["seconds"]
        middle_half = seconds.quantile(0.75) - seconds.quantile(0.25)
        return float((middle_half / seconds.median()).max())

    def interval(self, name: str, to: str) -> list[float]:
        """Limits of the median ratio at a confidence of 95 %, whatever its distribution.

        They are the order statistics between which the median lies with that probability; NaN if
        there are fewer than six repetitions.
        """
        from scipy.stats import quantile_test  # slow to import

        limits = quantile_test(self.of(name) / self.of(to), p=0.5).confidence_interval(0.95)
        return [float(limit) for limit in limits]


def measure(
    functions: Mapping[str, Callable[[], object]],
    repetitions: int = 7,
    *,
    shortest: float = 1e-3,
    clock: Clock = time.process_time,
    warm_up: bool = True,
    enough: Callable[[Timing], bool] = lambda _: False,
) -> Timing:
    """Measure the processor time of functions in turn, so that a drift of the machine affects all.

    Every function is first called once without being measured. Then each repetition goes through
    all of them in a random order, and calls each as often as a measurement needs to last
    `shortest` and `RESOLUTIONS` times the resolution of the clock. Garbage is collected between
    repetitions. Of the notebooks that make executes, no other one works meanwhile.

    Parameters
    ----------
    functions : mapping of name to callable
        Called without arguments.
    repetitions : int
        Measurements of each function.
    shortest : float
        s, least duration of a measurement.
    clock : callable, optional
        By default that of the process, which counts helper threads as well.
    warm_up : bool
        False if the functions have been called already.
    enough : callable, optional
        Called with the measurements after every tenth repetition; returns whether to stop.

    Returns
    -------
    Timing

    Raises
    ------
    ValueError
        If there is no function, or the number of repetitions is not positive.
    """
    if not functions or repetitions < 1:
        given = f"{len(functions)} functions and {repetitions} repetitions"
        raise ValueError(f"{given}; at least 1 is needed")
    for function in functions.values() if warm_up else ():
        function()
    random, counts = np.random.default_rng(0), dict.fromkeys(functions, 1)
    tick, rows = resolution(clock), list[list[object]]()
    least = max(shortest, RESOLUTIONS * tick)

    def measured() -> Timing:
        return Timing(pd.DataFrame(rows, columns=COLUMNS), clock.__name__, tick)

    with alone(), _frozen():
        for n in tqdm(range(repetitions), unit="rounds"):
            gc.collect()
            for place, name in enumerate(random.permutation(list(functions)).tolist()):
                timer = timeit.Timer(functions[name], timer=clock)  # no garbage is collected in it
                while (total := timer.timeit(counts[name])) < least:
                    counts[name] *= 2
                rows.append([n, place, name, counts[name], total / counts[name]])
            if n % 10 == 9 and enough(measured()):
                break
    return measured()


@contextmanager
def _frozen() -> Iterator[None]:
    """Leave the objects that exist out of every search for garbage."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def resolution(clock: Clock, samples: int = 100) -> float:
    """Return the median difference in s between successive unequal readings of a clock."""

    def step() -> float:
        now = before = clock()
        while now == before:
            now = clock()
        return now - before

    return median(step() for _ in range(samples))


def spent() -> float:
    """Return the processor time in s so far, of this process and its children that have ended.

    Joblib keeps its idle workers. They are ended first, since the time of a living child does not
    count yet.
    """
    get_reusable_executor().shutdown()
    return time.process_time() + sum(os.times()[2:4])


def processor() -> str:
    """Return the name of the processor, as far as the system tells it."""
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8") if cpuinfo.exists() else ""
    model = re.search(r"^model name\s*: (.+)", text, re.MULTILINE)
    return model[1] if model else platform.processor() or platform.machine()


def computer() -> str:
    """Return processor, number of processors and system in one phrase."""
    return f"{processor()}, {os.cpu_count()} processors, {platform.system()} {platform.machine()}"


def installed(name: str) -> str:
    """Return the version of a package, or an empty text if it is not installed."""
    with suppress(metadata.PackageNotFoundError):
        return metadata.version(name)
    return ""


def machine(packages: Sequence[str] = PACKAGES) -> pd.DataFrame:
    """Return computer, software and load as a table of one row.

    Parameters
    ----------
    packages : sequence of str
        Packages whose versions matter; those that are not installed are left out.
    """
    versions = {"Python": platform.python_version()} | {name: installed(name) for name in packages}
    software = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    load = f"{os.getloadavg()[0]:.1f}"
    return pd.DataFrame([{"machine": computer(), "software": software, "load": load}])
