"""Change one digit or one sign at a time, in a copy, and see that a test fails.

Not a part of ``make test``; it takes half an hour: ``.venv/bin/python tests/mutations.py``. It
changes every digit of every tableau, ours and the paper's, every digit of Tables 3 to 5, and every
sign of the state equations and the auxiliary variables. A number as argument takes every n-th.
"""

import ast
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
from multiprocessing.queues import SimpleQueue as Queue
from pathlib import Path
from typing import NamedTuple

# Imported here for all the children that run tests: half the time of a run.
import hypothesis.extra.numpy  # noqa: F401
import numba  # noqa: F401
import pandas  # noqa: F401
import pytest
import scipy.integrate
import scipy.optimize  # noqa: F401
import sympy  # noqa: F401

ROOT = Path(__file__).resolve().parents[1]
TABLEAUX, EQUATIONS = "src/armsim/methods/tableaux.toml", "src/armsim/arm/dynamics.py"
TABLES, FORMULAS = "data/paper/tables.toml", "data/paper/tableaux.toml"
#: What is tried in turn until something fails, the quickest and likeliest first.
TESTS = {
    TABLEAUX: ["tests/methods/test_tableaux.py", "tests/methods/test_trees.py"],
    FORMULAS: ["tests/methods/test_tableaux.py", "tests/methods/test_errata.py"],
    TABLES: ["tests/arm/test_parameters.py"],
    EQUATIONS: ["tests/arm/test_dynamics.py"],
}  # fmt: skip
FUNCTIONS = "preamplifier_output motor_voltage gear_force static_friction derivative constants"


class Mutation(NamedTuple):
    """Characters to put in place of others of a file."""

    file: str
    start: int
    end: int
    text: str

    def told(self) -> str:
        """Line of the file before and after."""
        whole = (ROOT / self.file).read_text(encoding="utf-8")
        first, last = whole.rfind("\n", 0, self.start) + 1, whole.find("\n", self.end)
        line, n = whole[first:last], whole.count("\n", 0, self.start) + 1
        changed = line[: self.start - first] + self.text + line[self.end - first :]
        return f"{self.file}:{n}: {line.strip()}  →  {changed.strip()}"


def digits(file: str, pattern: str) -> list[Mutation]:
    """Each digit of what the pattern's group finds, changed to the next."""
    text = (ROOT / file).read_text(encoding="utf-8")
    return [
        Mutation(file, n, n + 1, str((int(text[n]) + 1) % 10))
        for found in re.finditer(pattern, text, re.MULTILINE | re.DOTALL)
        for n in range(*found.span(1))
        if text[n] in "0123456789"
    ]


def stage_names(mutation: Mutation) -> bool:
    """Whether it renames a stage or a state of the paper's formulas, such as the 2 of k_2."""
    text = (ROOT / FORMULAS).read_text(encoding="utf-8")
    return mutation.file == FORMULAS and bool(re.search(r"k_$|\+1?$", text[: mutation.start]))


def signs(file: str) -> list[Mutation]:
    """Each plus made a minus and the other way round, in the functions of the model."""
    text = (ROOT / file).read_text(encoding="utf-8")
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    found = []
    for function in ast.walk(ast.parse(text)):
        if isinstance(function, ast.FunctionDef) and function.name in FUNCTIONS.split():
            for node in ast.walk(function):
                if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
                    left, right = node.left, node.right
                    begin = starts[(left.end_lineno or 1) - 1] + (left.end_col_offset or 0)
                    end = starts[right.lineno - 1] + right.col_offset
                    raw = text.encode()
                    n = (
                        len(raw[:begin].decode())
                        + re.search(r"[+-]", raw[begin:end].decode()).start()
                    )
                    found.append(Mutation(file, n, n + 1, "-" if text[n] == "+" else "+"))
                elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
                    n = len(text.encode()[: starts[node.lineno - 1] + node.col_offset].decode())
                    found.append(Mutation(file, n, n + 1, " "))
    return found


def all_mutations() -> list[Mutation]:
    """Everything that is changed, one at a time."""
    found = digits(TABLEAUX, r'^(?:A|interpolant) = """(.*?)"""')
    found += digits(TABLEAUX, r'^b\w* = "(.*?)"')
    found += [m for m in digits(FORMULAS, r"'''[^']*?=(.*?)'''") if not stage_names(m)]
    found += digits(TABLES, r"^(?:value|ndp|rk6) = [\"'](.*?)[\"']$")
    return found + signs(EQUATIONS)


def survives(mutation: Mutation, copy: Path) -> bool:
    """Whether the tests pass with the change."""
    target = copy / mutation.file
    text = target.read_text(encoding="utf-8")
    try:
        changed = text[: mutation.start] + mutation.text + text[mutation.end :]
        target.write_text(changed, encoding="utf-8")
        return all(passes(test, copy) for test in TESTS[mutation.file])
    finally:
        target.write_text(text, encoding="utf-8")


def passes(test: str, copy: Path) -> bool:
    """Run a test file of a copy in a child, which finds the large libraries already imported."""
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] == 0
    status = 2
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        os.chdir(copy)
        os.environ["NUMBA_CACHE_DIR"] = str(copy / "cache")
        sys.path.insert(0, str(copy / "src"))
        sys.dont_write_bytecode = True
        status = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", test]))
    finally:
        os._exit(status)


def work(copies: Queue, tasks: list[Mutation], n: int, workers: int, told: Queue) -> None:
    """Try every `workers`-th mutation in a copy of its own."""
    copy = copies.get()
    assert "armsim" not in sys.modules  # it must come from the copy
    for test in {test for tests in TESTS.values() for test in tests}:
        if not passes(test, copy):
            told.put((-1, test))  # else everything would count as caught
            return
    for k in range(n, len(tasks), workers):
        told.put((k, survives(tasks[k], copy)))


def copy_into(folder: Path) -> Path:
    """Copy what the tests need."""
    for part in ("src", "data", "tests", "pyproject.toml"):
        copying = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
        copying(ROOT / part, folder / part)
    return folder


def main() -> int:
    """Try all mutations, or every n-th if a number is given; tell which survive."""
    every = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    mutations, workers = all_mutations()[::every], os.cpu_count() or 1
    context = multiprocessing.get_context("fork")
    copies, told = context.SimpleQueue(), context.SimpleQueue()
    survivors = set()
    with tempfile.TemporaryDirectory() as scratch:
        crew = [
            context.Process(target=work, args=(copies, mutations, n, workers, told))
            for n in range(workers)
        ]
        for n, worker in enumerate(crew):
            folder = Path(scratch, str(n))
            folder.mkdir()
            copies.put(copy_into(folder))
            worker.start()
        for n in range(1, len(mutations) + 1):
            k, survived = told.get()
            if k < 0:
                print(f"{survived} fails before anything is changed")
                return 2
            if survived:
                survivors.add(k)
                print("survives:", mutations[k].told(), flush=True)
            if sys.stderr.isatty():
                print(f"\r{n} of {len(mutations)}", end="", file=sys.stderr)
        for worker in crew:
            worker.join()
    for file in TESTS:
        print(f"{file}: {sum(m.file == file for m in mutations)} changes")
    print(f"{len(mutations) - len(survivors)} of {len(mutations)} changes are caught")
    return int(bool(survivors))


if __name__ == "__main__":
    sys.exit(main())
