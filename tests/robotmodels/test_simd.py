"""Vector operations against numpy, lane by lane."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from robotmodels.kernel import memory, simd, vector_math


@njit
def _arithmetic(x, y, out):
    a, b = memory.load_complex(x, 0), memory.load_complex(y, 0)
    c, d = memory.load_complex(x, 2), memory.load(y, 2)
    memory.store(out, 0, a + b)
    memory.store(out, 2, a - b)
    memory.store(out, 4, a * b)
    memory.store(out, 6, a * d)
    memory.store(out, 8, simd.fma(a, b, c))
    memory.store(out, 10, simd.fma(a, d, c))
    memory.store(out, 12, simd.fma_conjugate(a, b, c))
    memory.store(out, 14, simd.pack(simd.fma(a.real, d, c.real), a.imag / d))
    memory.store(out, 16, simd.pack(simd.minimum(a.real, d), simd.maximum(a.real, d)))
    memory.store(out, 18, simd.pack(simd.splat(2.5), simd.where_greater(a.real, d, d, a.imag)))
    memory.store(out, 20, vector_math.log(a))
    memory.store(out, 22, vector_math.split_exponent(d * d))
    memory.store(out, 24, simd.pack(vector_math.inverse_root(d * d), simd.root(d * d)))
    memory.store_scalar(out, 26 * simd.LANES, memory.scalar(x, 3) + simd.lane_sum(d))
    return simd.any_negative(d)


def _numbers(places, rng):
    buffer = memory.aligned(places)
    buffer[:] = rng.normal(size=buffer.size)
    return buffer


def _complex(buffer, place):
    lanes = buffer.reshape(-1, simd.LANES)
    return lanes[place] + 1j * lanes[place + 1]


def test_operations_agree_with_numpy_in_every_lane():
    rng = np.random.default_rng(1)
    x, y, out = _numbers(4, rng), _numbers(3, rng), memory.aligned(27)
    negative = _arithmetic(*(memory.address(array) for array in (x, y, out)))
    a, c, b = _complex(x, 0), _complex(x, 2), _complex(y, 0)
    d = y[2 * simd.LANES :]
    exponent = np.floor(np.log2(d * d / np.sqrt(0.5)))
    expected = [
        a + b,
        a - b,
        a * b,
        a * d,
        a * b + c,
        a * d + c,
        a.conj() * b + c,
        a.real * d + c.real + 1j * a.imag / d,
        np.minimum(a.real, d) + 1j * np.maximum(a.real, d),
        2.5 + 1j * np.where(a.real > d, d, a.imag),
        np.log(a),
        exponent + 1j * d * d / 2**exponent,
        1 / np.abs(d) + 1j * np.abs(d),
    ]
    for place, value in enumerate(expected):
        np.testing.assert_allclose(_complex(out, 2 * place), value, rtol=1e-14, atol=1e-15)
    assert out[26 * simd.LANES] == pytest.approx(x[3] + d.sum())
    assert negative
    y[2 * simd.LANES :] = 1.0
    assert not _arithmetic(*(memory.address(array) for array in (x, y, out)))


def test_a_plain_processor_without_a_cache_computes_the_same(tmp_path):
    plain = {
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(tmp_path),
    }
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    names = [name for name in globals() if re.match("test_(operations|logarithm|inverse)", name)]
    program = "import test_simd\n" + "\n".join(f"test_simd.{name}()" for name in names)
    environment = os.environ | plain | {"PYTHONPATH": path}
    subprocess.run([sys.executable, "-c", program], check=True, env=environment)


def test_logarithm_is_accurate_over_all_magnitudes_and_angles():
    rng = np.random.default_rng(2)
    out = memory.aligned(27)
    y = _numbers(3, rng)
    for scale in (1e-140, 1e-5, 1.0, 1e5, 1e140):
        for _ in range(50):
            x = _numbers(4, rng)
            x[: 2 * simd.LANES] *= scale * 10 ** rng.uniform(-4, 4, 2 * simd.LANES)
            _arithmetic(*(memory.address(array) for array in (x, y, out)))
            np.testing.assert_allclose(
                _complex(out, 20).imag, np.angle(_complex(x, 0)), rtol=4e-15, atol=0
            )
            np.testing.assert_allclose(
                _complex(out, 20).real, np.log(np.abs(_complex(x, 0))), rtol=4e-15, atol=4e-16
            )


def test_inverse_roots_are_accurate_over_all_magnitudes():
    rng = np.random.default_rng(3)
    x, y, out = _numbers(4, rng), _numbers(3, rng), memory.aligned(27)
    for exponent in range(-150, 141, 10):
        y[2 * simd.LANES :] = 10.0 ** (exponent + rng.uniform(0, 10, simd.LANES))
        _arithmetic(*(memory.address(array) for array in (x, y, out)))
        np.testing.assert_allclose(
            _complex(out, 24).real, 1 / y[2 * simd.LANES :], rtol=1e-15, atol=0
        )


def test_buffers_are_aligned_and_only_contiguous_arrays_have_an_address():
    for places in range(1, 9):
        assert memory.address(memory.aligned(places)) % 64 == 0
    with pytest.raises(ValueError, match="contiguous"):
        memory.address(np.zeros((4, 4))[:, ::2])
