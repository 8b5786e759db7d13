"""The same costs and normal equations by other means; run by `fits.py` in a separate venv.

``python fits_peers.py PEER DATA.npz OUT.npz`` reads a spring network's arrays and measured FRFs,
computes what PEER computes, and writes it with the best time.
"""

import sys
import time

import numpy as np

REPEATS = 3
WALKERS = {"jax": 16, "numpy": 2}


def jax_functions(data):
    """Return the weighted residuals of ln theta steps, and how many positions they have."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    w, a, free = jnp.array(data["omega"]), jnp.array(data["incidence"]), data["free"]
    S, damping = jnp.array(data["selector"]), jnp.array(data["damping"])
    mass, stiffness = jnp.array(data["mass"]), jnp.array(data["stiffness"])
    k0, c0 = jnp.array(data["spring_stiffness"][0]), jnp.array(data["spring_damping"][0])
    measured, roots = jnp.array(data["measured"]), jnp.array(np.sqrt(data["weights"]))
    logarithmic = str(data["residual"]) == "lls"

    def residuals(steps):
        k = k0.at[free].multiply(jnp.exp(steps[: len(free)]), unique_indices=True)
        c = c0.at[free].multiply(jnp.exp(steps[len(free) :]), unique_indices=True)
        K = (stiffness + (a.T * k) @ a)[:, None]
        C = damping + (a.T * c) @ a
        A = K - w[:, None, None] ** 2 * mass[:, None] + 1j * w[:, None, None] * C
        X = jnp.linalg.solve(A, jnp.broadcast_to(S + 0j, (*A.shape[:-1], S.shape[1])))
        G = -(w[:, None, None] ** 2) * (S.T @ X)
        apart = jnp.log(measured / G) if logarithmic else measured - G
        return (roots * apart).ravel()

    return jax, jnp, residuals


def by_jax(data):
    """Return what gives cost, gradient and Gauss-Newton matrix, differentiated forwards."""
    jax, jnp, residuals = jax_functions(data)

    def normal(steps):
        r, J = residuals(steps), jax.jacfwd(residuals)(steps)
        return jnp.sum(jnp.abs(r) ** 2), 2 * (J.conj().T @ r).real, 2 * (J.conj().T @ J).real

    compiled = jax.jit(normal)
    return lambda: [np.asarray(x) for x in compiled(jnp.array(data["steps"][0]))]


def by_jax_walkers(data):
    """Return a function that gives the costs of some walkers, vectorised over them."""
    jax, jnp, residuals = jax_functions(data)
    compiled = jax.jit(jax.vmap(lambda steps: jnp.sum(jnp.abs(residuals(steps)) ** 2)))
    some = jnp.array(data["steps"][: WALKERS["jax"]])
    return lambda: [np.asarray(compiled(some))]


def by_numpy_walkers(data):
    """Return a function that gives the costs of some walkers, one after the other."""
    w, a, free = data["omega"], data["incidence"], data["free"]
    S, weights, measured = data["selector"], data["weights"], data["measured"]

    def cost(steps):
        k, c = data["spring_stiffness"][0].copy(), data["spring_damping"][0].copy()
        k[free] *= np.exp(steps[: len(free)])
        c[free] *= np.exp(steps[len(free) :])
        K = (data["stiffness"] + (a.T * k) @ a)[:, None]
        C = data["damping"] + (a.T * c) @ a
        A = K - w[:, None, None] ** 2 * data["mass"][:, None] + 1j * w[:, None, None] * C
        X = np.linalg.solve(A, np.broadcast_to(S + 0j, (*A.shape[:-1], S.shape[1])))
        G = -(w[:, None, None] ** 2) * (S.T @ X)
        apart = np.log(measured / G) if str(data["residual"]) == "lls" else measured - G
        return np.sum(weights * np.abs(apart) ** 2)

    return lambda: [np.array([cost(steps) for steps in data["steps"][: WALKERS["numpy"]]])]


PEERS = {"jax": by_jax, "jax walkers": by_jax_walkers, "numpy walkers": by_numpy_walkers}


def main():
    """Time one peer: the best of some repeats after a first call."""
    peer, source, target = sys.argv[1:]
    run = PEERS[peer](dict(np.load(source)))
    found = run()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    np.savez(target, *found, seconds=min(times))


if __name__ == "__main__":
    main()
