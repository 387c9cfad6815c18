"""Our choices for values that the paper does not give, read from ``data/choices.toml``."""

from typing import Any

from armsim.paths import read_toml

#: Tables of numbers in SI units: ``axis`` (by axis name), ``control`` and ``move``.
CHOICES: dict[str, dict[str, Any]] = read_toml("choices.toml")
