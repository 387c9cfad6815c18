"""Cost of the fixed-step loop per right-hand-side evaluation, against hand-written C.

Every repetition times `integrate` and the fastest C variant one after the other, both with fresh
arrays for the trajectory, so that both see the same state of the machine; the ratio is that of
the pair. Run with ``python benchmarks/fixed_step.py``; it needs gcc.
"""

import argparse
import ctypes
import platform
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numba
import numpy as np
from numba import njit

from armsim.arm import AxisParameters
from armsim.arm.dynamics import constants, rhs
from armsim.methods import integrate, tableaux
from reportkit.timing import processor

HERE = Path(__file__).parent
FLAGS = {
    "-O3": ["-O3", "-march=native"],
    "-O3, no traps": ["-O3", "-march=native", "-fno-trapping-math"],
    "-O3, no SLP": ["-O3", "-march=native", "-fno-tree-slp-vectorize"],
    "-O2, no SLP": ["-O2", "-march=native", "-fno-tree-slp-vectorize"],
}


@njit(cache=True, fastmath={"contract"}, error_model="numpy")
def brusselator(t, y, A, B):
    """Right-hand side of the Brusselator, as in brusselator.c."""
    reaction = y[0] * y[0] * y[1]
    return A + reaction - (B + 1.0) * y[0], B * y[0] - reaction


class Case:
    """One method on one problem: our run, and the same run by a C loop."""

    def __init__(self, label, fun, args, y0, step_size, steps, tableau, form, source, name):
        self.label, self.source, self.name = label, source, name
        self.y0, self.h, self.steps = np.array(y0, dtype=float), step_size, steps
        self.evaluations = steps * len(tableau.evaluated_stages)
        span = (0.0, steps * step_size)
        self.ours = lambda: integrate(fun, span, self.y0, tableau, step_size, form, args).y
        flat = [number for arg in args for number in (arg if isinstance(arg, tuple) else (arg,))]
        self.numbers = (ctypes.c_double * len(flat))(*flat)

    def peer(self, library: ctypes.CDLL) -> np.ndarray:
        """Trajectory by the C loop, in fresh arrays."""
        t, y = np.empty(self.steps + 1), np.empty((self.y0.size, self.steps + 1))
        pointers = [ctypes.c_void_p(a.ctypes.data) for a in (self.y0, t, y)]
        function = getattr(library, self.name)
        function(
            ctypes.c_long(self.steps), ctypes.c_double(0.0), ctypes.c_double(self.h), *pointers,
            self.numbers,
        )  # fmt: skip
        return y


def cases() -> list[Case]:
    """The arm at 10 V from rest and the Brusselator, by three methods and in both forms."""
    p = AxisParameters.paper_x_axis()
    arm = (rhs, (10.0, constants(p)), np.zeros(7), 1e-5, 100_000)
    two = (brusselator, (1.0, 3.0), [1.5, 3.0], 1e-3, 200_000)
    methods = [(tableaux.EULER, "euler"), (tableaux.RK6, "rk6"), (tableaux.DP5, "dp5")]
    found = [
        Case(f"{label}, {tableau.name}", *problem, tableau, "additive", source, name)
        for label, problem, source in (("arm", arm, "arm.c"), ("2 states", two, "brusselator.c"))
        for tableau, name in methods
    ]
    found.append(
        Case("2 states, DP5 exponential", *two, tableaux.DP5, "exponential", "brusselator.c",
             "dp5_exponential")
    )  # fmt: skip
    return found


def build(folder: Path) -> dict[str, dict[str, ctypes.CDLL]]:
    """Every variant of the C files: flags, storage layout, jumps or minimum and maximum."""
    built: dict[str, dict[str, ctypes.CDLL]] = {"arm.c": {}, "brusselator.c": {}}
    for source, variants in built.items():
        for flags, options in FLAGS.items():
            for layout in (0, 1):
                for branches in (0, 1) if source == "arm.c" else (0,):
                    name = f"{flags}, {'rows of states' if layout else 'rows of components'}"
                    name += ", jumps" if branches else ""
                    target = folder / f"{len(variants)}_{source}.so"
                    defines = [f"-DLAYOUT={layout}", f"-DBRANCHES={branches}"]
                    subprocess.run(
                        ["gcc", "-shared", "-fPIC", *options, *defines, str(HERE / source),
                         "-o", str(target), "-lm"],
                        check=True,
                    )  # fmt: skip
                    variants[name] = ctypes.CDLL(str(target))
    return built


def seconds(run: Callable[[], np.ndarray]) -> float:
    """Time of one call, with the result thrown away after the clock has stopped."""
    start = perf_counter()
    result = run()
    stop = perf_counter()
    del result
    return stop - start


def compare(case: Case, variants: dict[str, ctypes.CDLL], repetitions: int) -> str:
    """One line of the table."""
    ours = case.ours()
    for name, library in variants.items():
        theirs = case.peer(library)
        if "rows of states" in name:
            theirs = theirs.reshape(ours.shape[::-1]).T
        # Both round differently, and the chattering of static friction near rest amplifies it.
        if not np.allclose(ours, theirs, rtol=1e-3, atol=1e-3 * np.abs(ours).max()):
            raise SystemExit(f"{case.label}: C ({name}) computes something else")
    trials = {
        name: min(seconds(lambda lib=library: case.peer(lib)) for _ in range(7))
        for name, library in variants.items()
    }
    best = min(trials, key=lambda name: trials[name])
    pairs = np.array(
        [
            (seconds(case.ours), seconds(lambda: case.peer(variants[best])))
            for _ in range(repetitions)
        ]
    )
    ratio = np.quantile(pairs[:, 0] / pairs[:, 1], [0.5, 0.25, 0.75])
    ns = 1e9 * np.median(pairs, axis=0) / case.evaluations
    return (
        f"{case.label:28}{ns[0]:8.2f}{ns[1]:8.2f}   "
        f"{ratio[0]:.3f} ({ratio[1]:.3f} to {ratio[2]:.3f})   {best}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=41, help="timed pairs (default 41)")
    repetitions = parser.parse_args().repetitions
    gcc = subprocess.run(["gcc", "--version"], check=True, capture_output=True, text=True).stdout
    print(f"{processor()}; {gcc.splitlines()[0]}")
    print(f"Python {platform.python_version()}, numpy {np.__version__}, numba {numba.__version__}")
    print("ns per right-hand-side evaluation; ratio: median (quartiles) of the timed pairs\n")
    print(f"{'':28}{'armsim':>8}{'C':>8}   ratio                    fastest C")
    with tempfile.TemporaryDirectory() as folder:
        built = build(Path(folder))
        for case in cases():
            print(compare(case, built[case.source], repetitions), flush=True)


if __name__ == "__main__":
    main()
