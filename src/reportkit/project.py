"""Where a report keeps its files: the table ``[tool.reportkit]`` of its ``pyproject.toml``.

Every path is relative to the folder of that file, the root of the report.
"""

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self


class ProjectError(ValueError):
    """A report whose settings are missing or wrong, told in one line."""


@dataclass(frozen=True)
class Project:
    """A report and its files.

    Parameters
    ----------
    root : path
        Folder of ``pyproject.toml``.
    name : str
        Name of the report, and of the distribution that it installs.
    notebooks, results, expected, claims, data, mathjax : str
        Relative to `root`: sources of the notebooks; what they made; what a rebuild must
        reproduce; claims and their criteria; the data whose sums are told; the script that
        typesets mathematics on the page of a rerun.
    versions : tuple of str
        Packages whose versions are told beside every result.
    """

    root: Path
    name: str
    notebooks: Path = Path("notebooks")
    results: Path = Path("book/results")
    expected: Path = Path("data/expected")
    claims: Path = Path("data/claims.toml")
    data: Path = Path("data")
    mathjax: Path = Path("book/_static/mathjax/tex-svg-full.js")
    versions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for item in fields(self)[2:-1]:
            object.__setattr__(self, item.name, self.root / getattr(self, item.name))

    @classmethod
    def read(cls, root: Path) -> Self:
        """Read the settings from ``root/pyproject.toml``.

        Raises
        ------
        ProjectError
            If the file or the table is missing, or a name in it is missing or not known.
        """
        path = root / "pyproject.toml"
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8"))["tool"]["reportkit"]
        except (OSError, tomllib.TOMLDecodeError, KeyError) as error:
            raise ProjectError(f"{path}: no table [tool.reportkit]: {error!r}") from None
        try:
            return cls(root, **table)
        except TypeError as error:
            raise ProjectError(f"{path}, [tool.reportkit]: {error}") from None

    @classmethod
    def find(cls, start: Path | None = None) -> Self:
        """Read the settings of the report that a folder, by default the current one, lies in.

        Raises
        ------
        ProjectError
            If the folder lies in no report.
        """
        start = (start or Path.cwd()).resolve()
        for folder in (start, *start.parents):
            path = folder / "pyproject.toml"
            if path.is_file() and "[tool.reportkit]" in path.read_text(encoding="utf-8"):
                return cls.read(folder)
        raise ProjectError(f"{start}: neither here nor above is a pyproject.toml with "
                           "[tool.reportkit]")  # fmt: skip
