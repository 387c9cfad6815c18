"""Where the files that are not code lie: in a checkout, or inside an installed package."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parents[1]

#: The folder ``data`` of the repository, or its copy in an installed wheel.
DATA = next(folder for folder in (_PACKAGE / "data", _CHECKOUT / "data") if folder.is_dir())

# These exist in a checkout only, the results only once they are built.
NOTEBOOKS = _CHECKOUT / "notebooks"
RESULTS = _CHECKOUT / "book" / "results"
MATHJAX = _CHECKOUT / "book" / "_static" / "mathjax" / "tex-svg-full.js"

#: Set by the build to a folder that replaces the published results only when all went well.
RESULTS_VARIABLE = "ARMSIM_RESULTS"
