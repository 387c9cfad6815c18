"""Halve and double each of our own choices, and note what becomes of every recorded value.

Run it as ``.venv/bin/python data/sensitivity/make_sensitivity.py``; it takes about half an hour. In
a copy of the repository one choice is changed in ``data/choices.toml``, the notebooks that use it
are executed, and what they record is written to ``choices.csv``, with the verdicts that follow. A
notebook that fails leaves its message.
"""

import csv
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from armbook.sensitivity import BASE, FAILS, VERDICTS
from armsim.choices import CHOICES
from reportkit import claims
from reportkit.check import load_all

ROOT = Path(__file__).resolve().parents[2]
#: Those that run the arm and measure no times; 60 and 62 compare methods, 12 and 64 have no arm.
ARM = """10_model 14_exponential_form 20_linear_step_response 30_nonlinear_step_response
40_exact_solution 50_programmed_move 52_parameter_fit 54_parameter_study""".split()
USED_BY = {key: ARM for key in ("K_e", "F_0", "v_s")} | {
    key: ["50_programmed_move"] for key in ("K_p", "K_I", "K_v")
}
FACTORS = (0.5, 2.0)


def change(choices: dict, name: str, factor: float) -> dict:
    """Multiply a choice in every table that has it."""
    return {
        key: change(value, name, factor)
        if isinstance(value, dict)
        else factor * value
        if key == name
        else value
        for key, value in choices.items()
    }


def toml(choices: dict, table: str = "") -> str:
    """Text of a file of numbers in tables."""
    lines = [f"{key} = {value!r}" for key, value in choices.items() if not isinstance(value, dict)]
    parts = [f"[{table}]", *lines] if lines else []
    for key, value in choices.items():
        if isinstance(value, dict):
            parts.append(toml(value, f"{table}.{key}".strip(".")))
    return "\n".join(parts) + "\n"


def outcomes(copy: Path, choice: str, factor: float) -> list[list[object]]:
    """Rows of the file for one change."""
    changed = change(CHOICES, choice, factor)
    assert changed != CHOICES, choice
    (copy / "data" / "choices.toml").write_text(toml(changed), encoding="utf-8")
    results = copy / "book" / "results"
    shutil.rmtree(results, ignore_errors=True)
    shutil.copytree(ROOT / "data" / "expected", results)
    environment = os.environ | {"PYTHONPATH": str(copy / "src")}
    rows: list[list[object]] = []
    for notebook in USED_BY[choice]:
        command = [sys.executable, "-m", "reportkit.execute", f"notebooks/{notebook}.ipynb"]
        done = subprocess.run(
            [*command, str(results)], cwd=copy, env=environment, capture_output=True, text=True
        )
        if done.returncode:
            rows.append([choice, factor, notebook, FAILS, done.stderr.strip().split("\n")[-1]])
            continue
        records = json.loads((results / f"{notebook}.json").read_text(encoding="utf-8"))
        rows += recorded(choice, factor, notebook, records)
    return rows + verdicts(choice, factor, results)


def recorded(choice: str, factor: float, study: str, records: dict) -> list[list[object]]:
    """Rows of one study's values, without those that measure time."""
    return [
        [choice, factor, study, name, record["value"]]
        for name, record in records.items()
        if record.get("compared", True)
    ]


def verdicts(choice: str, factor: float, results: Path) -> list[list[object]]:
    """Rows of the verdicts that follow."""
    records = load_all(results)
    return [
        [choice, factor, VERDICTS, c.name, c.verdict(records)]
        for c in claims.load(ROOT / "data" / "paper" / "claims.toml")
    ]


def published() -> list[list[object]]:
    """Rows of the book's own values and verdicts."""
    expected = ROOT / "data" / "expected"
    rows = [row for study in ARM for row in recorded(BASE, 1.0, study, load_all(expected)[study])]
    return rows + verdicts(BASE, 1.0, expected)


def copy_to(folder: Path) -> Path:
    """Copy what the notebooks need."""
    for part in ("src", "data", "notebooks", "tests/reference"):
        shutil.copytree(ROOT / part, folder / part)
    return folder


def work(copy: str, tasks: list[tuple[str, float]]) -> list[list[object]]:
    """Make the changes of one worker in its own copy."""
    folder, rows = copy_to(Path(copy)), []
    for task in tasks:
        rows += outcomes(folder, *task)
        print(*task, flush=True)
    return rows


def main() -> None:
    """Make ``choices.csv``."""
    tasks = [(choice, factor) for choice in USED_BY for factor in FACTORS]
    workers = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as scratch, multiprocessing.Pool(workers) as pool:
        shares = [(f"{scratch}/{n}", tasks[n::workers]) for n in range(workers)]
        rows = [row for part in pool.starmap(work, shares) for row in part]
    rows.sort(key=lambda row: tasks.index((row[0], row[1])))
    with (ROOT / "data" / "sensitivity" / "choices.csv").open("w", newline="\n") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["choice", "factor", "study", "name", "value"])
        writer.writerows(published() + rows)


if __name__ == "__main__":
    main()
