"""The command line of a report: list its notebooks, rerun one, check what was built.

What is slow to import is imported by the command that needs it.
"""

import json
import os
import shutil
import signal
import sys
import textwrap
import tomllib
from pathlib import Path
from typing import Any

import click

from reportkit import check, parameters
from reportkit.check import Comparison
from reportkit.parameters import Notebook, ParameterError
from reportkit.project import Project, ProjectError

CHANGED, MISUSED, INTERRUPTED = 1, 2, 130


def main(arguments: list[str] | None = None, project: Project | None = None) -> int:
    """Run the command and return its exit code.

    It is 0 if all went well, 1 if a notebook failed or a value moved, 2 if the command makes no
    sense, 130 after an interruption.
    """
    try:
        project = project or Project.find()
        return commands.main(arguments, project.name, standalone_mode=False, obj=project) or 0
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except ProjectError as error:
        print(error, file=sys.stderr)
        return MISUSED
    except click.Abort:
        return INTERRUPTED
    except BrokenPipeError:  # the reader, head for instance, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


class _Misuse(click.ClickException):
    exit_code = MISUSED

    def show(self, file: Any = None) -> None:
        """Tell it in one line."""
        print(self.message, file=file or sys.stderr)


class _Commands(click.Group):
    def invoke(self, context: click.Context) -> Any:
        """Run a command; a parameter that is not allowed is told with the command's name."""
        try:
            return super().invoke(context)
        except ParameterError as error:
            place = f"{context.command_path} {context.invoked_subcommand}"
            raise _Misuse(f"{place}: {error}") from None


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
def commands() -> None:
    """Rerun the report's notebooks with other parameters; check what was built."""


_NOTEBOOKS = click.option(
    "--notebooks", type=click.Path(path_type=Path), metavar="DIR",
    help="Where the notebooks are; by default those of the report.",
)  # fmt: skip


@commands.command("list")
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True, help="For scripts.")
@_NOTEBOOKS
@click.pass_obj
def list_(project: Project, name: str | None, as_json: bool, notebooks: Path | None) -> None:
    """Show the notebooks and their parameters, or those of one."""
    folder = notebooks or project.notebooks
    if name:
        found = [parameters.find(name, folder)]
    else:
        found = [parameters.read(path) for path in parameters.sources(folder)]
    if as_json:
        print(json.dumps([_described(notebook) for notebook in found], indent=1))
        return
    width = min(shutil.get_terminal_size((88, 24)).columns, 100)
    print("\n".join(_shown(notebook, width) for notebook in found), end="")


def _described(notebook: Notebook) -> dict[str, Any]:
    names = ("name", "default", "unit", "help", "allowed")
    items = [
        {name: getattr(item, name) for name in names} | {"type": item.kind.__name__}
        for item in notebook.parameters.values()
    ]
    about = {key: getattr(notebook, key) for key in ("name", "title", "summary")}
    return about | {"parameters": items}


def _shown(notebook: Notebook, width: int) -> str:
    def fill(text: str, indent: int, hanging: int = 0) -> str:
        first, rest = " " * indent, " " * (indent + hanging)
        return textwrap.fill(text, width, initial_indent=first, subsequent_indent=rest)

    lines = [notebook.name, fill(f"{notebook.title}. {notebook.summary}", 2)]
    for item in notebook.parameters.values():
        default = json.dumps(item.default, ensure_ascii=False)
        lines.append(fill(f"{item.name} = {default}", 4, 4))
        lines.append(fill(f"{item.help}: {item.wanted}", 8))
    return "\n".join(lines) + "\n"


@commands.command()
@click.argument("name")
@click.option(
    "-p", "--parameter", "given", nargs=2, multiple=True, metavar="KEY VALUE",
    help="A parameter, as the list shows them; a list is written 1,2,3. May be repeated.",
)  # fmt: skip
@click.option("-f", "--file", metavar="TOML", help="A file of KEY = VALUE; -p wins.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), default="runs", metavar="DIR",
    show_default=True, help="Where the folder NAME-<time> is made.",
)  # fmt: skip
@_NOTEBOOKS
@click.pass_obj
def rerun(
    project: Project,
    name: str,
    given: tuple[tuple[str, str], ...],
    file: str | None,
    output: Path,
    notebooks: Path | None,
) -> int:
    """Execute a notebook with other parameters."""
    notebook = parameters.find(name, notebooks or project.notebooks)
    values = notebook.values(given, _table(file))
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    print(f"{notebook.name}: executing", flush=True)
    try:
        from reportkit.execute import NotebookError
        from reportkit.rerun import rerun

        try:
            result = rerun(notebook, values, output, project)
        except (NotebookError, OSError) as error:
            print(f"\n{error}\n", file=sys.stderr)
            return CHANGED
    except KeyboardInterrupt:
        print(f"{notebook.name}: interrupted, nothing written", file=sys.stderr)
        return INTERRUPTED
    for complaint in result.complaints:
        print(f"{notebook.name} warned: {complaint}", file=sys.stderr)
    _tell(result.comparisons)
    print(f"{result.folder / notebook.name}.html")
    return 0


def _table(name: str | None) -> dict[str, Any]:
    if name is None:
        return {}
    try:
        return tomllib.loads(Path(name).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ParameterError(f"{name}: no TOML file of parameters: {error}") from None


def _tell(pairs: list[Comparison]) -> None:
    moved = [pair for pair in pairs if pair.moved]
    if moved:
        heading = ["recorded value", "published", "now", "difference", "unit"]
        print(check.layout([heading, *([*row[:4], row[5]] for row in map(check.compared, moved))]))
    print(f"{len(moved)} of {len(pairs)} recorded values changed" if pairs else
          "there are no published values to compare with")  # fmt: skip


@commands.command("check")
@click.option("--update", is_flag=True, help="Expect what was built.")
@click.option("--results", type=click.Path(path_type=Path), metavar="DIR",
              help="What was built; by default the report's results.")  # fmt: skip
@click.option("--expected", type=click.Path(path_type=Path), metavar="DIR",
              help="What is expected; by default the report's expectations.")  # fmt: skip
@click.pass_obj
def check_(project: Project, update: bool, results: Path | None, expected: Path | None) -> int:
    """Tell what moved between the built and the expected."""
    expected = expected or project.expected
    try:
        pairs = check.compare_folders(results or project.results, expected)
    except (OSError, ValueError) as error:
        raise ParameterError(str(error)) from None
    moved = [pair for pair in pairs if pair.moved]
    if moved:
        heading = ["name", "expected", "got", "tolerance", "notebook"]
        print(check.layout([heading, *(pair.row() for pair in moved)]))
    if update:
        check.update(pairs, expected)
        print(f"{len(moved)} expectations updated in {expected}")
        return 0
    if moved:
        print(f"{len(moved)} of {len(pairs)} values moved. If that is meant: "
              f"{project.name} check --update")  # fmt: skip
        return CHANGED
    print(f"{len(pairs)} values are as expected")
    return 0
