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


class Proof(NamedTuple):
    """Bounds of a guard from some time on; of n modes each entry k has two kinds.

    The first four are of the k slowest modes together, for k up to n. The others are of mode k.
    """

    slope: np.ndarray  #: (n + 1,)
    curve: np.ndarray  #: (n + 1,) second derivative
    bend: np.ndarray  #: (n + 1,) bound of its magnitude from now on
    twist: np.ndarray  #: (n + 1,) bound of the third derivative
    up: np.ndarray  #: (n + 1,) bound of the rise that the mode can still cause
    down: np.ndarray  #: (n + 1,) bound of the fall
    steady: np.ndarray  #: (n + 1,) limiting slope


class Work(NamedTuple):
    """Workspace for the guards of one piece, with n states and g guards."""

    order: np.ndarray  #: (g,) 0 between the limits; on one, order of the first nonzero derivative
    derivative: np.ndarray  #: (g,) magnitude of that derivative
    value: np.ndarray  #: (g,) guard values at the start
    noise: np.ndarray  #: (g,) rounding error allowed for the value
    rest: np.ndarray  #: (g,) value at the equilibrium
    rest_noise: np.ndarray  #: (g,) rounding error allowed for it
    decay: np.ndarray  #: (g,) least rate of decay to it; 0 if the guard does not settle
    drift: np.ndarray  #: (g,) constant part of the slope, from states that are integrals
    proven: np.ndarray  #: (g,) time up to which each guard is proven to stay in its limits
    step: np.ndarray  #: (g,) last step of the proof
    c: np.ndarray  #: (g, n) complex amplitude of each mode in the slope
    d: np.ndarray  #: (g, n) complex amplitude in the curvature, from integrals
    curvature: np.ndarray  #: (g, n) complex amplitude in the whole curvature
    disc: np.ndarray  #: (g, n) complex amplitude in the guard itself
    size: np.ndarray  #: (g, n) modulus of `curvature`
    radius: np.ndarray  #: (g, n) modulus of `disc`
    change: np.ndarray  #: (g, TERMS) Taylor coefficients
    proof: Proof


@compiled
def work_room(n, guards):
    """Allocate the workspace for n states and a number of guards."""
    r, m = np.empty((9, guards)), np.empty((2, guards, n))
    c = np.empty((4, guards, n), np.complex128)
    order, change, p = np.empty(guards, np.int64), np.empty((guards, TERMS)), np.empty((7, n + 1))
    proof = Proof(p[0], p[1], p[2], p[3], p[4], p[5], p[6])
    numbers = r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]
    return Work(order, *numbers, c[0], c[1], c[2], c[3], m[0], m[1], change, proof)


@compiled
def is_finite(array):
    """Whether all entries are finite."""
    finite = True
    for entry in array.flat:
        finite = finite and np.isfinite(entry)
    return finite


@compiled
def set_start(A, b, z, start):
    """Set the state, its slope A z + b and the magnitudes of that; return whether it is finite."""
    slope, size = start.slope, start.slope_size
    for i in range(z.size):
        start.state[i], slope[i], size[i] = z[i], b[i], abs(b[i])
        for j in range(z.size):
            term = A[i, j] * z[j]
            slope[i], size[i] = slope[i] + term, size[i] + abs(term)
    return is_finite(slope)


@compiled
def stand(here, start, w):
    """Classify each guard at the start of a piece; return the one that leaves, and its side.

    For a guard on a limit, the sign of the first derivative that exceeds rounding decides whether
    it leaves or turns inwards.
    """
    z = start.state
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
        derivative, w.order[g] = _first_derivative(here.normal[g], here, start)
        w.derivative[g] = abs(derivative)
        if side * derivative > 0.0:
            return g, side
    return -1, 0


@compiled
def _first_derivative(normal, here, start):
    """Return the first derivative of a guard that exceeds rounding, or 0, and its order."""
    v, size, order = start.slope, start.slope_size, 1
    while order <= v.size + 1:
        derivative = normal @ v
        if abs(derivative) > ROUNDING * (np.abs(normal) @ size):
            return derivative, order
        v, size, order = here.A @ v, np.abs(here.A) @ size, order + 1
    return 0.0, order


@inlined
def _modulus(z):
    """Modulus of a complex number, by the slower function only beyond the range of squares."""
    size = math.sqrt(z.real**2 + z.imag**2)
    return size if 1e-140 < size < math.inf else math.hypot(z.real, z.imag)


@merged
def _resolve(g, here, p, w):
    """Set the coefficients of a guard's closed form in the piece."""
    w.drift[g] = w.rest[g] = w.rest_noise[g] = 0.0
    w.decay[g] = math.inf
    for k in range(p.modes):
        w.c[g, k] = w.d[g, k] = 0.0
    for j in range(TERMS):
        w.change[g, j] = 0.0
    for i in range(p.unit.size):
        normal = here.normal[g, i]
        if normal == 0.0:
            continue
        w.rest[g] += normal * p.start.rest[i]
        w.rest_noise[g] += ROUNDING * abs(normal) * p.start.rest_size[i]
        w.decay[g] = min(w.decay[g], p.start.decay[i])
        integral = p.unit[i] == 0.0
        if p.modes == 0:
            for j in range(TERMS):
                w.change[g, j] += normal * p.start.taylor[j, i]
        elif integral:
            w.drift[g] += normal * p.start.slope[i]
        for k in range(p.modes):
            term = normal * p.column[i, k] * p.start.amplitude[k]
            if integral:
                w.d[g, k] += term
            else:
                w.c[g, k] += term
    for k in range(p.modes):
        curvature = w.c[g, k] * p.rate[k] + w.d[g, k]
        disc = curvature * p.inverse[k] * p.inverse[k]
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
def _gain_modal(g, p, s, rest, w):
    """Evaluate a guard at `s`, and fill in `w.proof` for steps from there.

    Returns the gain since the start, the slope, the sum of the magnitudes of the gain's terms, the
    reach, what is left of the way to the equilibrium, and the sum of the magnitudes of its terms.
    The gain is drift s + Σ Re(c E₁(λ, s) + d E₂(λ, s)). The proof holds for steps up to the reach.
    `rest` is the remaining time of the piece.
    """
    proof = w.proof
    gain, sizes, reach = w.drift[g] * s, abs(w.drift[g] * s), rest
    slope, curve, bend, twist, remains, remains_size = w.drift[g], 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(p.modes):
        proof.slope[k], proof.curve[k] = slope, curve
        proof.bend[k], proof.twist[k] = bend, twist
        proof.up[k] = proof.down[k] = proof.steady[k] = 0.0
        c, d, size = w.c[g, k], w.d[g, k], w.size[g, k]
        if size == 0.0 and c == 0.0:
            continue
        rate, inverse = p.rate[k], p.inverse[k]
        power, first, second = modal.integrals(rate, inverse, s)
        one, two = c * first, d * second
        gain += one.real + two.real
        sizes += abs(one.real) + abs(one.imag) + abs(two.real) + abs(two.imag)
        slope += (c * power + d * first).real
        curve += (w.curvature[g, k] * power).real
        left = _modulus(power)
        centre, radius = (w.disc[g, k] * power).real, w.radius[g, k] * left
        remains, remains_size = remains + centre, remains_size + radius
        proof.up[k], proof.down[k] = _box(rate, centre, radius)
        if rate.real < 0.0 or rate.imag != 0.0:
            proof.steady[k] = -(d * inverse).real
        if rate.real > 0.0:
            reach = min(reach, 1.0 / rate.real)
            left *= math.exp(min(1.0, rate.real * rest))
        bend += size * left
        twist += size * left * p.speed[k]
    k = p.modes
    proof.slope[k], proof.curve[k], proof.bend[k], proof.twist[k] = slope, curve, bend, twist
    return gain, slope, sizes, reach, remains, remains_size


@merged
def _gain_series(g, s, end, w):
    """Counterpart of `_gain_modal` for a Taylor series, which fills entry 0 of `w.proof`."""
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
    w.proof.slope[0], w.proof.curve[0] = slope, curve
    w.proof.bend[0], w.proof.twist[0] = bend, twist
    return gain, slope, sizes, end - s, 0.0, 0.0


@inlined
def _longest(room, slope, bend):
    """Return the largest u for which slope u + bend u²/2 ≤ room.

    Of ratios alone, since squares of very large or small numbers leave the range of floats.
    """
    if room == math.inf:
        return math.inf
    if room <= 0.0:
        return 0.0
    if abs(slope) < TINY:
        return math.sqrt(2.0 * room / bend)
    ratio, turn = room / slope, slope / bend
    root = 1.0 + math.sqrt(1.0 + 2.0 * ratio / turn)
    return 2.0 * ratio / root if slope > 0.0 else -turn * root


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
            above, below = above - proof.up[k], below - proof.down[k]
            boxed += proof.steady[k]
            if not (above > 0.0 and below > 0.0):
                break
        total, bend = proof.slope[k] + boxed, proof.bend[k]
        step = min(_longest(above, total, bend), _longest(below, -total, bend))
        if step >= rest:
            return rest
        if step > best:
            best, best_above, best_below, tilt, followed = step, above, below, total, k
    curve, twist = proof.curve[followed], proof.twist[followed]
    return min(_carried_on(best, best_above, best_below, tilt, curve, twist), rest)


@merged
def _prove(g, p, lower, upper, end, w):
    """Advance the proof for a guard by one step; return the side of a limit it reaches, or 0.

    If it reaches a limit, the proof ends at the crossing. What is not a number counts as a limit.
    """
    s = w.proven[g]
    if p.modes > 0:
        gain, slope, sizes, reach, remains, remains_size = _gain_modal(g, p, s, end - s, w)
    else:
        gain, slope, sizes, reach, remains, remains_size = _gain_series(g, s, end, w)
    value, error = w.value[g] + gain, w.noise[g] + ROUNDING * (sizes + abs(slope) * s)
    if w.decay[g] * s > modal.SETTLED:
        value = w.rest[g] + remains
        error = w.rest_noise[g] + ROUNDING * (remains_size + abs(slope) * s) + TINY
    gap = min(abs(w.rest[g] - lower), abs(upper - w.rest[g]))
    if w.decay[g] > 0.0 and w.rest_noise[g] < gap <= error:  # wait until the error is smaller
        reach = min(reach, 1.01 * modal.SETTLED / w.decay[g])
    above, below = upper - value, value - lower
    if not (above > error and below > error):
        side, room = (1, above) if above <= error else (-1, below)
        if abs(room) < side * slope * w.step[g]:  # a final Newton step
            w.proven[g] = min(s + room / abs(slope), end)
        return side
    w.step[g] = _safe_step(above + error, below + error, p.modes, reach, w.proof)
    w.proven[g] = s + w.step[g]
    return 0


@inlined
def _series_bound(coefficients, order, end):
    """Bound of a derivative of Σ c_j u^(j+1), or for the order 0 of the sum, for u up to `end`."""
    bound = 0.0
    for j in range(TERMS - 1, max(order, 1) - 2, -1):
        size = abs(coefficients[j])
        for factor in range(j - order + 2, j + 2):
            size *= factor
        bound = bound * end + size
    return bound * end if order == 0 else bound


@merged
def _clearance(g, p, width, end, w):
    """Time at which a guard that turns inwards is clear of its limit and short of the other.

    D is the first nonzero derivative, of order o. In g ≥ |D| uᵒ/o! - bound uᵒ⁺¹/(o+1)! its term
    dominates for small u.
    """
    order, derivative, u = w.order[g], w.derivative[g], end
    bound = _series_bound(w.change[g], order + 1, end)
    for k in range(p.modes):
        rate, size = p.rate[k], w.size[g, k] * p.speed[k] ** (order - 1)
        if rate.real > 0.0:
            u = min(u, 1.0 / rate.real)
            size *= math.exp(min(1.0, rate.real * end))
        bound += size
    if derivative == 0.0:  # no derivative exceeds rounding
        return u if _rests(g, p, u, w) else min(u, 1e-3 * p.reach)
    factorial = 1.0
    for factor in range(2, order + 1):
        factorial *= factor
    if bound > 0.0:
        u = min(u, 0.5 * (order + 1) * derivative / bound)
    return min(u, (factorial * width / (3.0 * derivative)) ** (1.0 / order))


@compiled
def _rests(g, p, end, w):
    """Whether a guard provably stays constant to within rounding, its own and that of the modes."""
    farthest = abs(w.drift[g]) * end + _series_bound(w.change[g], 0, end)
    for k in range(p.modes):
        if p.rate[k].real <= 0.0 and p.rate[k] != 0.0:
            farthest += 2.0 * w.radius[g, k] + abs(w.d[g, k] * p.inverse[k]) * end
        elif w.size[g, k] > 0.0 or w.c[g, k] != 0.0:
            return False
    return farthest <= w.noise[g] * (1.0 + p.loss / ROUNDING)


@compiled
def first_crossing(here, p, end, longest_search, w):
    """Return the length of the piece, at most `end`; the guard that ends it, or -1; and its side.

    The guard with the shortest proven interval is advanced until all are proven up to the end or
    the first crossing. After `longest_search` steps, `GIVEN_UP` is returned as the guard.
    """
    guards = here.lower.size
    for g in range(guards):
        lower, upper = here.lower[g], here.upper[g]
        _resolve(g, here, p, w)
        w.proven[g] = w.step[g] = 0.0
        if lower == -math.inf and upper == math.inf:
            w.proven[g] = end
        elif w.order[g] > 0:
            w.proven[g] = _clearance(g, p, upper - lower, end, w)
        elif p.modes == 0:
            farthest = _series_bound(w.change[g], 0, end)
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
        hit = _prove(g, p, here.lower[g], here.upper[g], end, w)
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
