/* The Brusselator, y0' = A + y0² y1 - (B + 1) y0, y1' = B y0 - y0² y1, for fixed_step.h. */

#include <math.h>

typedef struct { double a, b; } state;
#define LENGTH 2
#define EACH(X) X(a, 0) X(b, 1)

typedef struct { double A, B; } constants;

static inline __attribute__((always_inline)) state rhs(double t, state y, const constants *p)
{
    (void)t;
    const double reaction = y.a * y.a * y.b;
    return (state){p->A + reaction - (p->B + 1.0) * y.a, p->B * y.a - reaction};
}

#define EXPONENTIAL
#include "fixed_step.h"
