"""The command ``armsim``: the report's command line, if the packages of the book are there."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_ADVICE = """\
armsim: the report's command line needs the packages of the book ({missing} is missing).
Install them with: pip install 'armsim[book]'
"""


def main(arguments: list[str] | None = None) -> int:
    """Run ``armsim list``, ``rerun`` or ``check``; see `reportkit.cli.main`."""
    try:
        from reportkit import cli
        from reportkit.project import Project, ProjectError
    except ModuleNotFoundError as error:
        sys.stderr.write(_ADVICE.format(missing=error.name))
        return 2
    try:
        project = Project.read(ROOT)
    except ProjectError:
        sys.stderr.write("armsim: the notebooks come with the repository, not with the package\n")
        return 2
    return cli.main(arguments, project)


if __name__ == "__main__":
    sys.exit(main())
