"""Numbers that decide a verdict, computed again by scripts that share no code with the project.

The scripts beside this file import NumPy, SciPy, mpmath and python-flint only, and read the paper's
tables. What they find is compared with the record that the book is checked against.
"""

import ast
import importlib
import json
import sys
import tomllib
from pathlib import Path

import pytest

HERE = Path(__file__).parent
DATA = HERE.parents[1] / "data"
SCRIPTS = {path.stem: path for path in HERE.glob("*.py") if path.stem != "conftest"}
del SCRIPTS["test_second_opinion"]
ALLOWED = {"numpy", "scipy", "mpmath", "flint", *SCRIPTS, *sys.stdlib_module_names}
OPINIONS = tomllib.loads((DATA / "second_opinions.toml").read_text(encoding="utf-8"))["opinion"]


def load(path):
    return json.loads(path.read_text(encoding="utf-8"))


RECORDS = {path.stem: load(path) for path in (DATA / "expected").glob("*.json")}


def record(place):
    study, _, name = place.partition("::")
    return RECORDS[study][name]


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_share_nothing_with_the_project(name):
    tree = ast.parse(SCRIPTS[name].read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found.add((node.module or "").split(".")[0])
    assert found <= ALLOWED
    assert not {"armsim", "armbook", "reportkit"} & found


@pytest.mark.parametrize("opinion", OPINIONS, ids=lambda opinion: opinion["script"])
def test_second_opinion_agrees_with_the_record(opinion, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    found = importlib.import_module(Path(opinion["script"]).stem).opinions()
    assert sorted(found) == sorted(opinion["values"])
    for place, (value, tolerance) in found.items():
        assert abs(value - record(place)["value"]) <= tolerance, place


def test_every_deciding_number_has_a_second_opinion():
    """But measured times, which depend on the machine."""
    claims = tomllib.loads((DATA / "paper" / "claims.toml").read_text(encoding="utf-8"))["claim"]
    deciding = {
        place
        for claim in claims
        for tests in (
            claim.get("tests", []),
            claim.get("corrected", []),
            *claim.get("readings", {}).values(),
        )
        for test in tests
        for place in test.values()
        if "::" in str(place)
    }
    computed = {place for opinion in OPINIONS for place in opinion["values"]}
    missing = {place for place in deciding if record(place).get("compared", True)} - computed
    assert missing == set()
