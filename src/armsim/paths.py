"""Location of the data, in a checkout or in an installed package."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent

#: The folder ``data`` of the repository, or its copy in an installed wheel.
DATA = next(
    folder for folder in (_PACKAGE / "data", _PACKAGE.parents[1] / "data") if folder.is_dir()
)
