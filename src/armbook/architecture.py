"""The modules of the three packages and the symbols of an axis, drawn and listed for the pages."""

import dataclasses
import sys
from collections.abc import Iterable, Mapping
from graphlib import TopologicalSorter
from importlib import import_module
from itertools import accumulate
from pathlib import Path
from statistics import fmean
from typing import Any

import grimp
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from armbook.styles import COLOUR
from armsim.arm import AxisParameters
from reportkit import figures, provenance, text
from reportkit.program import run
from reportkit.project import Project

Graph = Mapping[str, set[str]]  #: modules, each with those that it imports

PACKAGES = ("armbook", "reportkit", "armsim")
#: From the top: the parts of a floor, each with the number of columns that its drawing takes.
FLOORS = (
    {"armbook": 2, "reportkit": 3},
    {"armsim.arm": 5},
    {"armsim.exact": 2, "armsim.methods": 3},
    {"armsim": 5},
)
_TONES = dict(zip(("armbook", "reportkit", "armsim.arm", "armsim.exact", "armsim.methods"),
                  COLOUR.values(), strict=True)) | {"armsim": figures.FAINT}  # fmt: skip
_BESIDE = {"armsim.amplifier": "armsim.arm", "armsim.paper": "armsim.arm"}


def imports(packages: Iterable[str] = PACKAGES) -> dict[str, set[str]]:
    """Return the modules of some packages, each with those of the same packages that it imports.

    An import inside a function counts.
    """
    graph = grimp.build_graph(*packages, cache_dir=None)
    return {name: graph.find_modules_directly_imported_by(name) for name in sorted(graph.modules)}


def part(module: str) -> str:
    """Return the part of the drawing, a key of one of `FLOORS`, that a module belongs to."""
    top, *below = module.split(".")
    own = f"{top}.{below[0]}" if below else top
    return own if any(own in floor for floor in FLOORS) else _BESIDE.get(module, top)


def reduced(graph: Graph) -> dict[str, set[str]]:
    """Leave out the packages, and each import that follows from others.

    A package only gathers names, so what it imports counts as imported by those that import it.
    """
    packages = {name.rpartition(".")[0] for name in graph}
    direct = {
        module: (others - packages).union(*(graph[name] for name in others & packages))
        for module, others in graph.items()
        if module not in packages
    }
    below: dict[str, set[str]] = {}
    for module in TopologicalSorter(direct).static_order():
        below[module] = direct[module].union(*(below[other] for other in direct[module]))
    return {name: rest.difference(*(below[far] for far in rest)) for name, rest in direct.items()}


@figures.styled()
def architecture(graph: Graph) -> Figure:
    """Draw the modules on their floors, with their imports.

    Imports that follow from others are left out, and those of the lowest floor, which all use.
    Lengths are in points of print, from the upper left corner.
    """
    cell, row, head = 86.0, 36.0, 24.0
    lines = reduced(graph)
    rows = {part: _rows(lines, part, n) for floor in FLOORS for part, n in floor.items()}
    heights = [head + row * max(len(rows[name]) for name in floor) + 8 for floor in FLOORS]
    width, height = 5 * cell + 8, sum(heights)
    figure = Figure(figsize=(width / 72, height / 72))
    figure.set_layout_engine("none")
    ax = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))
    ax.set_axis_off()

    def box(x: float, y: float, w: float, h: float, **style: Any) -> None:
        ax.add_patch(FancyBboxPatch((x, y), w, h, "round,pad=0,rounding_size=3", **style))

    def above(module: str) -> float:  # the mean abscissa of what imports it: few lines cross
        return fmean([x for name, (x, _) in place.items() if module in lines[name]] or [0.0])

    place: dict[str, tuple[float, float]] = {}
    for floor, height, top in zip(FLOORS, heights, accumulate(heights, initial=0), strict=False):
        left = 4.0
        for name, columns in floor.items():
            right = left + cell * columns
            box(left + 2, top + 2, right - left - 4, height - 8, fc=_TONES[name], alpha=0.09, lw=0)
            ax.text(left + 28, top + 17, name, va="center", size=10.5, weight="bold",
                    bbox={"fc": "white", "lw": 0, "pad": 1.5})  # fmt: skip
            for n, modules in enumerate(rows[name]):
                y = top + head + row * (n + 0.5)
                free = (right - left) / len(modules)
                # beside those of the next row, so that a line to a row further down passes by
                x = left + free * (0.5 + (0.12 * (-1) ** n if free > 100 else 0))
                for module in sorted(modules, key=above):
                    place[module] = (x, y)
                    x += free
            left = right
    lowest = {name for name in lines if part(name) == "armsim"}  # its lines would hide the others
    for module, others in sorted(lines.items()):  # the same order in each process
        for other in sorted(others - lowest):
            ax.plot(*zip(place[module], place[other], strict=True), color=_TONES[part(module)],
                    lw=0.9, ls="-", alpha=0.55, zorder=1)  # fmt: skip
    for module, (x, y) in place.items():
        box(x - cell / 2 + 5, y - 9, cell - 10, 18, fc="white", ec=figures.INK, lw=1.1)
        ax.text(x, y, module.rpartition(".")[2], ha="center", va="center_baseline", size=8)
    return figure


def _rows(lines: Graph, name: str, columns: int) -> list[list[str]]:
    """Arrange the modules of a part in rows, each below all that import it."""
    own = {module for module in lines if part(module) == name}
    sorter = TopologicalSorter({one: {m for m in own if one in lines[m]} for one in own})
    sorter.prepare()
    rows = []
    while level := sorted(sorter.get_ready()):
        parts = -(-len(level) // columns)
        rows += [level[n::parts] for n in range(parts)]
        sorter.done(*level)
    return rows


def modules_table(graph: Graph) -> str:
    """Return the table of the modules: subject, from the docstring, and imports."""
    rows = []
    for module, others in graph.items():
        subject = (import_module(module).__doc__ or "").partition("\n\n")[0]
        named = ", ".join(f"`{other}`" for other in sorted(others)) or "–"
        rows.append([f"`{module}`", subject, named])
    return text.markdown_table(["module", "subject", "imports"], rows)


def symbols_table() -> str:
    """Return the table of the parameters of an axis: symbol, name, unit, meaning, source."""
    rows = []
    for item in sorted(dataclasses.fields(AxisParameters), key=lambda item: item.name.lower()):
        base, _, index = item.name.partition("_")
        symbol = f"${base}_{{{index}}}$" if index else f"${base}$"
        told = [item.metadata[key] for key in ("unit", "description", "source")]
        rows.append([symbol, f"`{item.name}`", *told])
    return text.markdown_table(["symbol", "name", "unit", "meaning", "source"], rows)


def main(results: Path) -> None:
    """Run ``python -m armbook.architecture RESULTS``: write the appendix beside the results."""
    graph = imports()
    provenance.write(Project.find(Path(__file__)), results)
    text.write(results / "appendix-modules.md", modules_table(graph))
    text.write(results / "appendix-symbols.md", symbols_table())
    figures.save(architecture(graph), results / "appendix-architecture.svg", figures.PLAN)


if __name__ == "__main__":
    sys.exit(run(main, sys.argv[1:]))
