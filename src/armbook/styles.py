"""The paper's methods and the parts of the arm: one order, one key and one look for each."""

from typing import Any

from armsim.methods.tableaux import DP4, DP5, EULER, RK4_GILL, RK5, RK6
from reportkit.figures import FAINT, INK, MARKERS, PALETTE

#: What a colour means wherever a part of the arm appears.
COLOUR = dict(zip(("arm", "motor", "command", "gear", "limit"), PALETTE, strict=True))
EXACT = INK  #: the exact solution, wherever it appears

#: The corrected methods, in the order of the report.
METHODS = (EULER, RK4_GILL, RK5, RK6, DP5, DP4)
#: By the name of a method: what stands for it in the name of a recorded value.
KEY = {method.name: method.name.split()[0].replace("-", "_") for method in METHODS}
_COLOURS = (FAINT, *(PALETTE[n] for n in (4, 2, 3, 0, 1)))  # DP4 stands out
#: By the name of a method: properties of its line, wherever a method appears.
LOOK: dict[str, dict[str, Any]] = {
    method.name: {"color": colour, "marker": marker, "linestyle": "-"}
    for method, colour, marker in zip(METHODS, _COLOURS, (*MARKERS, "P"), strict=True)
}
# Solvers of the libraries look like methods that are not drawn beside them.
_PEERS = {
    "DP5(4)": DP5,
    "SciPy odeint": EULER,
    "CVODE BDF": RK4_GILL,
    "CVODE Adams": DP5,
    "SciPy Radau": RK5,
}
LOOK |= {peer: LOOK[method.name] for peer, method in _PEERS.items()}
