"""Draw the paper's figures 1 and 2 again: python book/figures/draw.py.

Nothing in them is computed, so the drawings are kept beside this script.
"""

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon
from scipy.spatial import ConvexHull

from armbook.styles import COLOUR
from reportkit.figures import FAINT, INK, PHONE, PLAN, save, shade, styled

Point = tuple[float, float]
Space = tuple[float, float, float]
HEAD = 7.0  # length of an arrowhead
GLYPHS: dict[str, list[Point]] = {  # curves in the square from -1 to 1, y upwards
    "limit": [(-1, -.7), (-.45, -.7), (.45, .7), (1, .7)],
    "backlash": [(-1, -.7), (-.35, 0), (.35, 0), (1, .7)],
    "friction": [(-1, 0), (-.3, 0), (-.3, -.7), (0, -.7), (0, .7), (.3, .7), (.3, 0), (1, 0)],
    "hold": [(-1, -.7), (-.5, -.7), (-.5, -.2), (0, -.2), (0, .3), (.5, .3), (.5, .7), (1, .7)],
}  # fmt: skip


class _Box:
    """An element of the block diagram, with the points where wires meet it."""

    def __init__(self, x: float, y: float, w: float, h: float) -> None:
        self.x, self.y = x, y
        self.left, self.right = (x - w / 2, y), (x + w / 2, y)
        self.top, self.bottom = (x, y - h / 2), (x, y + h / 2)


def _hop(x: float, y: float) -> list[Point]:
    """Lead a wire from left to right over another one."""
    return [(x - 4.5 * np.cos(a), y - 4.5 * np.sin(a)) for a in np.linspace(0, np.pi, 14)]


class Sheet:
    """A blank figure measured in points of print from its upper left corner."""

    def __init__(self, width: float, height: float) -> None:
        self.figure = Figure(figsize=(width / 72, height / 72))
        self.figure.set_layout_engine("none")
        self.ax = self.figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))
        self.ax.set_axis_off()
        self.add = self.ax.add_patch

    def text(self, x: float, y: float, text: str, **style: Any) -> None:
        """Write a text around a point."""
        self.ax.text(x, y, text, **({"ha": "center", "va": "center_baseline"} | style))

    def line(self, points: Sequence[Point], **style: Any) -> None:
        """Draw a path through the points."""
        pen: dict[str, Any] = {"color": INK, "lw": 1.1, "ls": "-", "solid_joinstyle": "round"}
        self.ax.plot(*zip(*points, strict=True), **(pen | style))

    def arrow(self, *points: Point, color: str = INK, **style: Any) -> None:
        """Draw a path through the points; the tip of its head lies exactly on the last one."""
        path = np.array(points)
        near = np.hypot(*(path - path[-1]).T) < HEAD
        near[0] = False  # a curve's last points would stick out of the head
        along = path[-1] - path[~near][-1]
        along *= HEAD / np.hypot(*along)
        base, across = path[-1] - along, 0.36 * np.array([-along[1], along[0]])
        self.add(Polygon([path[-1], base + across, base - across], fc=color, lw=0, zorder=3))
        self.line([*path[~near], base], color=color, **style)

    # The block diagram

    def panel(self, x0: float, y0: float, x1: float, y1: float, title: str, color: str) -> None:
        """Tint the ground of a group of elements."""
        shape = FancyBboxPatch((x0, y0), x1 - x0, y1 - y0, "round,pad=0,rounding_size=5",
                               fc=color, alpha=0.09, lw=0, zorder=0)  # fmt: skip
        self.add(shape)
        self.text(x0 + 26, y0 + 15, title, ha="left", va="center", size=10.5, weight="bold")

    def block(self, x: float, y: float, w: float, h: float, text: str = "", **style: Any) -> _Box:
        """Draw a block with a text, or with a glyph if the text names one."""
        shape = FancyBboxPatch((x - w / 2, y - h / 2), w, h, "round,pad=0,rounding_size=2",
                               fc="white", ec=INK, lw=1.1)  # fmt: skip
        self.add(shape)
        if text not in GLYPHS:
            self.text(x, y, text, **({"va": "center"} if "frac" in text else {}) | style)
            return _Box(x, y, w, h)
        half, high = w / 2 - 5, h / 2 - 4
        self.line([(x - half, y), (x + half, y)], color=FAINT, lw=0.6)
        self.line([(x, y - high), (x, y + high)], color=FAINT, lw=0.6)
        self.line([(x + half * u, y - high * v) for u, v in GLYPHS[text]], lw=1.5)
        return _Box(x, y, w, h)

    def total(self, x: float, y: float, **signs: str) -> _Box:
        """Draw a summing junction with a sign beside each incoming wire."""
        place = {"left": (-14, -8), "right": (14, -8), "top": (-8, -14), "bottom": (8, 14)}
        self.add(Circle((x, y), 8, fc="white", ec=INK, lw=1.1))
        for side, sign in signs.items():
            dx, dy = place[side]
            self.text(x + dx, y + dy, f"${sign}$", size=10, va="center")
        return _Box(x, y, 16, 16)

    def chain(self, *stops: _Box | Point) -> None:
        """Connect each of the elements or points of a row or column to the next."""
        boxes = [stop if isinstance(stop, _Box) else _Box(*stop, 0, 0) for stop in stops]
        for a, b in pairwise(boxes):
            if a.y == b.y:
                self.arrow(*((a.right, b.left) if a.x < b.x else (a.left, b.right)))
            else:
                self.arrow(*((a.bottom, b.top) if a.y < b.y else (a.top, b.bottom)))


@styled()
def block_diagram() -> Figure:
    """Draw figure 2, the system block diagram for one axis of the robot arm."""
    s = Sheet(510, 624)
    row_a, row_b, row_c, lane, row_d = 60, 226, 338, 482, 558
    s.panel(28, 6, 309, 160, "servo controller: preamplifier", COLOUR["arm"])
    s.panel(315, 6, 486, 160, "power stage", COLOUR["arm"])
    s.panel(28, 166, 486, 266, "motor", COLOUR["motor"])
    s.panel(28, 272, 284, 438, "gear", COLOUR["gear"])
    s.panel(290, 272, 486, 438, "arm", COLOUR["gear"])
    s.panel(28, 444, 436, 618, "slave control unit", COLOUR["limit"])

    # servo controller
    k_1 = s.block(66, row_a, 30, 26, "$K_1$")
    speed_error = s.total(110, row_a, left="+", bottom="-")
    lead_lag = s.block(189, row_a, 120, 42, r"$\dfrac{1 + T_z\,s}{(1 + T_p\,s)(1 + T_r\,s)}$")
    limit_c = s.block(276, row_a, 34, 30, "limit")
    k_2 = s.block(110, 104, 30, 22, "$K_2$")
    k_t = s.block(110, 141, 30, 22, "$K_t$")
    current_error = s.total(334, row_a, left="+", bottom="-")
    k_e = s.block(377, row_a, 30, 26, "$K_e$")
    limit_m = s.block(428, row_a, 34, 30, "limit")
    inverse_k_i = s.block(334, 118, 30, 38, r"$\dfrac{1}{K_i}$")
    s.chain(k_1, speed_error, lead_lag, limit_c, current_error, k_e, limit_m)

    # motor, from right to left
    voltage = s.total(438, row_b, right="+", top="-")
    armature = s.block(386, row_b, 64, 38, r"$\dfrac{1}{L_a\,s + R_a}$")
    k_b = s.block(303, row_b, 30, 26, "$K_b$")
    torque = s.total(262, row_b, right="+", bottom="-")
    rotor = s.block(186, row_b, 72, 38, r"$\dfrac{1}{J_m\,s + B_m}$")
    angle = s.block(76, row_b, 24, 38, r"$\dfrac{1}{s}$")
    emf = s.block(386, 184, 30, 24, "$K_b$")
    s.arrow(limit_m.right, (470, row_a), (470, row_b), voltage.right)
    s.chain(voltage, armature, k_b, torque, rotor, angle)
    s.chain((334, row_b), inverse_k_i, current_error)
    s.chain((110, row_b), k_t, k_2, speed_error)
    s.arrow((110, 184), *_hop(334, 184), emf.left)
    s.arrow(emf.right, (438, 184), voltage.top)

    # gear and arm
    pinion = s.block(74, row_c, 26, 26, "$r_g$")
    gap = s.total(110, row_c, left="+", bottom="-")
    backlash = s.block(158, row_c, 34, 30, "backlash")
    teeth = s.block(216, row_c, 64, 26, r"$K_g + b_g\,s$")
    reaction = s.block(262, 288, 26, 22, "$r_g$")
    force = s.total(308, row_c, left="+", bottom="-")
    mass = s.block(357, row_c, 60, 38, r"$\dfrac{1}{M\,s + B_a}$")
    position = s.block(430, row_c, 24, 38, r"$\dfrac{1}{s}$")
    friction = s.block(357, 386, 34, 30, "friction")
    s.line([angle.left, (44, row_b), (44, row_c)])
    s.chain((44, row_c), pinion, gap, backlash, teeth, force, mass, position, (502, row_c))
    s.chain((262, row_c), reaction, torque)
    s.arrow((402, row_c), (402, 386), friction.right)
    s.arrow(friction.left, (308, 386), force.bottom)
    s.arrow((464, row_c), (464, 424), (110, 424), gap.bottom)

    # slave control unit, from right to left
    encoder = s.block(102, lane, 62, 24, "encoder", size=10)
    track_error = s.total(416, row_d, right="+", top="-")
    law = [s.block(322, y, 104, 22, name, size=10)
           for y, name in ((row_d - 32, "position"), (row_d, "velocity"),
                           (row_d + 32, "integrated position"))]  # fmt: skip
    total = s.total(244, row_d, right="+", top="+", bottom="+")
    late = s.block(208, row_d, 24, 24, "D")
    hold = s.block(160, row_d, 34, 30, "hold")
    limit_u = s.block(102, row_d, 34, 30, "limit")
    s.arrow((44, row_c), (44, lane), encoder.left)
    s.arrow(encoder.right, (416, lane), track_error.top)
    s.chain((502, row_d), track_error, law[1], total, late, hold, limit_u)
    for branch, end in ((law[0], total.top), (law[2], total.bottom)):
        s.arrow((390, row_d), (390, branch.y), branch.right)
        s.arrow(branch.left, (244, branch.y), end)
    s.arrow(limit_u.left, (10, row_d), (10, row_a), k_1.left)

    for branching in ((110, row_b), (110, 184), (334, row_b), (44, row_c), (262, row_c),
                      (402, row_c), (464, row_c), (390, row_d)):  # fmt: skip
        s.add(Circle(branching, 2, fc=INK, lw=0, zorder=3))
    for x, y, name in (
        (19, row_a - 9, "$U$"), (302, row_a - 9, "$v_c$"), (458, row_a - 9, "$v_m$"),
        (334, row_b + 12, "$y_6$"), (122, row_b + 12, "$y_3$"), (53, row_b - 13, "$y_2$"),
        (130, row_c - 9, "$x$"), (262, row_c + 12, "$f_g$"), (402, row_c - 13, "$y_1$"),
        (464, row_c - 13, "$y_0$"), (322, 377, "$F_s$"), (72, row_d - 9, "$U$"),
        (190, row_a + 31, "$y_4, y_5$"),
    ):  # fmt: skip
        s.text(x, y, name, color=shade(COLOUR["arm"]) if "y_" in name else INK)
    for box, name in (
        (limit_c, r"$\pm V_L$"), (limit_m, r"$\pm V_M$"), (backlash, r"$\pm H$"),
        (friction, r"$F_0, v$"), (hold, "5 ms"), (limit_u, r"$\pm$10 V"),
    ):  # fmt: skip
        s.text(box.x, box.bottom[1] + 9, name, size=10, va="center")
    s.text(470, row_d - 10, "track data", size=10)
    s.text(470, row_d + 12, "every 80 ms", size=10)
    return s.figure


RIGHT, FRONT, UP = np.array([[0.98, 0.1], [0.52, 0.42], [0.0, -1.0]])  # oblique axes, y downwards


class _Scene(Sheet):
    """A sheet on which points are given in space, x to the right, y to the front, z up."""

    origin, unit = np.array([24.0, 276.0]), 32.0

    def at(self, x: float, y: float, z: float) -> Point:
        """Project a point of space onto the sheet."""
        return tuple(self.origin + self.unit * (x * RIGHT + y * FRONT + z * UP))

    def shape(self, outline: Any, tone: float) -> None:
        """Draw a flat outline of the sheet, shaded from 0 (white) to 1 (ink)."""
        self.add(Polygon(outline, fc="white", lw=0, zorder=2))  # the page, light or dark
        tint = (*mpl.colors.to_rgb(INK), tone)
        self.add(Polygon(outline, fc=tint, ec=INK, lw=0.9, joinstyle="round", zorder=2))

    def face(self, *corners: Space, tone: float) -> None:
        """Draw a flat face."""
        self.shape([self.at(*c) for c in corners], tone)

    def box(self, x: Point, y: Point, z: Point) -> None:
        """Draw the three visible faces of a box: left, front and top."""
        (x0, x1), (y0, y1), (z0, z1) = x, y, z
        self.face((x0, y0, z0), (x0, y1, z0), (x0, y1, z1), (x0, y0, z1), tone=0.26)
        self.face((x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1), tone=0.12)
        self.face((x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1), tone=0.03)

    def ring(self, centre: Space, axis: int, radius: Any, turn: np.ndarray) -> list[Point]:
        """Project points of a circle about an axis (0, 1, 2), given their angles in radians."""
        one, two = (RIGHT, FRONT, UP)[axis - 2], (RIGHT, FRONT, UP)[axis - 1]
        arms = np.outer(radius * np.cos(turn), one) + np.outer(radius * np.sin(turn), two)
        return list(map(tuple, self.at(*centre) + self.unit * arms))

    def cylinder(self, near: Space, far: Space, axis: int, radius: float) -> None:
        """Draw a cylinder about an axis between the centres of its ends."""
        turn = np.linspace(0, 2 * np.pi, 73)
        cap = self.ring(near, axis, radius, turn)
        both = np.array(cap + self.ring(far, axis, radius, turn))
        self.shape(both[ConvexHull(both).vertices], tone=0.12)
        self.shape(cap, tone=0.03)


@styled()
def arm_axes() -> Figure:
    """Draw figure 1, the axes of motion of a Cartesian robot arm."""
    s = _Scene(406, 352)
    # rail, carriage with motor, rack and pinion
    s.box((0, 11), (-0.8, 0.8), (0, 0.5))
    s.box((2.9, 5.5), (-0.8, 0.45), (0.62, 1.5))
    s.cylinder((4.2, 0.7, 1.02), (4.2, 0.45, 1.02), 1, 0.3)
    rack = [(0.3 + 0.1 * k, 0.8, (0.5, 0.62, 0.62, 0.5)[k % 4]) for k in range(104)]
    s.face((0.3, 0.8, 0.4), *rack, (rack[-1][0], 0.8, 0.4), tone=0.12)
    teeth = np.tile((0.5, 0.5, 0.38, 0.38), 12)
    s.shape(s.ring((4.2, 0.8, 1.02), 1, teeth, np.arange(48) * np.pi / 24), tone=0.03)
    s.shape(s.ring((4.2, 0.8, 1.02), 1, 0.09, np.arange(24) * np.pi / 12), tone=0.8)
    # column, head, beam; wrist
    s.box((3.7, 4.7), (-0.7, 0.2), (1.5, 5.6))
    s.box((4.0, 4.4), (-2.2, -0.9), (6.0, 6.4))
    s.box((3.5, 4.9), (-0.9, 0.4), (5.6, 6.8))
    s.box((3.7, 4.7), (-0.7, 0.2), (6.8, 8.6))
    s.box((3.95, 4.45), (0.4, 5.0), (5.95, 6.45))
    s.box((4.0, 4.4), (5.15, 5.65), (4.8, 6.0))
    s.cylinder((3.75, 5.4, 6.2), (4.65, 5.4, 6.2), 0, 0.42)
    s.cylinder((4.2, 5.4, 4.8), (4.2, 5.4, 4.6), 2, 0.45)
    s.box((4.1, 4.3), (5.3, 5.5), (4.1, 4.6))
    # motions
    for name, start, end, shift in (
        ("x", (6.6, 1.6, 0), (9.9, 1.6, 0), (10, 1)),
        ("y", (5.4, 0.8, 6.6), (5.4, 3.8, 6.6), (9, 5)),
        ("z", (2.5, 0, 3.0), (2.5, 0, 6.4), (0, -11)),
    ):
        s.arrow(s.at(*start), s.at(*end), color=COLOUR["arm"], lw=2)
        s.text(s.at(*end)[0] + shift[0], s.at(*end)[1] + shift[1], f"${name}$", size=13)
    for name, centre, axis, turn, place in (
        ("pitch", (3.5, 5.4, 6.2), 0, np.linspace(0.8, 4.5, 60), (2.75, 5.4, 5.15)),
        ("roll", (4.2, 5.4, 4.2), 2, np.linspace(-0.7, 3.0, 60), (5.65, 5.4, 4.2)),
    ):
        s.arrow(*s.ring(centre, axis, 0.82, turn), color=COLOUR["motor"], lw=2)
        s.text(*s.at(*place), name)
    s.line([s.at(4.2, 0.8, 0.56), s.at(3.4, 0.8, -0.7)], lw=0.7, zorder=4)
    s.text(*s.at(2.6, 0.8, -1.05), "rack and pinion")
    s.text(*s.at(5.45, 5.4, 6.1), "wrist")
    return s.figure


def main(folder: Path = Path(__file__).parent) -> None:
    """Write both drawings into a folder, the same bytes each time."""
    for draw, shown in ((arm_axes, PHONE), (block_diagram, PLAN)):
        save(draw(), folder / f"{draw.__name__}.svg", shown)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
