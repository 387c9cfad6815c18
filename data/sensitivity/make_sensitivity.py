"""Halve and double each of our own choices, and note what becomes of every recorded value.

Run it as ``.venv/bin/python data/sensitivity/make_sensitivity.py``; it takes about half an hour. In
a copy of the repository one choice is changed in ``data/choices.toml``, the notebooks that use it
are executed, and what they record is written to ``choices.csv``, the verdicts that follow to
``verdicts.csv``. A notebook that fails leaves its message. A value that a change makes
meaningless is missing, and a verdict that needs it is empty.
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

from armbook.sensitivity import BASE, FAILS
from armsim.choices import CHOICES
from reportkit import claims
from reportkit.check import load_all

ROOT = Path(__file__).resolve().parents[2]
#: Those that run the arm and measure no times; 60 and 62 compare methods, 12 and 64 have no arm.
ARM = """10_model 14_exponential_form 20_linear_step_response 30_nonlinear_step_response
40_exact_solution 50_programmed_move 52_parameter_fit 54_parameter_study""".split()
USED_BY = {key: ARM for key in ("K_e", "F_0", "v_s")} | {
    key: ["50_programmed_move"] for key in ("K_p", "K_I", "K_v", "acceleration")
}
FACTORS = {0.5: "halved", 2.0: "doubled"}
TOLD = {"v_s": "threshold velocity $v$", "acceleration": "acceleration of the move"}


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


#: Rows of the values, and of the verdicts.
Rows = tuple[list[list[object]], list[list[object]]]


def outcomes(copy: Path, choice: str, factor: float) -> Rows:
    """Rows of both files for one change."""
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
    return rows, verdicts(f"{TOLD.get(choice, f'${choice}$')} {FACTORS[factor]}", results)


def recorded(choice: str, factor: float, study: str, records: dict) -> list[list[object]]:
    """Rows of one study's values, without those that measure time."""
    return [
        [choice, factor, study, name, record["value"]]
        for name, record in records.items()
        if record.get("compared", True)
    ]


def verdicts(variation: str, results: Path) -> list[list[object]]:
    """Rows of the verdicts that follow; empty where a value is missing."""
    records, rows = load_all(results), []
    for claim in claims.load(ROOT / "data" / "paper" / "claims.toml"):
        try:
            verdict = claim.verdict(records)
        except claims.ClaimError:
            verdict = ""
        rows.append([variation, claim.name, verdict])
    return rows


def published() -> Rows:
    """Rows of the book's own values, and of its verdicts."""
    expected = ROOT / "data" / "expected"
    rows = [row for study in ARM for row in recorded(BASE, 1.0, study, load_all(expected)[study])]
    return rows, verdicts(claims.PUBLISHED, expected)


def copy_to(folder: Path) -> Path:
    """Copy what the notebooks need."""
    for part in ("src", "data", "notebooks", "tests/reference"):
        shutil.copytree(ROOT / part, folder / part)
    return folder


def work(copy: str, tasks: list[tuple[str, float]]) -> dict[tuple[str, float], Rows]:
    """Make the changes of one worker in its own copy."""
    folder, found = copy_to(Path(copy)), {}
    for task in tasks:
        found[task] = outcomes(folder, *task)
        print(*task, flush=True)
    return found


def write(name: str, heading: list[str], rows: list[list[object]]) -> None:
    """Write one of the two files."""
    with (ROOT / "data" / "sensitivity" / name).open("w", newline="\n") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(heading)
        writer.writerows(rows)


def main() -> None:
    """Make ``choices.csv`` and ``verdicts.csv``."""
    tasks = [(choice, factor) for choice in USED_BY for factor in FACTORS]
    workers = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as scratch, multiprocessing.Pool(workers) as pool:
        shares = [(f"{scratch}/{n}", tasks[n::workers]) for n in range(workers)]
        found = {task: rows for part in pool.starmap(work, shares) for task, rows in part.items()}
    parts = [published(), *(found[task] for task in tasks)]
    values, outcomes_of_claims = ([row for part in parts for row in part[n]] for n in (0, 1))
    write("choices.csv", ["choice", "factor", "study", "name", "value"], values)
    write("verdicts.csv", ["variation", "claim", "verdict"], outcomes_of_claims)


if __name__ == "__main__":
    main()
