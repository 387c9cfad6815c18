"""A second build of the notebooks gives the bytes of the first."""

import json
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "book" / "results"
#: What takes long, and measures nothing, and runs the same code as the others.
LEFT_OUT = {"52_parameter_fit", "54_parameter_study", "70_explorer"}


def measures_time(records: Path) -> bool:
    values = json.loads(records.read_text(encoding="utf-8")).values()
    return any(not record.get("compared", True) for record in values)


STUDIES = [
    path.stem
    for path in sorted(RESULTS.glob("[0-9][0-9]_*.json"))
    if path.stem not in LEFT_OUT and not measures_time(path)
]


@pytest.fixture(scope="module")
def again(tmp_path_factory):
    """Execute them all a second time, as make does."""
    folder = tmp_path_factory.mktemp("again")

    def execute(study):
        command = [sys.executable, "-m", "reportkit.execute", f"notebooks/{study}.ipynb"]
        subprocess.run([*command, folder], cwd=ROOT, check=True, capture_output=True)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(execute, STUDIES))
    return folder


@pytest.mark.skipif(not STUDIES, reason="there are no results: make book")
@pytest.mark.parametrize("study", STUDIES)
def test_second_build_gives_the_same_bytes(study, again):
    files = [path.name for path in RESULTS.glob(f"{study}*") if not path.match("*-seconds.txt")]
    assert f"{study}.ipynb" in files
    for name in files:
        assert (again / name).read_bytes() == (RESULTS / name).read_bytes(), name


def test_makefile_lets_what_compares_times_run_alone():
    rule = re.search(r"^TIMED := .*addsuffix %,([\d ]+)\)", (ROOT / "Makefile").read_text(), re.M)
    notebooks = sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"))
    timed, noted = (
        [p.stem[:2] for p in notebooks if re.search(rf"\b{function}\(", p.read_text())]
        for function in ("measure", "spent")  # the second adds up what a notebook has used
    )
    assert rule and timed and rule[1].split() == timed
    records = sorted(RESULTS.glob("[0-9][0-9]_*.json"))
    assert sorted(timed + noted) == [p.stem[:2] for p in records if measures_time(p)]
