"""Rerun every notebook with each parameter at both ends of its range, alone and all together.

Not a part of ``make test``, for it takes hours: ``.venv/bin/python tests/sweep_ranges.py``. One
notebook or parameter takes minutes::

    .venv/bin/python tests/sweep_ranges.py 54 60 -p grid -p repetitions --jobs 2

Each run is an ``armsim rerun`` into a folder that is thrown away. The mean of both ends is tried as
well, because it has more digits. The low end of ``above LOW`` is a hundredth of the way from LOW to
the default, and the high end of it and of ``at least LOW`` is ten times the default. A list is
tried with its fewest values at either end of the range, with one value at each end in either order,
and with twice its usual number of values all over the range. Of ``A | B`` every alternative is
tried, and of a bool both; but ``quick`` stays true unless it is named, and texts are left out. When
all parameters are changed together, one that breaks a condition beside those before it is not.

A run is right if it ends with exit code 0, no table has a ``nan``, and none is mostly dashes that
is not so in the book, or by default if the book is not built; or if a condition refuses the value
before anything runs. A run that ``--limit`` stops is listed as long if it has told when it will
end, and is not right if it has not. The exit code is 0 if none is "not right".
"""

import argparse
import json
import math
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from reportkit import parameters
from reportkit.parameters import Notebook, Parameter, ParameterError
from reportkit.project import Project

PROJECT = Project.find(Path(__file__))
ALL = "all parameters"
BEFORE = ", of the rest it has told: "


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
    if allowed in ("path", ""):  # a text
        return {}
    if kind is bool:
        return {"true": True, "false": False}
    if "|" in allowed:
        return {text: kind(text) for text in re.split(r"\s*\|\s*", allowed)}
    if not isinstance(usual, list):
        low, high = bounds(allowed, [usual])
        return {"low": kind(low), "high": kind(high), "between": kind((low + high) / 2)}
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


class Outcome(NamedTuple):
    """How a rerun ended, and what it made."""

    code: int
    seconds: float
    error: str  # last line
    nan: set[str]  # tables with a NaN
    dashes: set[str]  # tables that are mostly dashes
    recorded: set[str]  # names of values


def run(notebook: Notebook, values: Mapping[str, Any], limit: float | None) -> Outcome:
    """Rerun a notebook with some values, for no longer than some seconds."""
    given = [part for name, value in values.items() for part in ("-p", name, text_of(value))]
    command = [sys.executable, "-m", "armbook.cli", "rerun", notebook.name, *given]
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="sweep-") as parent:
        command += ["-o", parent]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        with subprocess.Popen(command, text=True, **silent) as process:
            try:
                errors = process.communicate(timeout=limit)[1]
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGTERM)  # armsim ends its kernel by it
                errors = process.communicate()[1]
                left = re.findall(r"about ([\d:]+) left", errors)
                errors += f"\nstopped after {limit:g} s" + (f"{BEFORE}{left[-1]}" if left else "")
        last = (errors.strip().splitlines() or [""])[-1].strip()
        made = next(Path(parent).glob("[0-9]*"), Path(parent))
        found = without_numbers(made, notebook.name)
    return Outcome(process.returncode, time.perf_counter() - begin, last, *found)


def without_numbers(folder: Path, name: str) -> tuple[set[str], set[str], set[str]]:
    """Tables with a NaN, tables that are mostly dashes, and the names of recorded values."""
    nan, dashes, recorded = set(), set(), set[str]()
    for path in folder.glob(f"{name}-*.md"):
        rows = [line.strip("|").split("|") for line in path.read_text("utf-8").splitlines()[2:]]
        cells = [cell.strip() for row in rows for cell in row[1:]]
        if any(re.search(r"\b(nan|inf)\b", cell, re.IGNORECASE) for cell in cells):
            nan.add(path.stem)
        if cells.count("–") > len(cells) / 2:
            dashes.add(path.stem)
    if (path := folder / f"{name}.json").is_file():
        recorded = set(json.loads(path.read_text("utf-8")))
    return nan, dashes, recorded


def sweep(notebook: Notebook, only: list[str], jobs: int, limit: float | None) -> list[str]:
    """Run and tell all ends of a notebook; return of each whether it is "ok", "LONG" or "BAD"."""

    def one(trial: tuple[str, str, dict[str, Any]]) -> str:
        name, end, values = trial
        got = run(notebook, values, limit)
        complaints = [f"NaN in {table}" for table in got.nan - nan]
        complaints += [f"dashes in {table}" for table in got.dashes - dashes]
        conditions = (f"expected {condition}" in got.error for condition in notebook.conditions)
        right = (got.code == 2 and any(conditions)) or (got.code == 0 and not complaints)
        result = "ok" if right else "LONG" if BEFORE in got.error else "BAD"
        complaints += [got.error] if got.error else []
        if got.code == 0 and (missing := len(recorded - got.recorded)):
            complaints.append(f"{missing} of {len(recorded)} values do not apply")
        value = f": {text_of(values[name])}" if name != ALL else ""
        told = f"{notebook.name[:2]} {name} {end}{value}: exit {got.code}, {got.seconds:.0f} s"
        print(f"{result:4}", "; ".join([told, *complaints]), flush=True)
        return result

    nan, dashes, recorded = without_numbers(PROJECT.results, notebook.name)
    if not recorded:
        *_, nan, dashes, recorded = run(notebook, {}, limit)
    with ThreadPoolExecutor(jobs) as pool:
        return [*pool.map(one, trials(notebook, only))]


def main() -> int:
    """Sweep the notebooks that the command line names, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("notebooks", nargs="*", help="numbers or names; all by default")
    parser.add_argument("-p", "--parameter", action="append", default=[], help="only this one")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    parser.add_argument("--limit", type=float, help="seconds a run may take")
    given = parser.parse_args()
    choices = PROJECT.read_choices()
    names = given.notebooks or [path.stem for path in parameters.sources(PROJECT.notebooks)]
    notebooks = [parameters.find(name, PROJECT.notebooks, choices) for name in names]
    found = [r for one in notebooks for r in sweep(one, given.parameter, given.jobs, given.limit)]
    print(f"{len(found)} runs, {found.count('LONG')} long, {found.count('BAD')} not right")
    return int("BAD" in found)


if __name__ == "__main__":
    sys.exit(main())
