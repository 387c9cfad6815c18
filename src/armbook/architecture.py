"""What the appendix shows of the project itself: its modules, and where the numbers come from."""

import ast
import dataclasses
import hashlib
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from armbook import styles
from armbook.drawings import Sheet
from armsim.arm import AxisParameters
from armsim.paths import DATA
from reportkit import figures
from reportkit.check import replace_text
from reportkit.timing import processor

PACKAGE = Path(__file__).resolve().parents[1]
#: From the top; a module imports from its own floor and from those below.
FLOORS = ("report", "arm", "methods")
_UPSTAIRS = {"cli": "report", "amplifier": "arm"}  # modules that lie beside the floors


# --- the modules --------------------------------------------------------------------------------


def imports(package: Path = PACKAGE) -> dict[str, set[str]]:
    """Modules of a package, each with those of the same package that it imports.

    An import inside a function counts too, unless it would close a circle.

    Parameters
    ----------
    package : path
        Its folder. ``__init__`` modules only gather names and are left out: what is imported
        from one counts as imported from the module that defines it.
    """
    sources = {
        ".".join(path.relative_to(package).with_suffix("").parts): path
        for path in sorted(package.rglob("*.py"))
        if path.parent.name != "__pycache__"  # generated loops
    }
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in sources.items()}
    names = {name: _imported(tree.body, package.name) for name, tree in trees.items()}

    def defined_in(target: str) -> str:
        """Module of a dotted name, which may be one itself or be gathered by its package."""
        if target in sources:
            return target
        parent, _, name = target.rpartition(".")
        gathered = names.get(f"{parent}.__init__", {})
        return defined_in(gathered[name]) if name in gathered else parent

    modules = [name for name in sources if not name.endswith("__init__")]
    graph = {m: set(map(defined_in, names[m].values())) - {m} for m in modules}
    for module in modules:
        everywhere = _imported(ast.walk(trees[module]), package.name).values()
        for other in set(map(defined_in, everywhere)) - graph[module]:
            if module not in _below(graph, other) | {other}:
                graph[module].add(other)
    return graph


def _imported(nodes: Iterable[ast.AST], package: str) -> dict[str, str]:
    """Names that are imported from a package, with the dotted place of each."""
    return {
        alias.asname or alias.name: f"{node.module}.{alias.name}".removeprefix(f"{package}.")
        for node in nodes
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == package
        for alias in node.names
    }


def _below(graph: Mapping[str, set[str]], module: str) -> set[str]:
    """All that a module imports, and what that imports, and so on."""
    found: set[str] = set()
    fresh = set(graph[module])
    while fresh:
        found |= fresh
        fresh = {far for near in fresh for far in graph[near]} - found
    return found


def floor(module: str) -> str:
    """Floor of a module, or an empty text for what lies below all of them."""
    package = module.partition(".")[0]
    return package if package in FLOORS else _UPSTAIRS.get(module, "")


def upwards(graph: Mapping[str, Iterable[str]]) -> list[tuple[str, str]]:
    """Imports from a higher floor than one's own, of which there should be none."""
    return [
        (module, other)
        for module, others in graph.items()
        for other in others
        if floor(other) and (not floor(module) or _level(module) > _level(other))
    ]


def _level(module: str) -> int:
    return FLOORS.index(floor(module))


def reduced(graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Leave out each import that follows from another: of what an imported module imports."""
    return {
        module: others - {far for near in others for far in _below(graph, near)}
        for module, others in graph.items()
    }


@mpl.rc_context(figures.STYLE)
def architecture(graph: Mapping[str, set[str]]) -> Figure:
    """Draw the modules on their floors, and their imports apart from those that follow."""
    columns, cell, row, head = 5, 86.0, 44.0, 30.0
    lines = reduced(graph)
    rows = {name: _rows([m for m in graph if floor(m) == name], lines, columns) for name in FLOORS}
    height = sum(head + row * len(rows[name]) + 10 for name in FLOORS)
    sheet = Sheet(columns * cell + 16, height)
    place: dict[str, tuple[float, float]] = {}
    top = 0.0
    for name, tone in zip(FLOORS, ("limit", "gear", "arm"), strict=True):
        bottom = top + head + row * len(rows[name])
        sheet.panel(2, top + 2, columns * cell + 14, bottom, name, styles.COLOUR[tone])
        for n, modules in enumerate(rows[name]):

            def above(module: str) -> float:
                """Mean position of those that import it, to cross few lines."""
                xs = [place[m][0] for m in place if module in lines[m]]
                return sum(xs) / len(xs) if xs else 0.0

            for k, module in enumerate(sorted(modules, key=above)):
                shift = 0.0 if len(modules) == columns else 0.2 * (-1) ** n  # no two in line
                x = 8 + cell * (k + 0.5 + shift + (columns - len(modules)) / 2)
                place[module] = (x, top + head + row * (n + 0.5) - 6)
        top = bottom + 10
    for module, others in lines.items():
        for other in filter(place.__contains__, others if module in place else ()):
            (x, y), (u, v) = place[module], place[other]
            tone = ("limit", "gear", "arm")[_level(module)]
            sheet.line([(x, y), (u, v)], color=styles.COLOUR[tone], lw=0.9, alpha=0.55, zorder=1)
    for module, (x, y) in place.items():
        sheet.block(x, y, cell - 6, 20, module.rpartition(".")[2], size=8.5)
    return sheet.figure


def _rows(modules: list[str], lines: Mapping[str, set[str]], columns: int) -> list[list[str]]:
    """Modules of a floor in rows: each below all that import it."""
    depth = dict.fromkeys(modules, 0)
    for _ in modules:  # the longest path is no longer than that
        for module in modules:
            for other in lines[module] & set(modules):
                depth[other] = min(max(depth[other], depth[module] + 1), len(modules))
    rows = []
    for level in sorted(set(depth.values())):
        row = [module for module in modules if depth[module] == level]
        parts = -(-len(row) // columns)
        rows += [row[n::parts] for n in range(parts)]
    return rows


def modules_table(graph: Mapping[str, set[str]], package: Path = PACKAGE) -> str:
    """Table of the modules, from the top floor down: subject and imports."""
    lines = ["| module | subject | imports |", "| --- | --- | --- |"]
    order = sorted(graph, key=lambda m: (FLOORS.index(floor(m)) if floor(m) else 9, m))
    for module in order:
        source = (package / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
        subject = (ast.get_docstring(ast.parse(source)) or "").partition("\n\n")[0]
        others = ", ".join(f"`{other}`" for other in sorted(graph[module])) or "–"
        lines.append(f"| `{module}` | {' '.join(subject.split())} | {others} |")
    return "\n".join(lines) + "\n"


def symbols_table() -> str:
    """Table of the parameters of an axis: symbol, name in the code, unit, meaning, source."""
    lines = ["| symbol | name | unit | meaning | source |", "| --- | --- | --- | --- | --- |"]
    for item in sorted(dataclasses.fields(AxisParameters), key=lambda item: item.name.lower()):
        base, _, index = item.name.partition("_")
        symbol = f"${base}_{{{index}}}$" if index else f"${base}$"
        told = [item.metadata[key] for key in ("unit", "description", "source")]
        lines.append(f"| {symbol} | `{item.name}` | {' | '.join(told)} |")
    return "\n".join(lines) + "\n"


# --- where the numbers come from ----------------------------------------------------------------


def software() -> str:
    """Table of what was installed: the package, Python, and what the package asks for."""
    wanted = metadata.requires("armsim") or []
    names = sorted(
        {re.split(r"[^A-Za-z0-9._-]", line)[0] for line in wanted if "extra" not in line}
    )
    versions = [("armsim", _commit()), ("Python", platform.python_version())]
    versions += [(name, metadata.version(name)) for name in names]
    rows = "".join(f"| {name} | {version} |\n" for name, version in versions)
    return f"| package | version |\n| --- | --- |\n{rows}"


def _commit() -> str:
    """Version of the package, with the commit if it lies in a repository."""
    version = metadata.version("armsim")
    try:
        told = subprocess.run(
            ["git", "describe", "--always", "--dirty"],
            cwd=PACKAGE, capture_output=True, text=True, check=True,
        )  # fmt: skip
    except (OSError, subprocess.CalledProcessError):
        return version
    return f"{version}, commit {told.stdout.strip()}"


def computer() -> str:
    """Return what the book was computed on, in a sentence."""
    cores = os.cpu_count()
    return f"{processor()}, {cores} processors, {platform.system()} {platform.machine()}\n"


def run_times(results: Path) -> str:
    """Table of the seconds that each notebook took when it was executed for these results."""
    lines = ["| notebook | run time / s |", "| --- | ---: |"]
    for path in sorted(results.glob("[0-9][0-9]_*.ipynb")):
        seconds = results / f"{path.stem}-seconds.txt"
        told = seconds.read_text().strip() if seconds.exists() else "–"
        lines.append(f"| {{doc}}`{path.stem} <results/{path.stem}>` | {told} |")
    return "\n".join(lines) + "\n"


def sums(folder: Path = DATA) -> str:
    """Lines of ``sha256sum`` for the data, to be checked from the root of the repository."""
    return "".join(
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder.parent)}\n"
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not {"expected", "__pycache__"} & set(path.parts)
    )


def sums_table(sums: str) -> str:
    """Table of the beginnings of those sums."""
    lines = ["| file | SHA-256, its beginning |", "| --- | --- |"]
    for line in sums.splitlines():
        digest, _, name = line.partition("  ")
        lines.append(f"| `{name}` | `{digest[:16]}` |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Run ``python -m armbook.architecture RESULTS``: write the parts beside the results."""
    (results,) = map(Path, sys.argv[1:] if arguments is None else arguments)
    graph, data = imports(), sums()
    parts = {
        "modules.md": modules_table(graph),
        "symbols.md": symbols_table(),
        "software.md": software(),
        "computer.md": computer(),
        "run-times.md": run_times(results),
        "sums.md": sums_table(data),
        "SHA256SUMS": data,
    }
    for name, text in parts.items():
        replace_text(results / f"appendix-{name}", text)
    figures.save(architecture(graph), results / "appendix-architecture.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
