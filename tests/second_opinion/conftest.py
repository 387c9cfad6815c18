"""Keeps pytest from collecting the scripts: they import each other, and a test runs them."""

from pathlib import Path

collect_ignore = [
    path.name for path in Path(__file__).parent.glob("*.py") if not path.name.startswith("test_")
]
