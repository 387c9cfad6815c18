"""Where a report keeps its files: the table ``[tool.reportkit]`` of its ``pyproject.toml``.

Every path is relative to the folder of that file, the root of the report.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Self

#: Environment variable with the folder of the results, set by the build.
RESULTS_VARIABLE = "REPORT_RESULTS"


class ProjectError(ValueError):
    """A part of a report is missing, wrong or fails; the message says which, and why."""


@dataclass(frozen=True)
class Project:
    """A report and its files.

    Parameters
    ----------
    root : path
        Folder of ``pyproject.toml``.
    name : str
        Name of the report and of its command; if the report is an installed distribution, the
        name of that too.
    notebooks, results, expected, claims, opinions, variations, choices, data, lock, mathjax : str
        Relative to `root`: sources of the notebooks; what they make; the values that a rebuild
        must reproduce; claims and their criteria; how recorded values were computed again; the
        verdicts with changed choices; a table of values that cells of parameters may refer to;
        the data whose SHA-256 sums are listed; the lock of the environment; the script that
        typesets mathematics on the page of a rerun.
    extra : str
        Extra of the distribution that the report needs.
    versions : tuple of str
        Packages whose versions the page of a rerun lists; the report itself may be one of them.
    checks : mapping of str to str
        For a notebook, a function ``package.module:name`` that takes its parameters before a rerun,
        for example to read files, and returns a notice or an empty text. It raises
        a ValueError, ArithmeticError or OSError if they are invalid.
    """

    root: Path
    name: str
    notebooks: Path = Path("notebooks")
    results: Path = Path("book/results")
    expected: Path = Path("data/expected")
    claims: Path = Path("data/claims.toml")
    opinions: Path = Path("data/second_opinions.toml")
    variations: Path = Path("data/verdicts.csv")
    choices: Path = Path("data/choices.toml")
    data: Path = Path("data")
    lock: Path = Path("environment.txt")
    mathjax: Path = Path("book/_static/mathjax/tex-svg-full.js")
    extra: str = ""
    versions: tuple[str, ...] = ()
    checks: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for item in fields(self)[1:]:
            if item.type is Path:
                object.__setattr__(self, item.name, self.root / getattr(self, item.name))

    def read_choices(self) -> dict[str, Any]:
        """Read the values that cells of parameters refer to; none if there is no such file."""
        return read_toml(self.choices) if self.choices.is_file() else {}

    @classmethod
    def find(cls, start: Path | None = None) -> Self:
        """Read the settings of the report that a folder, by default the current one, lies in.

        Raises
        ------
        ProjectError
            If the folder lies in no report, or a setting is missing, unknown or malformed.
        """
        start = (start or Path.cwd()).resolve()
        for folder in (start, *start.parents):
            path = folder / "pyproject.toml"
            try:
                text = path.read_text(encoding="utf-8") if path.is_file() else ""
                if "[tool.reportkit]" in text:
                    return cls(folder, **tomllib.loads(text)["tool"]["reportkit"])
            except (TypeError, ValueError, LookupError, OSError, RecursionError) as error:
                raise ProjectError(f"{path}, [tool.reportkit]: {error}") from None
        raise ProjectError(f"no pyproject.toml with [tool.reportkit] in {start} or above")


def read_toml(path: Path) -> dict[str, Any]:
    """Read a file in TOML, with or without a byte order mark.

    Raises
    ------
    ProjectError
        If it cannot be read; the message is one line.
    """
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise ProjectError(f"{path}: not a TOML file in UTF-8: {error}") from None
