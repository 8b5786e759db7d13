"""Fisher information of spring networks, eight frequencies at once.

A spring's derivative of the FRF is of rank one, dG/d ln k_s = w^2 k_s v_s v_s^T, and a damper's is
j w c_s/k_s times that. So with P_st the weighted product of v_s v_s^T and v_t v_t^T, the sums over
frequency of Re P, w Im P and w^2 Re P hold every spring and damper entry.
"""

# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls (numba has no types)

from typing import NamedTuple

import numpy as np
from numba import njit

from robotmodels.arrays import Array
from robotmodels.kernel_layout import BLOCK, Layout
from robotmodels.kernel_solve import bound_rows, motor_response, pack_position, solve, square
from robotmodels.simd import (
    LANES,
    aligned,
    fma,
    fma_conjugate,
    lane_sum,
    load,
    load_complex,
    maximum,
    pack,
    splat,
    store,
)


class Sums(NamedTuple):
    """What one thread accumulates in; vectors but for the last two.

    elongation : (m, n) v, of the needed springs.
    products : (m, elements) v_i v_j for i <= j.
    weights : (elements,) w^4 over the variance, twice that off the diagonal.
    panel : (3, elements) weighted products of three springs.
    sums : (pairs, 3) of springs s >= t: Re P, w Im P, w^2 Re P.
    block : (2 m, 2 m) information on ln k and ln c.
    half : (2 m, p) `block` times the exponents.
    """

    elongation: Array
    products: Array
    weights: Array
    panel: Array
    sums: Array
    block: Array
    half: Array


def sums(plan: Layout, n_parameters: int) -> Sums:
    """Return buffers for one thread."""
    n, m = len(plan.motors), len(plan.needed)
    elements = n * (n + 1) // 2
    return Sums(
        elongation=aligned(2 * m * n),
        products=aligned(2 * m * elements),
        weights=aligned(elements),
        panel=aligned(2 * BLOCK * elements),
        sums=aligned(3 * m * (m + 1) // 2),
        block=np.zeros((2 * m, 2 * m)),
        half=np.zeros((2 * m, n_parameters)),
    )


@njit
def weigh(plan, work, out, relative, floor, mask):
    """Write w^4 over the noise law's variance of each element of G, in which w^4 cancels."""
    n = len(plan.motors)
    largest = splat(0.0)
    e = 0
    for i in range(n):
        for j in range(i, n):
            size = square(motor_response(plan, work, i, j))
            largest = maximum(size, largest)
            store(out.weights, e, size)
            e += 1
    largest = largest * splat(floor * floor)
    e = 0
    for i in range(n):
        for j in range(i, n):
            variance = fma(load(out.weights, e), splat(relative * relative), largest)
            share = mask if i == j else mask + mask
            store(out.weights, e, share / variance)
            e += 1


@njit
def elongate(plan, work, out):
    """Write v = X^T a of every needed spring and the products v_i v_j."""
    n, size, e = len(plan.motors), len(plan.order), 0
    wide = 2 * BLOCK * ((n + BLOCK - 1) // BLOCK)
    Y, v = work.receptance, out.elongation
    for s in range(len(plan.needed)):
        a, b = plan.needed[s, 1], plan.needed[s, 2]
        for j in range(n):
            y = load_complex(Y, a * wide + 2 * j)
            if b >= 0:
                y = y - load_complex(Y, b * wide + 2 * j)
            if b == -2:
                y = y * load_complex(work.wind, 6 * (a - (size - n)) + 2)
            y = y * load_complex(work.wind, 6 * j)
            if b == -2 and a == size - n + j:
                y = y - load_complex(work.wind, 6 * j + 4)
            store(v, 2 * (s * n + j), y)
        for i in range(n):
            x = load_complex(v, 2 * (s * n + i))
            for j in range(i, n):
                store(out.products, 2 * e, x * load_complex(v, 2 * (s * n + j)))
                e += 1


@njit
def accumulate(total, s, t, product, w):
    """Add a pair's product to its three sums."""
    place = 3 * (s * (s + 1) // 2 + t)
    slope = product.real * w
    store(total, place, load(total, place) + product.real)
    store(total, place + 1, fma(product.imag, w, load(total, place + 1)))
    store(total, place + 2, fma(slope, w, load(total, place + 2)))


@njit
def multiply(m, elements, out, w):
    """Add this vector of frequencies to the sums."""
    products, panel, total = out.products, out.panel, out.sums
    zero = pack(splat(0.0), splat(0.0))
    whole = m - m % 3
    for t in range(0, whole, 3):
        f0 = 2 * t * elements
        f1, f2 = f0 + 2 * elements, f0 + 4 * elements
        for e in range(elements):
            weight = load(out.weights, e)
            store(panel, 6 * e, load_complex(products, f0 + 2 * e) * weight)
            store(panel, 6 * e + 2, load_complex(products, f1 + 2 * e) * weight)
            store(panel, 6 * e + 4, load_complex(products, f2 + 2 * e) * weight)
        multiply_diagonal(t, elements, out, w)
        for s in range(t + 3, whole, 3):
            g0 = 2 * s * elements
            g1, g2 = g0 + 2 * elements, g0 + 4 * elements
            x00, x01, x02 = zero, zero, zero
            x10, x11, x12 = zero, zero, zero
            x20, x21, x22 = zero, zero, zero
            for e in range(elements):
                p0 = load_complex(panel, 6 * e)
                p1 = load_complex(panel, 6 * e + 2)
                p2 = load_complex(panel, 6 * e + 4)
                a = load_complex(products, g0 + 2 * e)
                x00 = fma_conjugate(a, p0, x00)
                x01 = fma_conjugate(a, p1, x01)
                x02 = fma_conjugate(a, p2, x02)
                a = load_complex(products, g1 + 2 * e)
                x10 = fma_conjugate(a, p0, x10)
                x11 = fma_conjugate(a, p1, x11)
                x12 = fma_conjugate(a, p2, x12)
                a = load_complex(products, g2 + 2 * e)
                x20 = fma_conjugate(a, p0, x20)
                x21 = fma_conjugate(a, p1, x21)
                x22 = fma_conjugate(a, p2, x22)
            accumulate(total, s, t, x00, w)
            accumulate(total, s, t + 1, x01, w)
            accumulate(total, s, t + 2, x02, w)
            accumulate(total, s + 1, t, x10, w)
            accumulate(total, s + 1, t + 1, x11, w)
            accumulate(total, s + 1, t + 2, x12, w)
            accumulate(total, s + 2, t, x20, w)
            accumulate(total, s + 2, t + 1, x21, w)
            accumulate(total, s + 2, t + 2, x22, w)
        for s in range(whole, m):
            x00, x01, x02 = zero, zero, zero
            for e in range(elements):
                a = load_complex(products, 2 * (s * elements + e))
                x00 = fma_conjugate(a, load_complex(panel, 6 * e), x00)
                x01 = fma_conjugate(a, load_complex(panel, 6 * e + 2), x01)
                x02 = fma_conjugate(a, load_complex(panel, 6 * e + 4), x02)
            accumulate(total, s, t, x00, w)
            accumulate(total, s, t + 1, x01, w)
            accumulate(total, s, t + 2, x02, w)
    for s in range(whole, m):
        for t in range(whole, s + 1):
            x00 = zero
            for e in range(elements):
                b = load_complex(products, 2 * (t * elements + e)) * load(out.weights, e)
                x00 = fma_conjugate(load_complex(products, 2 * (s * elements + e)), b, x00)
            accumulate(total, s, t, x00, w)


@njit
def multiply_diagonal(t, elements, out, w):
    """Add the products of three springs among themselves, their panel being ready."""
    products, panel, total = out.products, out.panel, out.sums
    zero = splat(0.0)
    x00, x11, x22 = zero, zero, zero
    x10, x20, x21 = pack(zero, zero), pack(zero, zero), pack(zero, zero)
    for e in range(elements):
        p0, p1 = load_complex(panel, 6 * e), load_complex(panel, 6 * e + 2)
        p2 = load_complex(panel, 6 * e + 4)
        a0 = load_complex(products, 2 * (t * elements + e))
        a1 = load_complex(products, 2 * ((t + 1) * elements + e))
        a2 = load_complex(products, 2 * ((t + 2) * elements + e))
        x00 = fma(a0.imag, p0.imag, fma(a0.real, p0.real, x00))
        x11 = fma(a1.imag, p1.imag, fma(a1.real, p1.real, x11))
        x22 = fma(a2.imag, p2.imag, fma(a2.real, p2.real, x22))
        x10, x20 = fma_conjugate(a1, p0, x10), fma_conjugate(a2, p0, x20)
        x21 = fma_conjugate(a2, p1, x21)
    accumulate(total, t, t, pack(x00, zero), w)
    accumulate(total, t + 1, t + 1, pack(x11, zero), w)
    accumulate(total, t + 2, t + 2, pack(x22, zero), w)
    accumulate(total, t + 1, t, x10, w)
    accumulate(total, t + 2, t, x20, w)
    accumulate(total, t + 2, t + 1, x21, w)


@njit
def finish(network, plan, exponents, out, q, information):
    """Turn the sums of position `q` into its (p, p) information."""
    m, block, half = len(plan.needed), out.block, out.half
    for i in range(m):
        s = plan.needed[i, 0]
        k, c = network.spring_stiffness[q, s], network.spring_damping[q, s]
        for j in range(i + 1):
            t = plan.needed[j, 0]
            kt, ct = network.spring_stiffness[q, t], network.spring_damping[q, t]
            place = 3 * (i * (i + 1) // 2 + j)
            slope = 2.0 * lane_sum(load(out.sums, place + 1))
            block[i, j] = block[j, i] = 2.0 * k * kt * lane_sum(load(out.sums, place))
            block[m + i, m + j] = 2.0 * c * ct * lane_sum(load(out.sums, place + 2))
            block[m + j, m + i] = block[m + i, m + j]
            block[i, m + j] = block[m + j, i] = -k * ct * slope
            if i != j:
                block[j, m + i] = block[m + i, j] = kt * c * slope
    half[:] = 0.0
    information[:] = 0.0
    for i in range(2 * m):
        row = plan.needed[i % m, 0] + (0 if i < m else exponents.shape[0] // 2)
        for a in range(exponents.shape[1]):
            x = exponents[row, a]
            if x != 0.0:
                for j in range(2 * m):
                    half[j, a] += block[j, i] * x
    for i in range(2 * m):
        row = plan.needed[i % m, 0] + (0 if i < m else exponents.shape[0] // 2)
        for a in range(exponents.shape[1]):
            x = exponents[row, a]
            if x != 0.0:
                information[a] += x * half[i]


@njit(cache=True, nogil=True)
def informations(network, plan, exponents, omega, mask, noise, work, out, start, stop, information):
    """Write the (p, p) information of positions `start` to `stop`."""
    n, m = len(plan.motors), len(plan.needed)
    for q in range(start, stop):
        pack_position(network, plan, work, q)
        bound_rows(work.packed, work.bounds, len(plan.order))
        out.sums[:] = 0.0
        for b in range(len(omega) // LANES):
            w = load(omega, b)
            solve(network, plan, work, q, w)
            weigh(plan, work, out, noise[0], noise[1], load(mask, b))
            elongate(plan, work, out)
            multiply(m, n * (n + 1) // 2, out, w)
        finish(network, plan, exponents[q], out, q, information[q])
