"""The command line of a report: list its notebooks, rerun one, check what was built.

Modules that are slow to import are imported by the command that needs them.
"""

import json
import shutil
import sys
from dataclasses import asdict
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import click

from reportkit import check, parameters, text
from reportkit.program import FAILED, INTERRUPTED, MISUSED
from reportkit.project import Project, ProjectError, read_toml


def main(arguments: list[str] | None = None, project: Project | None = None) -> int:
    """Run the command and return its exit code.

    The code is 0 for success, 1 if a notebook failed or a value moved, 2 for an invalid command or
    a file that cannot be read or written, and 130 after an interruption.
    """
    arguments, command = sys.argv[1:] if arguments is None else arguments, ""
    try:
        project = project or Project.find()
        command = f"{project.name} {' '.join(arguments[:1])}: "
        return commands.main(arguments, project.name, standalone_mode=False, obj=project) or 0
    except (ProjectError, OSError) as error:
        print(f"{command}{error}", file=sys.stderr)
        return getattr(error, "code", MISUSED)
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort:
        print(f"{command}interrupted, nothing half-written", file=sys.stderr)
        return INTERRUPTED


def _once(_: click.Context, option: click.Parameter, given: tuple[Path, ...]) -> Path | None:
    if len(given) > 1:
        raise parameters.ParameterError(f"{option.opts[0]}: given twice")
    return given[0] if given else None


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def commands() -> None:
    """Rerun the report's notebooks with other parameters; check what was built."""


@commands.command("list")
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True, help="For scripts.")
@click.pass_obj
def list_(project: Project, name: str | None, as_json: bool) -> None:
    """Show the notebooks and their parameters, or those of one."""
    names = [name] if name else [path.name for path in parameters.sources(project.notebooks)]
    choices = project.read_choices()
    found = [parameters.find(one, project.notebooks, choices) for one in names]
    if as_json:
        click.echo(json.dumps([*map(_described, found)], indent=1))
    else:
        width = min(shutil.get_terminal_size((88, 24)).columns, 100)
        click.echo("\n".join(_shown(notebook, width) for notebook in found), nl=False)


def _described(notebook: parameters.Notebook) -> dict[str, Any]:
    items = (asdict(one) | {"type": one.kind.__name__} for one in notebook.parameters.values())
    about = {key: getattr(notebook, key) for key in ("name", "title", "summary")}
    return about | {"parameters": list(items), "conditions": list(notebook.conditions)}


def _shown(notebook: parameters.Notebook, width: int) -> str:
    def fill(line: str, indent: int, hanging: int = 0) -> str:
        return click.wrap_text(line, width, " " * indent, " " * (indent + hanging))

    lines = [notebook.name, fill(f"{notebook.title}. {notebook.summary}", 2)]
    for item in notebook.parameters.values():
        default = json.dumps(item.default, ensure_ascii=False)
        lines += [fill(f"{item.name} = {default}", 4, 4), fill(f"{item.help}: {item.wanted}", 8)]
    lines += [fill(f"only with {one}", 4, 4) for one in notebook.conditions]
    return "\n".join(lines) + "\n"


@commands.command()
@click.argument("name")
@click.option(
    "-p", "--parameter", "given", nargs=2, multiple=True, metavar="KEY VALUE",
    help="A parameter, as the list shows them; a list is written 1,2,3. May be repeated.",
)  # fmt: skip
@click.option(
    "-f",
    "--file",
    type=Path,
    metavar="TOML",
    multiple=True,
    callback=_once,
    help="A file of KEY = VALUE; -p wins.",
)
@click.option("-o", "--output", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
              multiple=True, callback=_once, default=["runs"], show_default=True,
              help="Where the folder NAME-<time> is made.")  # fmt: skip
@click.pass_obj
def rerun(project: Project, name: str, given: Any, file: Path | None, output: Path) -> None:
    """Execute a notebook with other parameters."""
    notebook = parameters.find(name, project.notebooks, project.read_choices())
    check = project.checks.get(notebook.name)
    try:
        values = notebook.values(given, read_toml(file) if file else {})
        notice = resolve_name(check)(notebook.defaults | values) if check else ""
    except (ValueError, ArithmeticError) as error:
        raise parameters.ParameterError(error) from None
    from reportkit.execute import be_a_program
    from reportkit.rerun import rerun

    be_a_program()
    click.echo(f"{notebook.name}: executing{notice}")
    folder, comparisons, complaints = rerun(notebook, values, output, project)
    for complaint in complaints:
        click.echo(f"{notebook.name} warned: {complaint}", err=True)
    click.echo(_told(comparisons))
    click.echo(f"{click.format_filename(folder / notebook.name)}.html")


def _told(pairs: list[check.Comparison]) -> str:
    if not pairs:
        return "there are no published values to compare with"
    rows = [pair.change for pair in pairs if pair.moved]
    count = f"{len(rows)} of {len(pairs)} recorded values changed"
    return f"{text.columns(check.CHANGE, rows)}\n{count}" if rows else count


@commands.command("check")
@click.option("--update", is_flag=True, help="Take the results as the expected values.")
@click.pass_obj
def check_(project: Project, update: bool) -> int:
    """Compare the results with the expected values."""
    pairs = check.compare_folders(project.results, project.expected)
    moved = [pair.row() for pair in pairs if pair.moved]
    if moved:
        click.echo(text.columns(["name", "expected", "got", "tolerance", "notebook"], moved))
    if update:
        check.update(pairs, project.expected)
        click.echo(f"{len(moved)} expectations updated in {project.expected}")
    elif moved:
        click.echo(f"{len(moved)} of {len(pairs)} values moved. If intended: "
                   f"{project.name} check --update")  # fmt: skip
    else:
        click.echo(f"{len(pairs)} values are as expected")
    return FAILED if moved and not update else 0


if __name__ == "__main__":
    sys.exit(main())
