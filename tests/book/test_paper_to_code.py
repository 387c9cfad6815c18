"""The page that leads from the paper to the code names what exists, and all of the paper."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "book" / "paper_to_code.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(armsim\.[\w.]+)`", TEXT))))
def test_what_is_named_exists(name):
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:n]))
        except ImportError:
            continue
        for part in parts[n:]:
            found = getattr(found, part)
        return
    pytest.fail(f"no module of {name}")


def test_notebooks_are_those_there_are():
    named = set(re.findall(r"<results/(\w+)>", TEXT))
    assert named <= {path.stem for path in (ROOT / "notebooks").glob("*.ipynb")}
    assert len(named) >= 8


def test_all_of_the_paper_is_there():
    section = TEXT.partition("## Section 3")
    for part in (section[0], section[2]):  # the paper uses the numbers twice
        assert {f"({n})" for n in range(10, 17)} <= set(re.findall(r"\(\d+\)", part))
    for name in [f"Table {n}" for n in range(1, 6)] + [f"Figure {n}" for n in range(1, 6)]:
        assert name in section[2]
    keys = re.findall(r"`(rk\d|ndp\d)`", section[0])
    assert sorted(keys) == ["ndp5", "ndp6", "rk5", "rk6"]
