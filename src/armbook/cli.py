"""The command ``armsim``: the report's command line, if the book's packages are installed."""

import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    """Run ``armsim list``, ``rerun`` or ``check``; see `reportkit.cli.main`."""
    try:
        from reportkit import cli, project

        report = project.Project.find(Path(__file__))
    except ModuleNotFoundError as error:
        print(f"armsim: this command needs the packages of the book ({error.name} is missing): "
              "pip install 'armsim[book]'", file=sys.stderr)  # fmt: skip
        return 2
    except project.ProjectError:
        print("armsim: the notebooks come with the repository, not with the package",
              file=sys.stderr)  # fmt: skip
        return 2
    return cli.main(arguments, report)


if __name__ == "__main__":
    sys.exit(main())
