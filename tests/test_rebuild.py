"""A second build of the notebooks gives the bytes of the first."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "book" / "results"
#: What takes long or runs the same code as the others.
LEFT_OUT = {
    "12_order_conditions",
    "20_linear_step_response",
    "30_nonlinear_step_response",
    "40_exact_solution",
    "52_parameter_fit",
    "54_parameter_study",
    "56_our_choices",
    "70_explorer",
}


def measures_time(records: Path) -> bool:
    values = json.loads(records.read_text(encoding="utf-8")).values()
    return any(not record.get("compared", True) for record in values)


STUDIES = [
    path.stem
    for path in sorted(RESULTS.glob("[0-9][0-9]_*.json"))
    if path.stem not in LEFT_OUT and not measures_time(path)
]


@pytest.mark.skipif(not STUDIES, reason="there are no results: make book")
@pytest.mark.parametrize("study", STUDIES)
def test_second_build_gives_the_same_bytes(study, tmp_path):
    command = [sys.executable, "-m", "reportkit.execute", f"notebooks/{study}.ipynb", tmp_path]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    files = [path.name for path in RESULTS.glob(f"{study}*") if not path.match("*-seconds.txt")]
    assert f"{study}.ipynb" in files
    for name in files:
        assert (tmp_path / name).read_bytes() == (RESULTS / name).read_bytes(), name


@pytest.mark.skipif(not STUDIES, reason="there are no results: make book")
def test_what_records_a_time_measures_it_or_adds_it_up():
    """`measure` compares times, so make runs it alone; `spent` is what a notebook has used."""
    found = [
        path.stem
        for path in sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"))
        if re.search(r"\b(measure|spent)\(", path.read_text(encoding="utf-8"))
    ]
    records = sorted(RESULTS.glob("[0-9][0-9]_*.json"))
    assert found == [path.stem for path in records if measures_time(path)]
