"""The command line of a report: list its notebooks, rerun one, check what was built.

Modules that are slow to import are imported by the command that needs them.
"""

import json
import shutil
import signal
import sys
import textwrap
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from reportkit import check, parameters, text
from reportkit.check import Comparison
from reportkit.parameters import Notebook, ParameterError
from reportkit.project import Project, ProjectError

CHANGED, MISUSED, INTERRUPTED = 1, 2, 130
Folder = click.Path(path_type=Path)


def main(arguments: list[str] | None = None, project: Project | None = None) -> int:
    """Run the command and return its exit code.

    The code is 0 for success, 1 if a notebook failed or a value moved, 2 for an invalid command
    and 130 after an interruption.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        project = project or Project.find()
    except ProjectError as error:
        print(error, file=sys.stderr)
        return MISUSED
    try:
        return commands.main(arguments, project.name, standalone_mode=False, obj=project) or 0
    except ParameterError as error:
        print(f"{project.name} {arguments[0]}: {error}", file=sys.stderr)
        return MISUSED
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort:
        return INTERRUPTED


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def commands() -> None:
    """Rerun the report's notebooks with other parameters; check what was built."""


_NOTEBOOKS = click.option(
    "--notebooks", type=Folder, metavar="DIR", help="Notebooks other than the report's."
)


@commands.command("list")
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True, help="For scripts.")
@_NOTEBOOKS
@click.pass_obj
def list_(project: Project, name: str | None, as_json: bool, notebooks: Path | None) -> None:
    """Show the notebooks and their parameters, or those of one."""
    folder = notebooks or project.notebooks
    choices = project.read_choices()
    if name:
        found = [parameters.find(name, folder, choices)]
    else:
        found = [parameters.read(path, choices) for path in parameters.sources(folder)]
    if as_json:
        click.echo(json.dumps([_described(notebook) for notebook in found], indent=1))
    else:
        width = min(shutil.get_terminal_size((88, 24)).columns, 100)
        click.echo("\n".join(_shown(notebook, width) for notebook in found), nl=False)


def _described(notebook: Notebook) -> dict[str, Any]:
    items = (asdict(one) | {"type": one.kind.__name__} for one in notebook.parameters.values())
    about = {key: getattr(notebook, key) for key in ("name", "title", "summary")}
    return about | {"parameters": list(items)}


def _shown(notebook: Notebook, width: int) -> str:
    def fill(line: str, indent: int, hanging: int = 0) -> str:
        return textwrap.fill(line, width, initial_indent=" " * indent,
                             subsequent_indent=" " * (indent + hanging))  # fmt: skip

    lines = [notebook.name, fill(f"{notebook.title}. {notebook.summary}", 2)]
    for item in notebook.parameters.values():
        default = json.dumps(item.default, ensure_ascii=False)
        lines += [fill(f"{item.name} = {default}", 4, 4), fill(f"{item.help}: {item.wanted}", 8)]
    return "\n".join(lines) + "\n"


@commands.command()
@click.argument("name")
@click.option(
    "-p", "--parameter", "given", nargs=2, multiple=True, metavar="KEY VALUE",
    help="A parameter, as the list shows them; a list is written 1,2,3. May be repeated.",
)  # fmt: skip
@click.option("-f", "--file", metavar="TOML", help="A file of KEY = VALUE; -p wins.")
@click.option(
    "-o", "--output", type=Folder, default="runs", metavar="DIR", show_default=True,
    help="Where the folder NAME-<time> is made.",
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
    notebook = parameters.find(name, notebooks or project.notebooks, project.read_choices())
    values = notebook.values(given, _table(file))
    from reportkit.execute import NotebookError
    from reportkit.rerun import rerun

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    click.echo(f"{notebook.name}: executing")
    try:
        result = rerun(notebook, values, output, project)
    except KeyboardInterrupt:
        click.echo(f"{notebook.name}: interrupted, nothing written", err=True)
        return INTERRUPTED
    except (NotebookError, OSError) as error:
        click.echo(f"\n{error}\n", err=True)
        return CHANGED
    for complaint in result.complaints:
        click.echo(f"{notebook.name} warned: {complaint}", err=True)
    click.echo(_told(result.comparisons))
    click.echo(f"{result.folder / notebook.name}.html")
    return 0


def _table(name: str | None) -> dict[str, Any]:
    try:
        return tomllib.loads(Path(name).read_text(encoding="utf-8")) if name is not None else {}
    except (OSError, ValueError) as error:
        raise ParameterError(f"{name}: no TOML file of parameters: {error}") from None


def _told(pairs: list[Comparison]) -> str:
    if not pairs:
        return "there are no published values to compare with"
    changes = [pair.change() for pair in pairs if pair.moved]
    count = f"{len(changes)} of {len(pairs)} recorded values changed"
    heading = ["recorded value", "published", "now", "difference", "unit"]
    rows = ([*change[:4], change[5]] for change in changes)
    return f"{text.columns(heading, rows)}\n{count}" if changes else count


@commands.command("check")
@click.option("--update", is_flag=True, help="Take the results as the expected values.")
@click.option("--results", type=Folder, metavar="DIR", help="Results other than the report's.")
@click.option("--expected", type=Folder, metavar="DIR", help="Expectations other than its own.")
@click.pass_obj
def check_(project: Project, update: bool, results: Path | None, expected: Path | None) -> int:
    """Compare the results with the expected values."""
    expected = expected or project.expected
    try:
        pairs = check.compare_folders(results or project.results, expected)
    except (OSError, ValueError) as error:
        raise ParameterError(str(error)) from None
    moved = [pair.row() for pair in pairs if pair.moved]
    if moved:
        heading = ["name", "expected", "got", "tolerance", "notebook"]
        click.echo(text.columns(heading, moved))
    if update:
        check.update(pairs, expected)
        click.echo(f"{len(moved)} expectations updated in {expected}")
    elif moved:
        click.echo(f"{len(moved)} of {len(pairs)} values moved. If that is meant: "
                   f"{project.name} check --update")  # fmt: skip
    else:
        click.echo(f"{len(pairs)} values are as expected")
    return CHANGED if moved and not update else 0


if __name__ == "__main__":
    sys.exit(main())
