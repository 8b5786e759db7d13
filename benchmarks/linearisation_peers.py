"""The same information matrices by other means; run by `linearisation.py` in a separate venv.

``python linearisation_peers.py PEER NETWORK.npz OUT.npz`` reads the arrays of a spring network,
computes the information of some positions and writes it with the best time per position.
"""

import sys
import time

import numpy as np

REPEATS = 3
POSITIONS = {"numpy": 10, "jax": 16, "control": 2}
STEP = 1e-6


def variance(response):
    """Return the noise law's variances: 3 % of the element and 1 % of the largest."""
    size = np.abs(response)
    return (0.03 * size) ** 2 + (0.01 * size.max(axis=(-2, -1), keepdims=True)) ** 2


def information(response, jacobian):
    """Return 2 sum Re(conj(J) J^T / variance) of one position, jacobian (F, n, n, p)."""
    flat = (jacobian / np.sqrt(variance(response))[..., None]).reshape(-1, jacobian.shape[-1])
    return 2 * (flat.conj().T @ flat).real


def by_numpy(net):
    """Solve directly at all frequencies at once; sensitivities are of rank one."""
    w = net["omega"]
    a, free = net["incidence"], net["free"]
    results = []
    for q in range(POSITIONS["numpy"]):
        k, c = net["spring_stiffness"][q], net["spring_damping"][q]
        K = net["stiffness"][q] + (a.T * k) @ a
        C = net["damping"] + (a.T * c) @ a
        A = K - w[:, None, None] ** 2 * net["mass"][q] + 1j * w[:, None, None] * C
        X = np.linalg.solve(
            A, np.broadcast_to(net["selector"] + 0j, (len(w), *net["selector"].shape))
        )
        G = -(w[:, None, None] ** 2) * (net["selector"].T @ X)
        v = a[free] @ X
        springs = (w**2)[:, None, None, None] * (v[..., :, None] * v[..., None, :])
        springs = np.moveaxis(springs, 1, -1)
        dampers = springs * c[free] * (1j * w)[:, None, None, None]
        results.append(information(G, np.concatenate([springs * k[free], dampers], axis=-1)))
    return results


def by_jax(net):
    """Differentiate the FRF forwards; compiled, vectorised over positions."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    w, a, free = jnp.array(net["omega"]), jnp.array(net["incidence"]), net["free"]
    S, damping = jnp.array(net["selector"]), jnp.array(net["damping"])

    def response(steps, mass, stiffness, k, c):
        k = k.at[free].multiply(jnp.exp(steps[: len(free)]), unique_indices=True)
        c = c.at[free].multiply(jnp.exp(steps[len(free) :]), unique_indices=True)
        K, C = stiffness + (a.T * k) @ a, damping + (a.T * c) @ a
        A = K - w[:, None, None] ** 2 * mass + 1j * w[:, None, None] * C
        right = jnp.broadcast_to(S + 0j, (len(w), *S.shape))
        return -(w[:, None, None] ** 2) * (S.T @ jnp.linalg.solve(A, right))

    def one(*arrays):
        zero = jnp.zeros(2 * len(free))
        G, J = response(zero, *arrays), jax.jacfwd(response)(zero, *arrays)
        size = jnp.abs(G)
        largest = size.max(axis=(-2, -1), keepdims=True)
        noise = jnp.sqrt((0.03 * size) ** 2 + (0.01 * largest) ** 2)
        flat = (J / noise[..., None]).reshape(-1, J.shape[-1])
        return 2 * (flat.conj().T @ flat).real

    names = ("mass", "stiffness", "spring_stiffness", "spring_damping")
    arrays = [jnp.array(net[name][: POSITIONS["jax"]]) for name in names]
    run = net.setdefault("compiled", jax.jit(jax.vmap(one)))
    return list(np.asarray(run(*arrays)))


def by_control(net):
    """Build a state-space model per parameter step and difference its frequency responses."""
    import control

    w, a, free = net["omega"], net["incidence"], net["free"]
    S, d = net["selector"], net["mass"].shape[-1]

    def response(q, k, c):
        inverse = np.linalg.inv(net["mass"][q])
        K = inverse @ (net["stiffness"][q] + (a.T * k) @ a)
        C = inverse @ (net["damping"] + (a.T * c) @ a)
        A = np.block([[np.zeros((d, d)), np.eye(d)], [-K, -C]])
        B = np.concatenate([np.zeros_like(S), inverse @ S])
        system = control.ss(A, B, S.T @ np.concatenate([-K, -C], axis=1), S.T @ inverse @ S)
        return np.moveaxis(system(1j * w), -1, 0)

    results = []
    for q in range(POSITIONS["control"]):
        k, c = net["spring_stiffness"][q], net["spring_damping"][q]
        G, columns = response(q, k, c), []
        for values, index in [(k, i) for i in free] + [(c, i) for i in free]:
            moved = values.copy()
            moved[index] *= 1 + STEP
            stepped = response(q, moved, c) if values is k else response(q, k, moved)
            columns.append((stepped - G) / STEP)
        results.append(information(G, np.stack(columns, axis=-1)))
    return results


def main():
    """Time one peer: the best of some repeats after a first call."""
    peer, source, target = sys.argv[1:]
    net = dict(np.load(source))
    run = {"numpy": by_numpy, "jax": by_jax, "control": by_control}[peer]
    start = time.perf_counter()
    matrices = run(net)
    first = time.perf_counter() - start
    times = []
    for _ in range(REPEATS):
        start, used = time.perf_counter(), time.process_time()
        run(net)
        times.append((time.perf_counter() - start, time.process_time() - used))
    seconds, processor = np.min(times, axis=0) / len(matrices)
    np.savez(target, matrices=matrices, seconds=seconds, processor=processor, first=first)


if __name__ == "__main__":
    main()
