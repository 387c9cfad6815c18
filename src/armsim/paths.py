"""The data, in a checkout or in an installed package."""

import tomllib
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).resolve().parent

#: The folder ``data`` of the repository, or its copy in an installed wheel.
DATA = next(filter(Path.is_dir, (_PACKAGE / "data", _PACKAGE.parents[1] / "data")))


def read_toml(name: str) -> dict[str, Any]:
    """Read a TOML file of the data."""
    return tomllib.loads((DATA / name).read_text(encoding="utf-8"))
