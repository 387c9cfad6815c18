"""What the exact solver needs and numba does not offer: LAPACK for real matrices, and instructions.

Numba counts the references to every array of a tuple whenever the tuple is passed on, by atomic
instructions that cost as much as all the arithmetic of the solver. Functions that work on
`borrowed` arrays count nothing.
"""

# mypy: disable-error-code="no-untyped-def"

import llvmlite.binding  # type: ignore[import-untyped]
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import get_cython_function_address, intrinsic

from armsim.machine_code import kept

# --- arrays without reference counts ----------------------------------------------------------


def _uncounted(context, builder, kind, value):
    if isinstance(kind, types.BaseTuple):
        for n, item in enumerate(kind.types):
            part = _uncounted(context, builder, item, builder.extract_value(value, n))
            value = builder.insert_value(value, part, n)
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    return value


@intrinsic
def borrowed(typing, arrays):
    """The same tuple of arrays, or of tuples of them, without reference counts.

    What it is made from must be passed to `keep_alive` after the last use of these arrays.
    """
    return arrays(arrays), lambda context, builder, _, tuples: _uncounted(
        context, builder, arrays, tuples[0]
    )


@intrinsic
def keep_alive(typing, arrays):
    """Do nothing; before this, numba does not free the arrays."""
    return types.void(arrays), lambda context, *_: context.get_dummy_value()


# --- sums in twice the working precision ------------------------------------------------------


@intrinsic
def fma(typing, a, b, c):
    """A b + c, rounded once."""
    one = types.float64
    return one(one, one, one), lambda context, builder, signature, three: builder.fma(*three)


# --- LAPACK -----------------------------------------------------------------------------------

# If eigenvalues are complex, numba's np.linalg.eig accepts only complex matrices, at twice the
# cost.
llvmlite.binding.add_symbol(
    "armsim_dgeev", get_cython_function_address("scipy.linalg.cython_lapack", "dgeev")
)
_integers, _numbers = types.CPointer(types.int32), types.CPointer(types.float64)
_dgeev = types.ExternalFunction(
    "armsim_dgeev",
    types.void(
        *(_integers, _integers, _integers, _numbers, _integers, _numbers, _numbers),
        *(_numbers, _integers, _numbers, _integers, _numbers, _integers, _integers),
    ),
)


@kept(error_model="numpy", nogil=True)
def eigen(A):
    """Complex eigenvalues (n,) and eigenvectors (n, n) of a real matrix, and a failure flag."""
    n = A.shape[0]
    # Two arrays hold all that LAPACK reads and writes. Both are read after the call, since numba
    # might otherwise free them too early. 78 and 86 are the letters N and V, for no left but right
    # eigenvectors.
    whole = np.array([78, 86, n, 1, 8 * n, 0], np.int32)
    left, right, size, one, length, info = 0, 1, 2, 3, 4, 5
    real = np.empty(2 * n * n + 10 * n)
    matrix, v, w = real, real[n * n :], real[2 * n * n :]
    for i in range(n):
        for j in range(n):
            matrix[j * n + i] = A[i, j]
    _dgeev(
        whole[left:].ctypes, whole[right:].ctypes, whole[size:].ctypes, matrix.ctypes,
        whole[size:].ctypes, w.ctypes, w[n:].ctypes, v.ctypes, whole[one:].ctypes, v.ctypes,
        whole[size:].ctypes, w[2 * n :].ctypes, whole[length:].ctypes, whole[info:].ctypes,
    )  # fmt: skip
    rate, V = np.empty(n, np.complex128), np.empty((n, n), np.complex128)
    for k in range(n):
        rate[k] = complex(w[k], w[n + k])
        first = k if w[n + k] >= 0.0 else k - 1  # a pair is stored as real and imaginary part
        for i in range(n):
            imaginary = v[(first + 1) * n + i] if w[n + k] != 0.0 else 0.0
            V[i, k] = complex(v[first * n + i], imaginary if w[n + k] >= 0.0 else -imaginary)
    return rate, V, whole[info] != 0
