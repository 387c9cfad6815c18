"""Start a report: copy one that has a notebook, a claim and a figure, to be changed."""

import shutil
import sys
from pathlib import Path

from reportkit.program import run

STARTER = Path(__file__).parent / "starter"


def main(folder: Path) -> None:
    """Run ``python -m reportkit.start FOLDER``: copy the report into a folder, made if missing.

    Raises
    ------
    FileExistsError
        If a file that would be written is there already; then nothing is written.
    """
    for path in STARTER.rglob("*"):
        copy = folder / path.relative_to(STARTER)
        if path.is_file() and copy.exists():
            raise FileExistsError(f"{copy} is there already: a report starts from nothing")
    shutil.copytree(STARTER, folder, dirs_exist_ok=True)


if __name__ == "__main__":
    sys.exit(run(main, sys.argv[1:]))
