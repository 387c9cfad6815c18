"""Changes of the recorded values with our own choices, from ``data/sensitivity/choices.csv``."""

from pathlib import Path

import pandas as pd

from armsim.arm import AxisParameters
from armsim.paths import DATA

BASE = "published"  #: in place of a choice: the values of the book
FAILS = "fails"  #: in place of a name: a notebook that could not be executed


def load(path: Path = DATA / "sensitivity" / "choices.csv") -> pd.DataFrame:
    """Read the file and put each value beside the published one.

    Returns
    -------
    DataFrame
        One row for each changed choice and recorded value, with the columns ``choice``,
        ``factor``, ``study``, ``name``, ``published`` and ``value`` (texts), ``change`` (in per
        cent of the published value; NaN if one of them is no number, is missing, or if the
        published one is zero) and ``differs``.
    """
    rows = pd.read_csv(path, dtype=str, keep_default_na=False)
    key = ["study", "name"]
    base = rows[rows["choice"] == BASE].set_index(key)["value"].rename("published")
    table = rows[rows["choice"] != BASE].join(base, on=key)
    before, after = (pd.to_numeric(table[name], errors="coerce") for name in ("published", "value"))
    table["change"] = (100 * (after - before) / before.abs()).where(before != 0)
    table["differs"] = table["value"] != table["published"]
    table["factor"] = table["factor"].astype(float)
    columns = ["choice", "factor", "study", "name", "published", "value", "change", "differs"]
    return table[columns].reset_index(drop=True)


def recorded(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of recorded values, without notebooks that fail."""
    return table[table["name"] != FAILS]


def largest(table: pd.DataFrame) -> pd.Series:
    """Larger of the changes of a value, in size, when a choice is halved and doubled; in per cent.

    The index is that of choice, study and name.
    """
    key = ["choice", "study", "name"]
    return table.assign(size=table["change"].abs()).groupby(key, sort=False)["size"].max()


def smallest_gain(p: AxisParameters, velocity: float = 1.0) -> float:
    """Smallest forward gain K_e in V/V with which an axis can hold a velocity in m/s.

    There the preamplifier is at its limit: K_e (V_L - I/K_i) drives the motor's current I against
    friction, its resistance and its back EMF.
    """
    speed = velocity / p.r_g
    current = (p.B_m * speed + p.r_g * p.B_a * velocity) / p.K_b
    return (p.R_a * current + p.K_b * speed) / (p.V_L - current / p.K_i)


def counts(table: pd.DataFrame) -> pd.DataFrame:
    """Count for each changed choice the values and those that move.

    A text, such as the name of a pair, counts as moved if it is another one.
    """
    rows = []
    for (choice, factor), part in table.groupby(["choice", "factor"], sort=False):
        values = recorded(part)
        size = values["change"].abs()
        other = values["change"].isna() & values["differs"]
        moved = {f"{by:g} %": int(((size > by) | other).sum()) for by in (0.1, 1, 10)}
        failed = {"failed": ", ".join(part[part["name"] == FAILS]["study"])}
        rows.append({"choice": choice, "factor": factor, "values": len(values)} | moved | failed)
    return pd.DataFrame(rows)
