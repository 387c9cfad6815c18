"""The command line: ``armsim list``, ``armsim rerun``, ``armsim check``.

What is slow to import is imported by the command that needs it.
"""

import argparse
import json
import os
import re
import shutil
import signal
import sys
import textwrap
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from armsim import paths
from armsim.report import expected, parameters
from armsim.report.expected import Comparison
from armsim.report.parameters import Notebook, ParameterError

CHANGED, MISUSED, INTERRUPTED = 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code.

    It is 0 if all went well, 1 if a notebook failed or a value moved, 2 if the command makes no
    sense, 130 after an interruption.
    """
    options = _parser().parse_args(arguments)
    try:
        return options.run(options)
    except ParameterError as error:
        print(f"armsim {options.command}: {error}", file=sys.stderr)
        return MISUSED
    except BrokenPipeError:  # the reader, head for instance, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="armsim",
        description="Rerun the report's notebooks with other parameters; check what was built.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    command = commands.add_parser("list", help="the notebooks and their parameters")
    command.add_argument("name", nargs="?", metavar="NAME", help="only this notebook")
    command.add_argument("--json", action="store_true", help="for scripts")
    _add_notebooks(command)
    command.set_defaults(run=_list)

    command = commands.add_parser("rerun", help="execute a notebook with other parameters")
    command._negative_number_matcher = re.compile(r"-\.?\d")  # -1e-3 and -1,-2 as well
    command.add_argument("name", metavar="NAME", help="the notebook, its topic or its number")
    command.add_argument(
        "-p", "--parameter", nargs=2, action="append", default=[], metavar=("KEY", "VALUE"),
        help="a parameter, as armsim list shows them; a list is written 1,2,3; may be repeated",
    )  # fmt: skip
    command.add_argument("-f", "--file", metavar="TOML", help="a file of KEY = VALUE; -p wins")
    command.add_argument(
        "-o", "--output", type=Path, default=Path("runs"), metavar="DIR",
        help="where the folder NAME-<time> is made (default: runs)",
    )  # fmt: skip
    _add_notebooks(command)
    command.set_defaults(run=_rerun)

    command = commands.add_parser("check", help="what moved between the built and the expected")
    command.add_argument("--update", action="store_true", help="expect what was built")
    command.add_argument("--results", type=Path, default=paths.RESULTS, metavar="DIR",
                         help="what was built (default: book/results)")  # fmt: skip
    command.add_argument("--expected", type=Path, default=paths.DATA / "expected", metavar="DIR",
                         help="what is expected (default: data/expected)")  # fmt: skip
    command.set_defaults(run=_check)
    return parser


def _add_notebooks(command: argparse.ArgumentParser) -> None:
    command.add_argument("--notebooks", type=Path, default=paths.NOTEBOOKS, metavar="DIR",
                         help="where the notebooks are (default: those of the report)")  # fmt: skip


def _list(options: argparse.Namespace) -> int:
    if options.name:
        notebooks = [parameters.find(options.name, options.notebooks)]
    else:
        notebooks = [parameters.read(path) for path in parameters.sources(options.notebooks)]
    if options.json:
        print(json.dumps([_described(notebook) for notebook in notebooks], indent=1))
        return 0
    width = min(shutil.get_terminal_size((88, 24)).columns, 100)
    print("\n".join(_shown(notebook, width) for notebook in notebooks), end="")
    return 0


def _described(notebook: Notebook) -> dict[str, Any]:
    names = ("name", "default", "unit", "help", "allowed")
    items = [
        {name: getattr(item, name) for name in names} | {"type": item.kind.__name__}
        for item in notebook.parameters.values()
    ]
    return {
        "name": notebook.name,
        "title": notebook.title,
        "summary": notebook.summary,
        "parameters": items,
    }


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


def _rerun(options: argparse.Namespace) -> int:
    notebook = parameters.find(options.name, options.notebooks)
    given = notebook.values(options.parameter, _table(options.file))
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    print(f"{notebook.name}: executing", flush=True)
    try:
        from armsim.report.notebooks import NotebookError
        from armsim.report.rerun import rerun

        try:
            result = rerun(notebook, given, options.output)
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
        rows = [["recorded value", "published", "now", "difference", "unit"]]
        for pair in moved:
            sides = (pair.expected, pair.got)
            values = [expected.number(side["value"], digits=6) if side else "–" for side in sides]
            difference = "" if pair.difference is None else f"{pair.difference:+.3g}"
            unit = (pair.got or pair.expected or {})["unit"] or ""
            rows.append([pair.name, *values, difference, unit])
        print(expected.layout(rows))
    print(f"{len(moved)} of {len(pairs)} recorded values changed" if pairs else
          "there are no published values to compare with")  # fmt: skip


def _check(options: argparse.Namespace) -> int:
    try:
        pairs = expected.compare_folders(options.results, options.expected)
    except (OSError, ValueError) as error:
        raise ParameterError(str(error)) from None
    moved = [pair for pair in pairs if pair.moved]
    if moved:
        heading = ["name", "expected", "got", "tolerance", "notebook"]
        print(expected.layout([heading, *(pair.row() for pair in moved)]))
    if options.update:
        expected.update(pairs, options.expected)
        print(f"{len(moved)} expectations updated in {options.expected}")
        return 0
    if moved:
        print(f"{len(moved)} of {len(pairs)} values moved. If that is meant: armsim check --update")
        return CHANGED
    print(f"{len(pairs)} values are as expected")
    return 0


if __name__ == "__main__":
    sys.exit(main())
