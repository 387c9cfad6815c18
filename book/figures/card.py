"""Draw the card that other sites show beside a link to the book: python book/figures/card.py."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from armbook.styles import COLOUR
from armsim.arm import AxisParameters, simulate
from reportkit.figures import STYLE

TITLE = "A robot arm and a novel\nDormand–Prince technique"
SUBTITLE = "One paper, computed again: what holds and what does not"


@mpl.rc_context(STYLE)
def card() -> Figure:
    """Draw the title over the motor current of the step response, 1200 by 630 pixels."""
    fig = Figure(figsize=(12, 6.3), dpi=100, facecolor="white", layout="none")
    fig.text(0.05, 0.93, TITLE, size=38, weight="bold", va="top", linespacing=1.25)
    fig.text(0.05, 0.62, SUBTITLE, size=21, va="top")
    run = simulate(AxisParameters.paper_x_axis(T_p=0.04), set_velocity=10.0, t_end=1.1)
    t = np.linspace(0.0, 1.1, 4401)
    ax = fig.add_axes((0.03, 0.05, 0.94, 0.46))
    ax.plot(t, run(t)[6], color=COLOUR["command"], linewidth=3)
    ax.set_axis_off()
    return fig


if __name__ == "__main__":
    path = Path(__file__).parents[1] / "_static" / "card.png"
    card().savefig(path, metadata={"Software": None})
