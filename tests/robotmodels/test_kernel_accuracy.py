"""The kernel against 60-digit arithmetic in hard cases, where numpy is no judge."""

from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np
import pytest
from spring_networks import error, robot

from robotmodels import kernel
from robotmodels.kernel.elimination_order import layout
from robotmodels.linear.noise import RelativeNoise

NOISE = RelativeNoise()


def _exact(network, omega, position=0):
    """Return G (n, n) and J (n, n, p) of one frequency from arithmetic with 60 digits."""
    with localcontext(prec=60):
        w, d = Decimal(float(omega)), network.mass.shape[-1]
        M, D, K, a, S, k, c = (
            _decimals(array)
            for array in (
                network.mass[position],
                network.damping[position],
                network.stiffness[position],
                network.incidence(),
                network.selector,
                network.spring_stiffness[position],
                network.spring_damping[position],
            )
        )
        real = K + (a.T * k) @ a - w * w * M
        imag = w * (D + (a.T * c) @ a)
        A = np.block([[real, -imag], [imag, real]])
        X = _solve(A, np.concatenate([S, 0 * S]))
        X = X[:d], X[d:]
        G = [-w * w * (S.T @ x) for x in X]
        vr, vi = (a @ x for x in X)
        outer = [
            _outer(vr, vr) - _outer(vi, vi),
            _outer(vr, vi) + _outer(vi, vr),
        ]
        springs = [w * w * k * part for part in outer]
        dampers = [-(w**3) * c * outer[1], w**3 * c * outer[0]]
        G, springs, dampers = (_complex(x) for x in (G, springs, dampers))
    return G, np.concatenate([springs, dampers], axis=-1) @ network.exponents[position]


def _outer(u, v):
    """Return u_si v_sj, (i, j, s)."""
    return (u[:, :, None] * v[:, None, :]).transpose(1, 2, 0)


def _decimals(array):
    return np.vectorize(Decimal, otypes=[object])(array)


def _complex(parts):
    return parts[0].astype(float) + 1j * parts[1].astype(float)


def _solve(A, B):
    """Return A^-1 B of arrays of decimals by Gauss elimination with pivoting."""
    T, n = np.concatenate([A, B], axis=1), len(A)
    for i in range(n):
        best = i + int(np.argmax(np.abs(T[i:, i])))
        T[[i, best]] = T[[best, i]]
        T[i] = T[i] / T[i, i]
        others = np.arange(n) != i
        T[others] = T[others] - np.outer(T[others, i], T[i])
    return T[:, n:]


def _small(rng, **changes):
    return robot(rng, n_positions=1, n=3, n_torsions=5, n_free_torsions=3, **changes)


def _equal_modes(rng):
    """Return three equal robots of one motor and one torsion: every mode is triple."""
    network = robot(rng, n_positions=1, n=3, n_torsions=3, n_free_torsions=3)
    mass = np.eye(9)
    mass[network.nodes[:3, 0], network.nodes[3:, 0]] = 0.3
    mass[network.nodes[3:, 0], network.nodes[:3, 0]] = 0.3
    same = np.ones_like(network.spring_stiffness)
    return replace(
        network,
        mass=mass[None],
        stiffness=np.zeros((1, 9, 9)),
        spring_stiffness=1e4 * same,
        spring_damping=10 * same,
    )


def _uneven(rng):
    network = _small(rng)
    factors = 10.0 ** rng.choice([-6, 0, 6], (2, 1, len(network.nodes)))
    return replace(
        network,
        spring_stiffness=network.spring_stiffness * factors[0],
        spring_damping=network.spring_damping * factors[1],
    )


def _on_a_resonance_of_a_leading_block(rng):
    """Return a nearly undamped network and the resonances of its leading blocks."""
    network = _small(rng, damping=1.5e-12)
    network = replace(network, damping=1e-9 * network.damping)
    plan = layout(network)
    rows = plan.order[plan.pad :]
    a = network.incidence()
    K = network.stiffness[0] + (a.T * network.spring_stiffness[0]) @ a
    omega = []
    for size in range(1, len(rows)):
        block = np.ix_(rows[:size], rows[:size])
        values = np.linalg.eigvals(np.linalg.solve(network.mass[0][block], K[block])).real
        omega.extend(np.sqrt(values[values > 0]))
    return network, np.array(omega)


HARD = {
    "0.01 Hz to 1 kHz": (_small, np.geomspace(0.01, 1e3, 16)),
    "overdamped": (lambda rng: _small(rng, damping=15.0), np.geomspace(0.1, 100, 8)),
    "equal modes": (_equal_modes, np.array([1.0, 10, 15.9154943, 20, 50, 100])),
    "k and c times 1e+-6": (_uneven, np.geomspace(0.1, 500, 12)),
}


@pytest.mark.parametrize("case", HARD)
def test_hard_cases_agree_with_sixty_digits(case):
    make, hertz = HARD[case]
    network = make(np.random.default_rng(11))
    _check_against_exact(network, 2 * np.pi * hertz)


def test_a_nearly_undamped_network_on_resonances_of_leading_blocks():
    network, omega = _on_a_resonance_of_a_leading_block(np.random.default_rng(5))
    _check_against_exact(network, omega[::3])


def _check_against_exact(network, omega):
    exact = [_exact(network, w) for w in omega]
    G = np.stack([g for g, _ in exact])[None]
    assert error(kernel.frequency_response(network, omega), G) < 1e-9
    for i, (_, J) in enumerate(exact):
        scaled = J / np.sqrt(NOISE.variance(G)[0, i])[..., None]
        flat = scaled.reshape(-1, J.shape[-1])
        expected = 2 * (flat.conj().T @ flat).real[None]
        found = kernel.information(network, omega[i : i + 1], NOISE)
        assert error(found, expected) < 1e-9


def test_without_the_guard_the_same_case_is_wrong():
    """Negative control: the case is hard only for elimination without pivoting."""
    network, omega = _on_a_resonance_of_a_leading_block(np.random.default_rng(5))
    w = omega[0]
    plan = layout(network)
    a = network.incidence()
    K = network.stiffness[0] + (a.T * network.spring_stiffness[0]) @ a
    C = network.damping[0] + (a.T * network.spring_damping[0]) @ a
    order = [*plan.order[plan.pad :], *plan.motors[:, 0]]
    A = (K - w**2 * network.mass[0] + 1j * w * C)[np.ix_(order, order)]
    assert abs(A[0, 0]) < 1e-7 * np.abs(A[0]).max()
