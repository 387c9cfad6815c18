"""Start a report: copy a small one with a notebook, a claim and a figure."""

import shutil
import sys
from pathlib import Path

STARTER = Path(__file__).parent / "starter"


def start(folder: Path) -> None:
    """Copy the report into a folder, which is made if missing.

    Raises
    ------
    FileExistsError
        If a file that would be written is there already; then nothing is written.
    """
    names = [path.relative_to(STARTER) for path in STARTER.rglob("*") if path.is_file()]
    for name in names:
        if (folder / name).exists():
            raise FileExistsError(f"{folder / name} exists already: use an empty folder")
    shutil.copytree(STARTER, folder, dirs_exist_ok=True)


def main(arguments: list[str]) -> int:
    """Run ``python -m reportkit.start FOLDER``; return the exit code."""
    if len(arguments) != 1:
        print("usage: python -m reportkit.start FOLDER", file=sys.stderr)
        return 2
    try:
        start(Path(arguments[0]))
    except OSError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
