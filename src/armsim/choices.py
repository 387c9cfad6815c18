"""Our choices for values that the paper does not give, read from ``data/choices.toml``."""

import tomllib
from typing import Any

from armsim.paths import DATA

#: Tables of numbers in SI units: ``axis`` (by axis name), ``control`` and ``move``.
CHOICES: dict[str, dict[str, Any]] = tomllib.loads(
    (DATA / "choices.toml").read_text(encoding="utf-8")
)
