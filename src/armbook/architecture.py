"""The parts and modules of the packages, drawn and listed for the pages; the symbols of an axis."""

import dataclasses
import sys
from collections.abc import Iterable, Mapping
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path
from textwrap import fill
from typing import Any

import grimp
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from armbook.styles import COLOUR
from armsim.arm import AxisParameters
from reportkit import figures, provenance, text
from reportkit.program import run
from reportkit.project import Project

Graph = Mapping[str, set[str]]  #: modules, each with those that it imports

PACKAGES = ("armbook", "reportkit", "armsim")
#: From the top: the parts of a floor, each with its share of the width of the drawing.
FLOORS = (
    {"armbook": 0.42, "reportkit": 0.58},
    {"armsim.arm": 1.0},
    {"armsim.exact": 0.42, "armsim.methods": 0.58},
    {"armsim": 1.0},
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


def arrows(graph: Graph) -> set[tuple[str, str]]:
    """Return pairs of parts, the first of which imports the second.

    A pair that follows from others is left out.
    """
    direct: dict[str, set[str]] = {name: set() for floor in FLOORS for name in floor}
    for module, others in graph.items():
        direct[part(module)] |= {part(other) for other in others} - {part(module)}
    below: dict[str, set[str]] = {}
    for name in TopologicalSorter(direct).static_order():
        below[name] = direct[name].union(*(below[other] for other in direct[name]))
    return {(a, b) for a in direct for b in direct[a].difference(*(below[c] for c in direct[a]))}


def members(graph: Graph, name: str) -> list[str]:
    """Return the modules and packages of a part, by their names in it."""
    own = (module for module in graph if part(module) == name != module)
    inside = (one.removeprefix(f"{name}.").removeprefix("armsim.") for one in own)
    return sorted({one.partition(".")[0] for one in inside})


@figures.styled()
def architecture(graph: Graph) -> Figure:
    """Draw the parts on their floors, with their modules, and arrows to what they import.

    Lengths are in points of print, from the upper left corner.
    """
    width, line, space = 72 * figures.WIDTH, 16.0, 8.0
    corners: dict[str, tuple[float, ...]] = {}
    texts, top = dict[str, str](), space
    for floor in FLOORS:
        for name, share in floor.items():  # 28 points of margins, and 7.4 for a character
            texts[name] = fill(", ".join(members(graph, name)), int((share * width - 28) / 7.4))
        left, bottom = 0.0, top + line * (3.3 + max(texts[name].count("\n") for name in floor))
        for name, share in floor.items():
            corners[name] = left + space, left + share * width - space, top, bottom
            left += share * width
        top = bottom + 3 * space
    figure = Figure(figsize=(figures.WIDTH, (top - 2 * space) / 72))
    figure.set_layout_engine("none")
    ax = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(top - 2 * space, 0))
    ax.set_axis_off()
    for name, (left, right, top, bottom) in corners.items():
        style: Any = {"fc": _TONES[name], "alpha": 0.13, "lw": 0}
        ax.add_patch(Rectangle((left, top), right - left, bottom - top, **style))
        ax.text(left + space, top + line, name, weight="bold", va="center")
        ax.text(left + space, top + 1.8 * line, texts[name], va="top", linespacing=1.25)
    for one, other in sorted(arrows(graph)):
        (left, right, top, bottom), (left_2, right_2, top_2, _) = corners[one], corners[other]
        x, y = (max(left, left_2) + min(right, right_2)) / 2, (top + bottom) / 2
        end, start = ((left_2, y), (right, y)) if top == top_2 else ((x, top_2), (x, bottom))
        pen = {"arrowstyle": "-|>", "color": figures.INK, "lw": 1.4}
        ax.annotate("", end, start, arrowprops=pen)
    return figure


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
    figures.save(architecture(graph), results / "appendix-architecture.svg")


if __name__ == "__main__":
    sys.exit(run(main, sys.argv[1:]))
