"""Drawings of rooted trees."""

from matplotlib.axes import Axes

from armsim.methods import trees
from reportkit.figures import INK


def rooted_tree(ax: Axes, tree: trees.Tree, colour: str = INK) -> None:
    """Draw a rooted tree of up to five nodes on axes of its own, the root open and below.

    Parameters
    ----------
    ax
        Their limits are set and their frame is removed.
    tree
        From `armsim.methods.trees`.
    colour
        Of nodes and edges.
    """
    nodes, edges = trees.layout(tree)
    for edge in edges:
        ax.plot(*zip(*(nodes[k] for k in edge), strict=True), color=colour, lw=1.4, ls="-")
    ax.plot(*zip(*nodes, strict=True), "o", color=colour, ms=5, ls="")
    ax.plot([0], [0], "o", color=colour, ms=7.5, mfc="white", mew=1.6, ls="")
    ax.set(xlim=(-2.3, 2.3), ylim=(-0.5, 4.5))
    ax.axis("off")
