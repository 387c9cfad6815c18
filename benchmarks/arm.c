/* One axis of the arm, paper's eq. (10)-(15), for the loops of fixed_step.h.

   BRANCHES is 1 for limits by jumps, 0 for limits by minimum and maximum. */

typedef struct { double a, b, c, d, e, f, g; } state;
#define LENGTH 7
#define EACH(X) X(a, 0) X(b, 1) X(c, 2) X(d, 3) X(e, 4) X(f, 5) X(g, 6)

typedef struct {
    double U, B_a, F_0, v_s, per_M, B_m, r_g, K_b, per_J_m, K_1, K_2_K_t, T_p_plus_T_r,
        per_T_p_T_r, R_a, per_L_a, T_z, V_L, K_e, per_K_i, V_M, H, K_g, b_g;
} constants;

static inline __attribute__((always_inline)) double limited(double value, double limit)
{
#if BRANCHES
    if (__builtin_expect(value > limit, 0))
        return limit;
    if (__builtin_expect(value < -limit, 0))
        return -limit;
    return value;
#else
    value = value < limit ? value : limit;
    return value > -limit ? value : -limit;
#endif
}

static inline __attribute__((always_inline)) state rhs(double t, state y, const constants *p)
{
    (void)t;
    const double v_c = limited(y.e + p->T_z * y.f, p->V_L);
    const double v_m = limited(p->K_e * (v_c - y.g * p->per_K_i), p->V_M);
    const double x = p->r_g * y.c - y.a, v = p->r_g * y.d - y.b;
    double f_g, F_s = 0.0;
#if BRANCHES
    f_g = 0.0;
    if (x > p->H)
        f_g = (x - p->H) * p->K_g + v * p->b_g;
    else if (x < -p->H)
        f_g = (x + p->H) * p->K_g + v * p->b_g;
#else
    const double delta = x - limited(x, p->H);
    f_g = delta * p->K_g + v * (delta != 0.0 ? p->b_g : 0.0);
#endif
    if (__builtin_fabs(y.b) < p->v_s)
        F_s = y.b > 0.0 ? p->F_0 : y.b < 0.0 ? -p->F_0 : 0.0;
    return (state){
        y.b,
        (f_g - p->B_a * y.b - F_s) * p->per_M,
        y.d,
        (p->K_b * y.g - p->B_m * y.d - p->r_g * f_g) * p->per_J_m,
        y.f,
        (p->K_1 * p->U - y.e - p->T_p_plus_T_r * y.f - p->K_2_K_t * y.d) * p->per_T_p_T_r,
        (v_m - p->R_a * y.g - p->K_b * y.d) * p->per_L_a,
    };
}

#include "fixed_step.h"
