"""Files and texts as a report writes them: whole files, numbers and tables."""

import base64
import json
import re
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from jinja2 import Environment, PackageLoader, select_autoescape

Row: TypeAlias = Sequence[Any]  #: cells of a table

_EXPONENTIAL = re.compile(r"(?<![\w.])(\d+(?:\.\d*)?)e([-+−]\d+)\b")
_LONG = re.compile(r"(?<![\w.])\d{5,}(?![\w.])")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def render(template: str, **values: Any) -> str:
    """Fill one of the files in ``templates``."""
    return _TEMPLATES.get_template(template).render(values)


def studies(folder: Path, ending: str) -> list[Path]:
    """List the files of a folder that are named like a study; a copy, "10_model (1)", is not."""
    paths = sorted(folder.glob(f"[0-9][0-9]_*{ending}"))
    return [path for path in paths if path.stem.replace("_", "").isalnum()]


def write(path: Path, text: str) -> None:
    """Write a file so that it appears complete or not at all.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    text : str
        The content, written as UTF-8 with line feeds.
    """
    with tempfile.TemporaryDirectory(prefix=f".{path.stem}-", dir=path.parent) as folder:
        part = Path(folder, path.name)
        part.write_text(text, encoding="utf-8", newline="\n")
        part.replace(path)


def plain(text: str) -> str:
    """Return a text of a terminal without its colours."""
    return re.sub(r"\x1b\[[0-9;]*m", "", text)


def to_json(records: Any) -> str:
    """Return the text of the file that keeps records."""
    return json.dumps(records, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def number(value: Any, unit: str | None = None, digits: int = 12) -> str:
    """Return a recorded value as text, with its unit if it has one."""
    text = f"{value:.{digits}g}" if isinstance(value, float) else str(value)
    return text if unit in (None, "1") else f"{text} {unit}"


def powers(told: str) -> str:
    """Return a text with its exponential notation as powers on one line: 10⁻⁷ for ``1e-07``."""
    return _EXPONENTIAL.sub(_power, told)


def grouped(told: str) -> str:
    """Return a text with the digits of integers of five or more in groups of three."""
    return _LONG.sub(lambda found: f"{int(found[0]):,}".replace(",", "\u202f"), told)


def _power(found: re.Match[str]) -> str:
    raised = str(int(found[2].replace("−", "-"))).translate(_RAISED)
    factor = found[1].removesuffix(".")
    return f"10{raised}" if factor == "1" else f"{factor}\u00a0·\u00a010{raised}"


def columns(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table for the terminal, its columns aligned."""
    rows = [heading, *rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    rows.insert(1, ["-" * width for width in widths])
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def markdown_table(heading: Row, rows: Iterable[Row], right: Iterable[int] = ()) -> str:
    """Return a Markdown table for ``{include}``.

    Parameters
    ----------
    heading : sequence
        Headings of the columns.
    rows : iterable of sequences
        Cells; a bar in one is escaped, a line break becomes a space, ``5e-06`` is
        written as `powers` does, a number stays with its per cent sign, and the digits of
        a long integer stand in groups, except among formulas.
    right : iterable of int
        Numbers of the columns that are set flush right.
    """
    rules = ["---:" if n in set(right) else "---" for n in range(len(heading))]
    lines = [[_cell(cell) for cell in row] for row in (heading, *rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in (lines[0], rules, *lines[1:]))


def _cell(value: Any) -> str:
    told = powers(str(value)).replace("|", r"\|").replace("\n", " ")
    if "$" not in told:
        told = grouped(told)
    return re.sub(r"(?<=\d) (?=%)", "\u00a0", told)


def _base64(text: str) -> str:
    return base64.b64encode(text.encode()).decode()


_TEMPLATES = Environment(
    loader=PackageLoader("reportkit"), autoescape=select_autoescape(), trim_blocks=True,
    lstrip_blocks=True, keep_trailing_newline=True,
)  # fmt: skip
_TEMPLATES.filters |= {"base64": _base64, "cell": _cell, "number": number, "plain": plain}
