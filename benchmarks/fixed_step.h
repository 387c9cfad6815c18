/* Fixed-step Runge-Kutta loops unrolled by hand, the peer of armsim's generated loops.

   Included by arm.c and brusselator.c, which define `state` (a struct of doubles), EACH(X), which
   applies X to every member, LENGTH, and `slope rhs(t, y, c)`. LAYOUT is 0 for a trajectory
   stored as rows of components, as armsim has it, and 1 for rows of states. */

#if LAYOUT
#define PUT(m, i) y[LENGTH * (n + 1) + i] = now.m;
#else
#define PUT(m, i) y[i * (steps + 1) + n + 1] = now.m;
#endif

#define LOOP(name, body)                                                                          \
    void name(long steps, double t0, double h, const double *restrict start,                      \
              double *restrict t, double *restrict y, const constants *restrict given)            \
    {                                                                                             \
        const constants c = *given;                                                               \
        state now, u, k1, k2, k3, k4, k5, k6, k7;                                                 \
        (void)u, (void)k1, (void)k2, (void)k3, (void)k4, (void)k5, (void)k6, (void)k7;            \
        EACH(GET)                                                                                 \
        long n = -1;                                                                              \
        EACH(PUT)                                                                                 \
        t[0] = t0;                                                                                \
        for (n = 0; n < steps; n++) {                                                             \
            const double s = t0 + n * h;                                                          \
            body EACH(PUT) t[n + 1] = t0 + (n + 1) * h;                                           \
        }                                                                                         \
    }
#define GET(m, i) now.m = start[i];

/* h times a coefficient is the same in every step: the compiler takes it out of the loop. */
#define P(a) (h * (a))

#define EULER1(m, i) now.m += h * k1.m;
LOOP(euler, k1 = rhs(s, now, &c); EACH(EULER1))

#define A2(m, i) u.m = now.m + P(1. / 2) * k1.m;
#define A3(m, i) u.m = now.m + P(2. / 9) * k1.m + P(4. / 9) * k2.m;
#define A4(m, i) u.m = now.m + P(7. / 36) * k1.m + P(2. / 9) * k2.m - P(1. / 12) * k3.m;
#define A5(m, i)                                                                                  \
    u.m = now.m + P(-35. / 144) * k1.m - P(55. / 36) * k2.m + P(35. / 48) * k3.m                  \
          + P(15. / 8) * k4.m;
#define A6(m, i)                                                                                  \
    u.m = now.m + P(-1. / 360) * k1.m - P(11. / 36) * k2.m - P(1. / 8) * k3.m + P(1. / 2) * k4.m  \
          + P(1. / 10) * k5.m;
#define A7(m, i)                                                                                  \
    u.m = now.m + P(-41. / 260) * k1.m + P(22. / 13) * k2.m + P(43. / 156) * k3.m                 \
          - P(118. / 39) * k4.m + P(32. / 195) * k5.m + P(80. / 39) * k6.m;
#define A8(m, i)                                                                                  \
    now.m += h * (13. / 200 * (k1.m + k7.m) + 11. / 40 * (k3.m + k4.m) + 4. / 25 * (k5.m + k6.m));
LOOP(rk6, k1 = rhs(s, now, &c);
     EACH(A2) k2 = rhs(s + h / 2, u, &c);
     EACH(A3) k3 = rhs(s + h * 2 / 3, u, &c);
     EACH(A4) k4 = rhs(s + h / 3, u, &c);
     EACH(A5) k5 = rhs(s + h * 5 / 6, u, &c);
     EACH(A6) k6 = rhs(s + h / 6, u, &c);
     EACH(A7) k7 = rhs(s + h, u, &c);
     EACH(A8))

#define D2(m, i) u.m = now.m + P(1. / 5) * k1.m;
#define D3(m, i) u.m = now.m + P(3. / 40) * k1.m + P(9. / 40) * k2.m;
#define D4(m, i) u.m = now.m + P(44. / 45) * k1.m - P(56. / 15) * k2.m + P(32. / 9) * k3.m;
#define D5(m, i)                                                                                  \
    u.m = now.m + P(19372. / 6561) * k1.m - P(25360. / 2187) * k2.m + P(64448. / 6561) * k3.m     \
          - P(212. / 729) * k4.m;
#define D6(m, i)                                                                                  \
    u.m = now.m + P(9017. / 3168) * k1.m - P(355. / 33) * k2.m + P(46732. / 5247) * k3.m          \
          + P(49. / 176) * k4.m - P(5103. / 18656) * k5.m;
#define D7(m, i)                                                                                  \
    now.m += h * (35. / 384 * k1.m + 500. / 1113 * k3.m + 125. / 192 * k4.m - 2187. / 6784 * k5.m \
                  + 11. / 84 * k6.m);
LOOP(dp5, k1 = rhs(s, now, &c);
     EACH(D2) k2 = rhs(s + h / 5, u, &c);
     EACH(D3) k3 = rhs(s + h * 3 / 10, u, &c);
     EACH(D4) k4 = rhs(s + h * 4 / 5, u, &c);
     EACH(D5) k5 = rhs(s + h * 8 / 9, u, &c);
     EACH(D6) k6 = rhs(s + h, u, &c);
     EACH(D7))

/* The exponential form, k = f / y, with one exponential for the sum. */
#ifdef EXPONENTIAL
#define X1(m, i) k1.m /= now.m;
#define X2(m, i) k2.m /= u.m;
#define X3(m, i) k3.m /= u.m;
#define X4(m, i) k4.m /= u.m;
#define X5(m, i) k5.m /= u.m;
#define X6(m, i) k6.m /= u.m;
#define E2(m, i) u.m = now.m * exp(h * (1. / 5 * k1.m));
#define E3(m, i) u.m = now.m * exp(h * (3. / 40 * k1.m + 9. / 40 * k2.m));
#define E4(m, i) u.m = now.m * exp(h * (44. / 45 * k1.m - 56. / 15 * k2.m + 32. / 9 * k3.m));
#define E5(m, i)                                                                                  \
    u.m = now.m * exp(h * (19372. / 6561 * k1.m - 25360. / 2187 * k2.m + 64448. / 6561 * k3.m     \
                           - 212. / 729 * k4.m));
#define E6(m, i)                                                                                  \
    u.m = now.m * exp(h * (9017. / 3168 * k1.m - 355. / 33 * k2.m + 46732. / 5247 * k3.m          \
                           + 49. / 176 * k4.m - 5103. / 18656 * k5.m));
#define E7(m, i)                                                                                  \
    now.m *= exp(h * (35. / 384 * k1.m + 500. / 1113 * k3.m + 125. / 192 * k4.m                   \
                      - 2187. / 6784 * k5.m + 11. / 84 * k6.m));
LOOP(dp5_exponential, k1 = rhs(s, now, &c); EACH(X1)
     EACH(E2) k2 = rhs(s + h / 5, u, &c); EACH(X2)
     EACH(E3) k3 = rhs(s + h * 3 / 10, u, &c); EACH(X3)
     EACH(E4) k4 = rhs(s + h * 4 / 5, u, &c); EACH(X4)
     EACH(E5) k5 = rhs(s + h * 8 / 9, u, &c); EACH(X5)
     EACH(E6) k6 = rhs(s + h, u, &c); EACH(X6)
     EACH(E7))
#endif
