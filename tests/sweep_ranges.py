"""Rerun every notebook with each parameter at both ends of its range, alone and all together.

Not a part of ``make test``, for it takes hours: ``.venv/bin/python tests/sweep_ranges.py``. One
notebook or parameter takes minutes::

    .venv/bin/python tests/sweep_ranges.py 54 60 -p grid -p repetitions --jobs 2

Each run is an ``armsim rerun`` into a folder that is thrown away. The ends of ``above LOW`` and
``at least LOW`` are a hundredth of the way from LOW to the default, and LOW, and ten times the
default. A list is tried with its fewest values at either end of the range and, in twice its usual
number, all over it, and with both ends in either order. Of ``A | B`` every alternative is
tried, of a bool both; but ``quick`` stays true unless it is named, and paths are left out. When all
parameters are changed together, one that breaks a condition beside those before it is not.

A run is right if it ends with exit code 0, no table has a ``nan``, and none consists of dashes that
does not so by default; or if a condition refuses the value before anything runs. The exit code is 0
if all are right.
"""

import argparse
import json
import math
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from reportkit import parameters
from reportkit.parameters import Notebook, Parameter, ParameterError
from reportkit.project import Project

PROJECT = Project.find(Path(__file__))
ALL = "all parameters"


def bounds(allowed: str, usual: list[Any]) -> tuple[float, float]:
    """The two ends of a range."""
    match allowed.split():
        case [low, "to", high]:
            return float(low), float(high)
        case ["at", "least", low]:
            return float(low), 10 * max(*usual, float(low))
        case ["above", low]:
            return float(low) + (min(usual) - float(low)) / 100, 10 * max(usual)
    raise ValueError(allowed)


def ends(parameter: Parameter) -> dict[str, Any]:
    """Values to try, by what they are called."""
    usual, kind, allowed = parameter.default, parameter.kind, parameter.allowed
    if allowed == "path":
        return {}
    if kind is bool:
        return {"true": True, "false": False}
    if "|" in allowed:
        return {text: kind(text) for text in re.split(r"\s*\|\s*", allowed)}
    if not isinstance(usual, list):
        low, high = bounds(allowed, [usual])
        return {"low": kind(low), "high": kind(high)}
    match = parameters._LIST.fullmatch(allowed)
    assert match
    fewest, (low, high) = int(match["count"] or 1), bounds(match["range"], usual)
    rising = usual[0] < usual[-1]

    def ordered(values: list[float]) -> list[Any]:
        return [kind(value) for value in sorted(values, reverse=not rising)]

    near = min(2.0, (high / low) ** (0.5 / fewest))
    if match["halved"]:
        near, halvings = 2.0, math.floor(math.log2(high / low) + 1e-9)
        spread = [high / 2**n for n in range(halvings + 1)]
    else:
        many = 2 * len(usual)
        spread = [low * (high / low) ** (n / (many - 1)) for n in range(1, many - 1)]
        spread = sorted({low, high, *map(kind, spread)})
    both = ordered([low, high]) if fewest <= 2 and not match["halved"] else []
    return {
        "low": ordered([low * near**n for n in range(fewest)]),
        "high": ordered([high / near**n for n in range(fewest)]),
        "both ends": both,
        "both ends, in the opposite order": both[::-1],
        "many": ordered(spread) if match["more"] or not match["count"] else [],
    }


def trials(notebook: Notebook, only: list[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Parameter, name of the end, and the values to rerun a notebook with."""
    wanted = only or [name for name in notebook.parameters if name != "quick"]
    tried = {n: ends(one) for n, one in notebook.parameters.items() if n in wanted}
    for name, values in tried.items():
        for end, value in values.items():
            if value not in ([], notebook.parameters[name].default):
                yield name, end, {name: value}
    for end in ("low", "high") if len(tried) > 1 else ():
        together: dict[str, Any] = {}
        for name, values in tried.items():
            # of alternatives the first and the last
            value = values.get(end, [*values.values(), None][0 if end == "low" else -1])
            try:
                together = notebook.values((), together | {name: value} if values else together)
            except ParameterError:
                continue
        yield ALL, end, together


def text_of(value: Any) -> str:
    """A value as the command line takes it."""
    return ",".join(map(repr, value)) if isinstance(value, list) else str(value)


def run(
    notebook: Notebook, values: Mapping[str, Any], limit: float
) -> tuple[int, float, str, Path]:
    """Rerun: exit code, seconds, the last line of the errors, and the folder of the results."""
    parent = Path(tempfile.mkdtemp(prefix="sweep-"))
    given = [part for name, value in values.items() for part in ("-p", name, text_of(value))]
    command = [sys.executable, "-m", "armbook.cli", "rerun", notebook.name, *given]
    begin = time.perf_counter()
    with subprocess.Popen(
        [*command, "-o", str(parent)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            errors = process.communicate(timeout=limit)[1]
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGTERM)  # armsim ends its kernel by it
            errors = process.communicate()[1] + f"\nstopped after {limit:g} s"
    lines = errors.strip().splitlines() or [""]
    made = next(parent.glob("[0-9]*"), parent)
    return process.returncode, time.perf_counter() - begin, lines[-1].strip(), made


def without_numbers(folder: Path) -> tuple[set[str], set[str], set[str]]:
    """Tables with a NaN, tables that consist of dashes, and the names of recorded values."""
    nan, dashes, recorded = set(), set(), set()
    for path in folder.glob("[0-9]*.md"):
        rows = [line.strip("|").split("|") for line in path.read_text("utf-8").splitlines()[2:]]
        cells = [cell.strip() for row in rows for cell in row[1:]]
        if any(re.search(r"\b(nan|inf)\b", cell, re.IGNORECASE) for cell in cells):
            nan.add(path.stem)
        if cells.count("–") > len(cells) / 2 or not cells:
            dashes.add(path.stem)
    for path in folder.glob("[0-9]*.json"):
        recorded |= set(json.loads(path.read_text("utf-8")))
    return nan, dashes, recorded


def sweep(notebook: Notebook, only: list[str], jobs: int, limit: float) -> tuple[int, int]:
    """Run and tell all ends of a notebook; return how many there are and how many are not right."""

    def one(trial: tuple[str, str, dict[str, Any]]) -> bool:
        name, end, values = trial
        code, seconds, error, folder = run(notebook, values, limit)
        nan, dashes, recorded = without_numbers(folder)
        shutil.rmtree(folder.parent if folder.name[0].isdigit() else folder)
        complaints = [f"NaN in {table}" for table in nan - usual[0]]
        complaints += [f"only dashes in {table}" for table in dashes - usual[1]]
        refused = code == 2 and any(f"expected {one}" in error for one in notebook.conditions)
        right = refused or (code == 0 and not complaints)
        complaints += [error] if error else []
        if code == 0 and (missing := len(usual[2] - recorded)):
            complaints.append(f"{missing} of {len(usual[2])} values do not apply")
        told = "; ".join(complaints)
        value = f": {text_of(values[name])}" if name != ALL else ""
        mark = "ok " if right else "BAD"
        print(f"{mark} {notebook.name[:2]} {name} {end}{value}: exit {code}, {seconds:.0f} s"
              f"{f', {told}' if told else ''}", flush=True)  # fmt: skip
        return right

    code, seconds, error, folder = run(notebook, {}, limit)
    print(f"{'BAD' if code else 'ok '} {notebook.name[:2]} defaults: exit {code}, {seconds:.0f} s"
          f"{f', {error}' if error else ''}", flush=True)  # fmt: skip
    usual = without_numbers(folder)
    shutil.rmtree(folder.parent)
    with ThreadPoolExecutor(jobs) as pool:
        results = [not code, *pool.map(one, trials(notebook, only))]
    return len(results), results.count(False)


def main() -> int:
    """Sweep the notebooks that the command line names, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("notebooks", nargs="*", help="numbers or names; all by default")
    parser.add_argument("-p", "--parameter", action="append", default=[], help="only this one")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    parser.add_argument("--limit", type=float, default=math.inf, help="seconds a run may take")
    given = parser.parse_args()
    choices = PROJECT.read_choices()
    names = given.notebooks or [path.stem for path in parameters.sources(PROJECT.notebooks)]
    notebooks = [parameters.find(name, PROJECT.notebooks, choices) for name in names]
    limit = given.limit if given.limit < math.inf else 10**6
    counts = [sweep(one, given.parameter, given.jobs, limit) for one in notebooks]
    runs, wrong = map(sum, zip(*counts, strict=True))
    print(f"{runs} runs, {wrong} not right")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
