"""Eliminate the coordinates that no free parameter touches, at every position and frequency."""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import compiled, entry, inlined
from robotmodels.kernel.ldlt import guard, inverse, square
from robotmodels.kernel.memory import load, load_complex, store
from robotmodels.kernel.simd import BYTES, any_negative, fma, maximum, pack, root, splat
from robotmodels.kernel.solve import assemble_arm, pack_position


@inlined
def triangle_offset(i, j):
    """Return the index of entry i, j <= i of a triangle."""
    return i * (i + 1) + 2 * j


@compiled
def eliminate_front(work):
    """Eliminate the rows before the first one needed, without pivoting; return the guard."""
    worst, matrix = splat(1.0), work.matrix
    for k in range(work.pad, work.first):
        pivot = load_complex(matrix, triangle_offset(k, k))
        worst = guard(worst, pivot, square(load_complex(work.diagonal, 2 * k)), load(work.off, k))
        scale = inverse(pivot, -1.0)
        for i in range(k + 1, work.size):
            ratio = load_complex(matrix, triangle_offset(i, k)) * scale
            for j in range(k + 1, i + 1):
                index = triangle_offset(i, j)
                other = load_complex(matrix, triangle_offset(j, k))
                store(matrix, index, fma(ratio, other, load_complex(matrix, index)))
    return worst


@compiled
def store_reduced(work, pad, matrix, off):
    """Write the reduced matrix below `pad` unit rows, and the largest entries of its rows."""
    size = pad + work.size - work.first
    for i in range(size):
        store(off, i, splat(0.0))
    for i in range(size):
        row = work.first + i - pad
        for j in range(i + 1):
            x = pack(splat(1.0 if i == j else 0.0), splat(0.0))
            if j >= pad:
                x = load_complex(work.matrix, triangle_offset(row, work.first + j - pad))
            store(matrix, triangle_offset(i, j), x)
            if i != j:
                big = square(x)
                store(off, i, maximum(load(off, i), big))
                store(off, j, maximum(load(off, j), big))
    for i in range(size):
        store(off, i, root(load(off, i)))


@entry
def reductions(work, omega, blocks, pad, start, stop, matrix, off):
    """Write matrix and largest entries of cells `start` to `stop`; return whether that went well.

    The free terms' coefficients in `work` are zero. It goes well unless a pivot comes out small.
    """
    size = pad + work.size - work.first
    for cell in range(start, stop):
        if cell == start or cell % blocks == 0:
            pack_position(work, cell // blocks)
        assemble_arm(work, load(omega, cell % blocks))
        for i in range(work.size):
            store(work.matrix, triangle_offset(i, i), load_complex(work.diagonal, 2 * i))
        if any_negative(eliminate_front(work)):
            return False
        offset = BYTES * cell * size
        store_reduced(work, pad, matrix + offset * (size + 1), off + offset)
    return True
