"""When a guard, a linear function of the state of a linear system, reaches one of its limits.

The search never passes a crossing: from one time to the next it goes by steps for which a bound
proves that the guard keeps between its limits. Where a piece starts with a guard on a limit, its
derivatives decide whether it leaves.
"""

# mypy: disable-error-code="no-untyped-def"

import math
from typing import NamedTuple

import numpy as np

from armsim.exact import modal
from armsim.exact.modal import TERMS, compiled, inlined, merged

#: Rows of `Work.proof`. (Views of rows would cost more than what is done with them.)
SLOPE, CURVE, BEND, TWIST, UP, DOWN, STEADY = range(7)
#: A sum is known to this many times the sum of its terms' sizes.
ROUNDING = 16 * float(np.finfo(float).eps)
#: Numbers below this have fewer digits than others; to a guard they are zero.
TINY = float(np.finfo(float).tiny / np.finfo(float).eps)
#: A search of more steps than these, a second or two of computing, is given up.
MAX_SEARCH = 10_000_000
#: In place of a guard: the search was given up.
GIVEN_UP = -2


class Mode(NamedTuple):
    """Equations and guards of a mode, as `System.equations` fills them in."""

    A: np.ndarray  #: (n, n)
    b: np.ndarray  #: (n,)
    normal: np.ndarray  #: (g, n) the guards' values are normal @ z
    lower: np.ndarray  #: (g,) they stay above this, which may be -inf
    upper: np.ndarray  #: (g,) and below this, which may be inf


class Work(NamedTuple):
    """Room for the calculation of a piece; n states, g guards."""

    state: np.ndarray  #: (n,) z at the start
    slope: np.ndarray  #: (n,) ż at the start
    amplitude: np.ndarray  #: (n,) complex, of each mode in ż
    taylor: np.ndarray  #: (TERMS, n)
    value: np.ndarray  #: (g,) of each guard at the start
    noise: np.ndarray  #: (g,) what the value is known to
    order: np.ndarray  #: (g,) 0 between the limits; at one, order of the first derivative not zero
    derivative: np.ndarray  #: (g,) size of that derivative
    drift: np.ndarray  #: (g,) steady slope of each guard, from integrals
    c: np.ndarray  #: (g, n) complex, of each mode in the slope of each guard
    d: np.ndarray  #: (g, n) complex, and by way of integrals in its curvature
    curvature: np.ndarray  #: (g, n) complex, of each mode in the curvature of each guard, and …
    size: np.ndarray  #: (g, n) … its modulus
    disc: np.ndarray  #: (g, n) complex, of each mode in the guard itself, and …
    radius: np.ndarray  #: (g, n) … its modulus
    change: np.ndarray  #: (g, TERMS) Taylor coefficients
    proven: np.ndarray  #: (g,) time to which each guard is proven to keep between its limits
    step: np.ndarray  #: (g,) last step of the proof
    proof: np.ndarray  #: (7, n + 1) see `_gain_modal`


@compiled
def work_room(n, guards):
    """Room for n states and a number of guards."""
    number = np.complex128
    return Work(
        np.empty(n),
        np.empty(n),
        np.empty(n, number),
        np.empty((TERMS, n)),
        np.empty(guards),
        np.empty(guards),
        np.empty(guards, np.int64),
        np.empty(guards),
        np.empty(guards),
        np.empty((guards, n), number),
        np.empty((guards, n), number),
        np.empty((guards, n), number),
        np.empty((guards, n)),
        np.empty((guards, n), number),
        np.empty((guards, n)),
        np.empty((guards, TERMS)),
        np.empty(guards),
        np.empty(guards),
        np.empty((7, n + 1)),
    )


@compiled
def set_slope(here, z, slope):
    """Set `slope` to A z + b; return whether it is finite."""
    slope[:] = here.A @ z + here.b
    return np.isfinite(slope).all()


@compiled
def stand(here, z, w):
    """Note how each guard stands at the start of a piece; return what leaves, and past which side.

    A guard at a limit leaves or turns inwards as the first of its derivatives says that is not
    zero to within rounding.
    """
    for g in range(here.lower.size):
        lower, upper, value, sizes = here.lower[g], here.upper[g], 0.0, 0.0
        for i in range(z.size):
            value += here.normal[g, i] * z[i]
            sizes += abs(here.normal[g, i] * z[i])
        near = upper if abs(upper - value) < abs(value - lower) else lower
        noise = ROUNDING * (sizes + abs(near) if math.isfinite(near) else sizes) + TINY
        w.value[g], w.noise[g], w.order[g] = value, noise, 0
        side = 1 if value >= upper - noise else -1 if value <= lower + noise else 0
        if side == 0:
            continue
        if value > upper + noise or value < lower - noise:
            return g, side
        derivative = _first_derivative(g, here, z, w)
        w.derivative[g] = abs(derivative)
        if side * derivative > 0.0:
            return g, side
    return -1, 0


@inlined
def _first_derivative(g, here, z, w):
    """First derivative of a guard that is not zero to within rounding; sets its order."""
    n = z.size
    derivative = sizes = 0.0
    for i in range(n):
        if here.normal[g, i] != 0.0:
            derivative += here.normal[g, i] * w.slope[i]
            size = abs(here.b[i])
            for j in range(n):
                size += abs(here.A[i, j] * z[j])
            sizes += abs(here.normal[g, i]) * size
    w.order[g] = 1
    if abs(derivative) > ROUNDING * sizes:
        return derivative
    v, size_of_A = w.slope, np.abs(here.A)
    size_of_v = size_of_A @ np.abs(z) + np.abs(here.b)
    while w.order[g] <= n:
        w.order[g] += 1
        v, size_of_v = here.A @ v, size_of_A @ size_of_v
        derivative = sizes = 0.0
        for i in range(n):
            derivative += here.normal[g, i] * v[i]
            sizes += abs(here.normal[g, i]) * size_of_v[i]
        if abs(derivative) > ROUNDING * sizes:
            return derivative
    return 0.0


@merged
def _resolve(g, here, m, place, modes, w):
    """Set the formula of a guard's value in the piece."""
    w.drift[g] = 0.0
    for k in range(modes):
        w.c[g, k] = w.d[g, k] = 0.0
    for j in range(TERMS):
        w.change[g, j] = 0.0
    for i in range(w.slope.size):
        normal = here.normal[g, i]
        if normal == 0.0:
            continue
        integral = m.unit[place, i] == 0.0
        if modes == 0:
            for j in range(TERMS):
                w.change[g, j] += normal * w.taylor[j, i]
        elif integral:
            w.drift[g] += normal * w.slope[i]
        for k in range(modes):
            term = normal * m.column[place, i, k] * w.amplitude[k]
            if integral:
                w.d[g, k] += term
            else:
                w.c[g, k] += term
    for k in range(modes):
        curvature = w.c[g, k] * m.rate[place, k] + w.d[g, k]
        disc = curvature * m.inverse[place, k] * m.inverse[place, k]
        w.curvature[g, k], w.disc[g, k] = curvature, disc
        w.size[g, k] = math.sqrt(curvature.real**2 + curvature.imag**2)
        w.radius[g, k] = math.sqrt(disc.real**2 + disc.imag**2)


@inlined
def _box(rate, centre, radius):
    """How far a mode alone can still lift and lower a guard from where it is.

    It moves on a disc of this radius around `centre`, seen from where it is.
    """
    if rate.real > 0.0 or rate == 0.0:
        return math.inf, math.inf
    if rate.imag == 0.0:  # it goes straight to its rest, not around it
        centre, radius = 0.5 * centre, 0.5 * radius
    return radius - centre, radius + centre


@merged
def _gain_modal(g, m, place, s, rest, w):
    """Return gain and slope of a guard at `s`, the sizes of its terms, and how far the proof goes.

    The gain is drift s + Σ Re(c E₁(λ, s) + d E₂(λ, s)). For the proof, `w.proof` gets, of the k
    slowest modes together: slope, second derivative, bounds of the second and of the third; and of
    each mode alone: how far it can still lift and lower the guard, and the steady slope it tends
    to. `rest` is what remains of the piece.
    """
    proof = w.proof
    gain, sizes, reach = w.drift[g] * s, abs(w.drift[g] * s), rest
    slope, curve, bend, twist = w.drift[g], 0.0, 0.0, 0.0
    for k in range(m.modes[place]):
        proof[SLOPE, k], proof[CURVE, k] = slope, curve
        proof[BEND, k], proof[TWIST, k] = bend, twist
        proof[UP, k] = proof[DOWN, k] = proof[STEADY, k] = 0.0
        c, d, size = w.c[g, k], w.d[g, k], w.size[g, k]
        if size == 0.0 and c == 0.0:
            continue
        rate, inverse = m.rate[place, k], m.inverse[place, k]
        power, first, second = modal.integrals(rate, inverse, s)
        one, two = c * first, d * second
        gain += one.real + two.real
        sizes += abs(one.real) + abs(one.imag) + abs(two.real) + abs(two.imag)
        slope += (c * power + d * first).real
        curve += (w.curvature[g, k] * power).real
        left = math.sqrt(power.real**2 + power.imag**2)
        centre = (w.disc[g, k] * power).real
        proof[UP, k], proof[DOWN, k] = _box(rate, centre, w.radius[g, k] * left)
        if rate.real < 0.0 or rate.imag != 0.0:
            proof[STEADY, k] = -(d * inverse).real
        if rate.real > 0.0:
            reach = min(reach, 1.0 / rate.real)
            left *= math.exp(min(1.0, rate.real * rest))
        bend += size * left
        twist += size * left * m.speed[place, k]
    k = m.modes[place]
    proof[SLOPE, k], proof[CURVE, k], proof[BEND, k], proof[TWIST, k] = slope, curve, bend, twist
    return gain, slope, sizes, reach


@merged
def _gain_series(g, s, end, w):
    """As `_gain_modal`, for a Taylor series: all is bounded together, as of no mode at all."""
    gain = slope = curve = sizes = bend = twist = 0.0
    for j in range(TERMS - 1, -1, -1):
        term = w.change[g, j]
        gain = (gain + term) * s
        sizes = (sizes + abs(term)) * s
        slope = slope * s + (j + 1) * term
        if j > 0:
            curve = curve * s + (j + 1) * j * term
            bend = bend * end + (j + 1) * j * abs(term)
        if j > 1:
            twist = twist * end + (j + 1) * j * (j - 1) * abs(term)
    w.proof[SLOPE, 0], w.proof[CURVE, 0] = slope, curve
    w.proof[BEND, 0], w.proof[TWIST, 0] = bend, twist
    return gain, slope, sizes, end - s


@inlined
def _longest(room, slope, bend):
    """Return the largest u for which slope u + bend u²/2 ≤ room."""
    if room == math.inf:
        return math.inf
    if room <= 0.0:
        return 0.0
    root = math.sqrt(slope * slope + 2.0 * bend * room)
    if slope > 0.0:
        return 2.0 * room / (slope + root)
    return (root - slope) / bend if bend > 0.0 else math.inf


@inlined
def _carried_on(step, above, below, slope, curve, twist):
    """Carry a step on to at most four times its length, by a bound of the third derivative."""
    more = twist * 4.0 * step / 3.0
    up = _longest(above, slope, max(0.0, more + curve))
    down = _longest(below, -slope, max(0.0, more - curve))
    return max(step, min(up, down, 4.0 * step))


@merged
def _safe_step(above, below, modes, rest, proof):
    """Longest time for which a guard provably keeps within the room above and below it.

    Each mode is either followed, by its slope and the bound of its second derivative, or boxed, by
    the farthest that it can move. Boxing the fastest modes, one more at a time, gives as many
    proofs; the best one is carried on.
    """
    best = best_above = best_below = tilt = boxed = 0.0
    followed = modes
    for k in range(modes, -1, -1):
        if k < modes:
            above, below = above - proof[UP, k], below - proof[DOWN, k]
            boxed += proof[STEADY, k]
            if not (above > 0.0 and below > 0.0):
                break
        total, bend = proof[SLOPE, k] + boxed, proof[BEND, k]
        step = min(_longest(above, total, bend), _longest(below, -total, bend))
        if step >= rest:
            return rest
        if step > best:
            best, best_above, best_below, tilt, followed = step, above, below, total, k
    curve, twist = proof[CURVE, followed], proof[TWIST, followed]
    return min(_carried_on(best, best_above, best_below, tilt, curve, twist), rest)


@merged
def _prove(g, m, place, modes, lower, upper, end, w):
    """Carry the proof for a guard on by a step; return the side of a limit that it reaches, or 0.

    Then the proof ends at the crossing.
    """
    s = w.proven[g]
    if modes > 0:
        gain, slope, sizes, reach = _gain_modal(g, m, place, s, end - s, w)
    else:
        gain, slope, sizes, reach = _gain_series(g, s, end, w)
    error = w.noise[g] + ROUNDING * (sizes + abs(slope) * s)
    above, below = upper - w.value[g] - gain, w.value[g] + gain - lower
    if above <= error or below <= error:
        side, room = (1, above) if above <= error else (-1, below)
        if abs(room) < side * slope * w.step[g]:  # one last step, by Newton
            w.proven[g] = min(s + room / abs(slope), end)
        return side
    w.step[g] = _safe_step(above + error, below + error, modes, reach, w.proof)
    w.proven[g] = s + w.step[g]
    return 0


@inlined
def _series_bound(coefficients, order, end):
    """Bound of the derivative of an order of Σ c_j u^(j+1), up to a time."""
    bound = 0.0
    for j in range(TERMS - 1, order - 2, -1):
        size = abs(coefficients[j])
        for factor in range(j - order + 2, j + 2):
            size *= factor
        bound = bound * end + size
    return bound


@merged
def _clearance(g, m, place, modes, width, end, w):
    """Time by which a guard that turns inwards is clear of its limit, and not yet at the other.

    In g ≥ |D| uᵒ/o! - bound uᵒ⁺¹/(o+1)! the first derivative D that is not zero, of order o, keeps
    the upper hand for a while.
    """
    order, derivative, u = w.order[g], w.derivative[g], end
    bound = _series_bound(w.change[g], order + 1, end)
    for k in range(modes):
        rate, size = m.rate[place, k], w.size[g, k] * m.speed[place, k] ** (order - 1)
        if rate.real > 0.0:
            u = min(u, 1.0 / rate.real)
            size *= math.exp(min(1.0, rate.real * end))
        bound += size
    if derivative == 0.0:  # none is known from zero
        return u if _rests(g, m, place, modes, u, w) else min(u, 1e-3 * m.reach[place])
    factorial = 1.0
    for factor in range(2, order + 1):
        factorial *= factor
    if bound > 0.0:
        u = min(u, 0.5 * (order + 1) * derivative / bound)
    return min(u, (factorial * width / (3.0 * derivative)) ** (1.0 / order))


@inlined
def _farthest(coefficients, end):
    """How far Σ c_j u^(j+1) can get up to a time."""
    farthest = 0.0
    for j in range(TERMS - 1, -1, -1):
        farthest = (farthest + abs(coefficients[j])) * end
    return farthest


@compiled
def _rests(g, m, place, modes, end, w):
    """Whether a guard provably keeps where it is, to within rounding."""
    farthest = abs(w.drift[g]) * end
    for k in range(modes):
        if m.rate[place, k].real <= 0.0 and m.rate[place, k] != 0.0:
            farthest += 2.0 * w.radius[g, k] + abs(w.d[g, k] * m.inverse[place, k]) * end
        elif w.size[g, k] > 0.0 or w.c[g, k] != 0.0:
            return False
    return farthest + _farthest(w.change[g], end) <= w.noise[g]


@compiled
def first_crossing(here, m, place, modes, end, longest_search, w):
    """How long the piece lasts, at most `end`; the guard that ends it, or -1; and its side.

    The guard with the shortest proven interval is advanced, until all are proven to the end or to
    the first crossing. After `longest_search` steps it is `GIVEN_UP`.
    """
    guards = here.lower.size
    for g in range(guards):
        lower, upper = here.lower[g], here.upper[g]
        _resolve(g, here, m, place, modes, w)
        w.proven[g] = w.step[g] = 0.0
        if lower == -math.inf and upper == math.inf:
            w.proven[g] = end
        elif w.order[g] > 0:
            w.proven[g] = _clearance(g, m, place, modes, upper - lower, end, w)
        elif modes == 0:
            farthest = _farthest(w.change[g], end)
            if lower + farthest < w.value[g] < upper - farthest:
                w.proven[g] = end
    first, side = -1, 0
    for _ in range(longest_search):
        g = min(0, guards)  # no literal 0, for which all that follows would be compiled once more
        for other in range(1, guards):
            if w.proven[other] < w.proven[g]:
                g = other
        if guards == 0 or w.proven[g] >= end:
            return end, first, side
        hit = _prove(g, m, place, modes, here.lower[g], here.upper[g], end, w)
        if hit != 0:
            end, first, side = w.proven[g], g, hit
    return 0.0, GIVEN_UP, 0


@compiled
def put_at_limit(normal, limit, z):
    """Remove the rounding error of a guard that has just reached its limit.

    Each state changes in proportion to its share in the guard; a zero stays zero.
    """
    share = normal * z
    largest = np.abs(share).max()
    if largest == 0.0:
        return
    # Relative to the largest, since squares of tiny numbers are zero.
    weight = (share / largest) ** 2
    excess = (share.sum() - limit) / weight.sum()
    for i in range(z.size):
        if normal[i] != 0.0:
            z[i] -= excess * weight[i] / normal[i]
