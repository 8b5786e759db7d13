"""A fit's cost, gradient and Gauss-Newton matrix by JAX; run by `multistart.py` in its own venv.

``python multistart_peer.py NETWORK.npz OUT.npz`` reads the arrays of a spring network with the
measured FRFs and weights, and writes the numbers with the best time.
"""

import sys
import time

import numpy as np

REPEATS = 3


def main():
    """Differentiate the log residuals forwards; compiled, one position after the other."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    source, target = sys.argv[1:]
    net = {name: jnp.array(value) for name, value in np.load(source).items()}
    w, a, S = net["omega"], net["incidence"], net["selector"]
    at, springs = net["coordinates"], len(net["incidence"])

    def residuals(steps, mass, stiffness, first, second, measured, root):
        factors = jnp.exp(net["exponents"] @ steps)
        first, second = first * factors[: len(first)], second * factors[len(first) :]
        k, c = first[:springs], second[:springs]
        K = stiffness + (a.T * k) @ a
        C = (net["damping"] + (a.T * c) @ a).at[at, at].add(first[springs:])
        mass = mass.at[at, at].add(second[springs:])
        A = K - w[:, None, None] ** 2 * mass + 1j * w[:, None, None] * C
        X = jnp.linalg.solve(A, jnp.broadcast_to(S + 0j, (len(w), *S.shape)))
        G = -(w[:, None, None] ** 2) * (S.T @ X)
        white = root * jnp.log(measured / G)
        return jnp.concatenate([white.real.ravel(), white.imag.ravel()])

    def one(arrays):
        zero = jnp.zeros(net["exponents"].shape[1])
        r, J = residuals(zero, *arrays), jax.jacfwd(residuals)(zero, *arrays)
        return r @ r, 2 * J.T @ r, 2 * J.T @ J

    names = ("mass", "stiffness", "first", "second", "measured")
    arrays = (*(net[name] for name in names), jnp.sqrt(net["weights"]))

    @jax.jit
    def run(arrays):
        return [part.sum(axis=0) for part in jax.lax.map(one, arrays)]

    found = [np.asarray(part) for part in run(arrays)]
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        jax.block_until_ready(run(arrays))
        times.append(time.perf_counter() - start)
    cost, gradient, hessian = found
    np.savez(target, cost=cost, gradient=gradient, hessian=hessian, seconds=min(times))


if __name__ == "__main__":
    main()
