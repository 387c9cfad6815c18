"""Read the parameters of the x axis from the transcribed tables of the paper and our choices."""

import re
import tomllib
from pathlib import Path

DATA = Path(__file__).parents[2] / "data"


def load(name: str) -> dict:
    """Contents of a TOML file below data/."""
    return tomllib.loads((DATA / name).read_text(encoding="utf-8"))


def numbers(text: str) -> list[float]:
    r"""Numbers in a printed cell, such as `80 to 870` or `$5.264 \cdot 10^6$ N/m`."""
    plain = re.sub(r"\s*\\cdot 10\^(\d+)", r"e\1", text)
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?(?:e\d+)?", plain)]


def x_axis() -> dict[str, float]:
    """Parameters of the x axis: Tables 3 to 5 (column of the novel technique) and our choices."""
    tables = load("paper/tables.toml")
    rows = [row for n in (3, 4, 5) for row in tables[f"table{n}"] if "field" in row]
    p = {row["field"]: numbers(row.get("value") or row["ndp"])[0] for row in rows}
    p["K_2"] = max(numbers(next(row["value"] for row in rows if row["field"] == "K_2")))
    p["T_p"] = load("axes/x.toml")["axis"]["T_p"]  # Section 4; Table 4 gives a range
    del p["K_1"]  # a range as well; it follows from the steady state
    return p | load("choices.toml")["axis"]["x"]


def range_of(field: str) -> tuple[float, float]:
    """Printed range of a parameter of Table 4."""
    row = next(row for row in load("paper/tables.toml")["table4"] if row["field"] == field)
    low, high = numbers(row["value"])
    return low, high
