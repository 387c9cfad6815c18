"""The programmed move of the nonlinear arm by DOP853, and of the linear arm by matrix exponentials.

The linear arm is the paper's fourth-order system of eq. (16), whose power stage is a current source
and whose gear is rigid.
"""

import math

import numpy as np
from arm import Run, changed, gain, paper, read
from scipy.linalg import expm

PERIOD, TRACK_PERIOD = 0.005, 0.08  # s, the paper's Section 3.2
LIMIT, VOLTS_PER_SPEED = 10.0, 10.0  # V; V s/m
AFTER = 1.0  # s that the arm is watched after the track
WITHIN = 20  # points of comparison in a sample


def trapezoid(length, speed, acceleration, t):
    """Position and speed of a move with a trapezoidal speed."""
    rise, end = speed / acceleration, length / speed + speed / acceleration
    position = (
        0.5
        * acceleration
        * (
            np.clip(t, 0, None) ** 2
            - np.clip(t - rise, 0, None) ** 2
            - np.clip(t - end + rise, 0, None) ** 2
            + np.clip(t - end, 0, None) ** 2
        )
    )
    return position, np.interp(t, [0, rise, end - rise, end], [0, speed, speed, 0])


def track(length, speed, acceleration):
    """Position and speed (n, 2) at the samples: cubics between the data sent every 80 ms."""
    end = length / speed + speed / acceleration
    sent = TRACK_PERIOD * np.arange(math.ceil(end / TRACK_PERIOD - 1e-9) + 2)
    x, v = trapezoid(length, speed, acceleration, sent)
    samples = round((sent[-1] + AFTER) / PERIOD)
    per = round(TRACK_PERIOD / PERIOD)
    n, s = np.divmod(np.arange(samples), per)
    n, s = np.where(n < sent.size - 1, (n, s / per), [[sent.size - 2], [1.0]])
    n = n.astype(int)
    h00, h01 = (1 + 2 * s) * (1 - s) ** 2, s**2 * (3 - 2 * s)
    h10, h11 = TRACK_PERIOD * s * (1 - s) ** 2, TRACK_PERIOD * s**2 * (s - 1)
    position = h00 * x[n] + h10 * v[n] + h01 * x[n + 1] + h11 * v[n + 1]
    rise = 6 * s * (1 - s) / TRACK_PERIOD * (x[n + 1] - x[n])
    return np.array([position, rise + (1 - s) * (1 - 3 * s) * v[n] + s * (3 * s - 2) * v[n + 1]]).T


def controlled(wanted, r_g, advance):
    """Put out the set velocity at every sample; `advance` returns the motor angle after one.

    The output is computed from one reading and put out one sample later. The integral rests while
    the output is at its limit and the error would drive it on.
    """
    law = read("choices.toml")["control"]
    assert law["delay"] == 1
    count = 2 * math.pi / law["counts"]
    angle = integral = before = output = 0.0
    for n, (goal, speed) in enumerate(wanted):
        read_out = r_g * count * math.floor(angle / count + 0.5)
        error, moved = goal - read_out, (read_out - before) / PERIOD if n else 0.0
        summed = integral + PERIOD * error
        next_output = VOLTS_PER_SPEED * (
            speed + law["K_p"] * error + law["K_v"] * (speed - moved) + law["K_I"] * summed
        )
        if abs(next_output) <= LIMIT or next_output * error < 0:
            integral = summed
        angle, before = advance(output, PERIOD * (n + 1)), read_out
        output = min(max(next_output, -LIMIT), LIMIT)


def nonlinear(p, wanted, times):
    """Position of the nonlinear arm."""
    run = Run(p, rtol=1e-8)

    def advance(volts, t_end):
        run.advance(volts, t_end)
        return (run.z[0] + run.z[2]) / p.r_g

    controlled(wanted, p.r_g, advance)
    return run(times)[0]


def linear_matrix(p):
    """Matrix (5, 5) of motor angle, its rate, two lags and their input, which is held."""
    J, B = p.J_m + p.r_g**2 * p.M, p.B_m + p.r_g**2 * p.B_a
    drive, lags = p.K_b * p.K_i / J, 1 / (p.T_p * p.T_r)
    return np.array([
        [0, 1, 0, 0, 0],
        [0, -B / J, drive, drive * p.T_z, 0],
        [0, 0, 0, 1, 0],
        [0, -p.K_2 * p.K_t * lags, -lags, -(p.T_p + p.T_r) * lags, p.K_1 * lags],
        [0, 0, 0, 0, 0],
    ])  # fmt: skip


def linear(p, wanted):
    """Position of the linear arm, `WITHIN` times in every sample."""
    short, state, found = expm(linear_matrix(p) * PERIOD / WITHIN), np.zeros(5), [0.0]

    def advance(volts, _):
        nonlocal state
        state[4] = volts
        for _ in range(WITHIN):
            state = short @ state
            found.append(p.r_g * state[0])
        return state[0]

    controlled(wanted, p.r_g, advance)
    return np.array(found)


def apart(speed, acceleration, share=1.0):
    """Largest distance of the two models in mm, with a share of our forward gain."""
    p = changed(paper(), K_e=share * paper().K_e)
    p = changed(p, K_1=gain(p))
    wanted = track(read("choices.toml")["move"]["distance"], speed, acceleration)
    # the paper's rule for K_1, that 10 V give 1 m/s, is applied to the linear model too
    q = changed(p, K_1=gain(changed(p, K_e=np.inf)))
    times = PERIOD / WITHIN * np.arange(WITHIN * len(wanted) + 1)
    return 1e3 * np.abs(linear(q, wanted) - nonlinear(p, wanted, times)).max()


def opinions():
    choice = read("choices.toml")["move"]
    speed, acceleration = choice["velocity"], choice["acceleration"]
    moves = {
        "text": (speed, acceleration),
        "caption": (1.0, acceleration),  # the speed in the caption of the paper's Figure 4
        "acceleration": (speed, 1.5 * acceleration),
        "little_more": (speed, 1.05 * acceleration),
        "K_e": (speed, acceleration, 0.9),
    }
    # mm; the arm is integrated to 1e-5 mm and compared every 0.25 ms. The record takes seven states
    # with a large finite K_e, and one count of the encoder (0.018 mm) that falls the other way in
    # one of two such models moves the third digit
    return {
        f"50_programmed_move::linear_apart_{name}": (apart(*move), 1e-3)
        for name, move in moves.items()
    }
