"""Search for the first time at which a guard reaches one of its limits.

A guard is a linear function of the state of a linear system. The search advances by steps for
which a bound proves that the guard stays between its limits, so it never passes a crossing. If a
piece starts with a guard on a limit, the guard's derivatives decide whether it leaves.
"""

# mypy: disable-error-code="no-untyped-def"

import math
from typing import NamedTuple

import numpy as np

from armsim.exact import modal
from armsim.exact.modal import TERMS, compiled, inlined, merged

#: Rows of `Work.proof`. Views of rows would cost more than the arithmetic on them.
SLOPE, CURVE, BEND, TWIST, UP, DOWN, STEADY = range(7)
#: Rounding error allowed for a sum, relative to the sum of the magnitudes of its terms.
ROUNDING = 16 * float(np.finfo(float).eps)
#: Smaller numbers may have lost digits to underflow; guards treat them as zero.
TINY = float(np.finfo(float).tiny / np.finfo(float).eps)
#: Largest number of steps of a search, equivalent to one or two seconds of computing.
MAX_SEARCH = 10_000_000
#: Returned in place of a guard if a search exceeds `MAX_SEARCH`.
GIVEN_UP = -2


class Mode(NamedTuple):
    """Equations and guards of a mode, as `System.equations` fills them in."""

    A: np.ndarray  #: (n, n)
    b: np.ndarray  #: (n,)
    normal: np.ndarray  #: (g, n) guard values are normal @ z
    lower: np.ndarray  #: (g,) lower limits, possibly -inf
    upper: np.ndarray  #: (g,) upper limits, possibly inf


class Work(NamedTuple):
    """Workspace for one piece, with n states and g guards."""

    state: np.ndarray  #: (n,) z at the start
    slope: np.ndarray  #: (n,) ż at the start
    amplitude: np.ndarray  #: (n,) complex amplitude of each mode in ż
    taylor: np.ndarray  #: (TERMS, n)
    value: np.ndarray  #: (g,) guard values at the start
    noise: np.ndarray  #: (g,) rounding error allowed for the value
    order: np.ndarray  #: (g,) 0 between the limits; on one, order of the first nonzero derivative
    derivative: np.ndarray  #: (g,) magnitude of that derivative
    drift: np.ndarray  #: (g,) constant part of the slope, from states that are integrals
    c: np.ndarray  #: (g, n) complex amplitude of each mode in the slope
    d: np.ndarray  #: (g, n) complex amplitude in the curvature, from integrals
    curvature: np.ndarray  #: (g, n) complex amplitude in the whole curvature
    size: np.ndarray  #: (g, n) modulus of `curvature`
    disc: np.ndarray  #: (g, n) complex amplitude in the guard itself
    radius: np.ndarray  #: (g, n) modulus of `disc`
    change: np.ndarray  #: (g, TERMS) Taylor coefficients
    proven: np.ndarray  #: (g,) time up to which each guard is proven to stay in its limits
    step: np.ndarray  #: (g,) last step of the proof
    proof: np.ndarray  #: (7, n + 1) see `_gain_modal`


@compiled
def work_room(n, guards):
    """Allocate the workspace for n states and a number of guards."""
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
    finite = True
    for i in range(z.size):
        slope[i] = here.b[i]
        for j in range(z.size):
            slope[i] += here.A[i, j] * z[j]
        finite = finite and math.isfinite(slope[i])
    return finite


@compiled
def stand(here, z, w):
    """Classify each guard at the start of a piece; return the one that leaves, and its side.

    For a guard on a limit, the sign of the first derivative that exceeds rounding decides whether
    it leaves or turns inwards.
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
    """Return the first derivative of a guard that exceeds rounding, and set its order."""
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


@inlined
def _modulus(z):
    """Modulus of a complex number, by the slower function only if the squares overflow."""
    size = math.sqrt(z.real**2 + z.imag**2)
    return size if size < math.inf else math.hypot(z.real, z.imag)


@merged
def _resolve(g, here, m, place, modes, w):
    """Set the coefficients of a guard's closed form in the piece."""
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
        w.size[g, k], w.radius[g, k] = _modulus(curvature), _modulus(disc)


@inlined
def _box(rate, centre, radius):
    """Bounds on the rise and the fall of a guard that one mode alone can still cause.

    The mode contributes `centre` now, and at most `radius` in magnitude from now on.
    """
    if rate.real > 0.0 or rate == 0.0:
        return math.inf, math.inf
    if rate.imag == 0.0:  # a real mode decays monotonically to zero
        centre, radius = 0.5 * centre, 0.5 * radius
    return radius - centre, radius + centre


@merged
def _gain_modal(g, m, place, s, rest, w):
    """Return gain and slope of a guard at `s`, the sum of its terms' magnitudes, and the reach.

    The gain is drift s + Σ Re(c E₁(λ, s) + d E₂(λ, s)). The proof holds for steps up to the reach.
    Column k of `w.proof` describes the k slowest modes together: slope, second derivative, and
    bounds of the second and third derivatives. It also describes mode k alone: bounds on the rise
    and fall it can still cause, and its limiting slope. `rest` is the remaining time of the piece.
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
        left = _modulus(power)
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
    """Counterpart of `_gain_modal` for a Taylor series, which fills column 0 of `w.proof`."""
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
    if root == math.inf:  # the squares overflow
        root = math.hypot(slope, math.sqrt(2.0 * bend) * math.sqrt(room))
    if slope > 0.0:
        return room / (0.5 * (slope + root))
    return (root - slope) / bend if bend > 0.0 else math.inf


@inlined
def _carried_on(step, above, below, slope, curve, twist):
    """Extend a step to at most four times its length, using a bound of the third derivative."""
    more = twist * 4.0 * step / 3.0
    up = _longest(above, slope, max(0.0, more + curve))
    down = _longest(below, -slope, max(0.0, more - curve))
    return max(step, min(up, down, 4.0 * step))


@merged
def _safe_step(above, below, modes, rest, proof):
    """Step for which a guard provably stays within the room above and below it.

    Each mode is either followed, using its slope and a bound of its second derivative, or boxed,
    using the largest change it can cause. The fastest modes are boxed, one more at a time. The
    longest of the resulting steps is extended by `_carried_on`.
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
    """Advance the proof for a guard by one step; return the side of a limit it reaches, or 0.

    If it reaches a limit, the proof ends at the crossing.
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
        if abs(room) < side * slope * w.step[g]:  # a final Newton step
            w.proven[g] = min(s + room / abs(slope), end)
        return side
    w.step[g] = _safe_step(above + error, below + error, modes, reach, w.proof)
    w.proven[g] = s + w.step[g]
    return 0


@inlined
def _series_bound(coefficients, order, end):
    """Bound of the derivative of a given order of Σ c_j u^(j+1) for u up to `end`."""
    bound = 0.0
    for j in range(TERMS - 1, order - 2, -1):
        size = abs(coefficients[j])
        for factor in range(j - order + 2, j + 2):
            size *= factor
        bound = bound * end + size
    return bound


@merged
def _clearance(g, m, place, modes, width, end, w):
    """Time at which a guard that turns inwards is clear of its limit and short of the other.

    D is the first nonzero derivative, of order o. In g ≥ |D| uᵒ/o! - bound uᵒ⁺¹/(o+1)! its term
    dominates for small u.
    """
    order, derivative, u = w.order[g], w.derivative[g], end
    bound = _series_bound(w.change[g], order + 1, end)
    for k in range(modes):
        rate, size = m.rate[place, k], w.size[g, k] * m.speed[place, k] ** (order - 1)
        if rate.real > 0.0:
            u = min(u, 1.0 / rate.real)
            size *= math.exp(min(1.0, rate.real * end))
        bound += size
    if derivative == 0.0:  # no derivative exceeds rounding
        return u if _rests(g, m, place, modes, u, w) else min(u, 1e-3 * m.reach[place])
    factorial = 1.0
    for factor in range(2, order + 1):
        factorial *= factor
    if bound > 0.0:
        u = min(u, 0.5 * (order + 1) * derivative / bound)
    return min(u, (factorial * width / (3.0 * derivative)) ** (1.0 / order))


@inlined
def _farthest(coefficients, end):
    """Bound of |Σ c_j u^(j+1)| for u up to `end`."""
    farthest = 0.0
    for j in range(TERMS - 1, -1, -1):
        farthest = (farthest + abs(coefficients[j])) * end
    return farthest


@compiled
def _rests(g, m, place, modes, end, w):
    """Whether a guard provably stays constant to within rounding."""
    farthest = abs(w.drift[g]) * end
    for k in range(modes):
        if m.rate[place, k].real <= 0.0 and m.rate[place, k] != 0.0:
            farthest += 2.0 * w.radius[g, k] + abs(w.d[g, k] * m.inverse[place, k]) * end
        elif w.size[g, k] > 0.0 or w.c[g, k] != 0.0:
            return False
    return farthest + _farthest(w.change[g], end) <= w.noise[g]


@compiled
def first_crossing(here, m, place, modes, end, longest_search, w):
    """Return the length of the piece, at most `end`; the guard that ends it, or -1; and its side.

    The guard with the shortest proven interval is advanced until all are proven up to the end or
    the first crossing. After `longest_search` steps, `GIVEN_UP` is returned as the guard.
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
        g = min(0, guards)  # a literal 0 would make numba compile the code below twice
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

    The relative change of each state is proportional to its term in the guard; a zero stays zero.
    """
    share = normal * z
    largest = np.abs(share).max()
    if largest == 0.0:
        return
    # Scaled by the largest, since squares of tiny terms underflow.
    weight = (share / largest) ** 2
    excess = (share.sum() - limit) / weight.sum()
    for i in range(z.size):
        if normal[i] != 0.0:
            z[i] -= excess * weight[i] / normal[i]
