"""The same D-optimal designs by other means; run by `design.py`, each in its own process.

``python design_peers.py PEER MATRICES.npy OUT.npz LIMIT`` reads whitened information (Q, p, p),
computes the shares of one design and writes them with the seconds it took; LIMIT is the most
processor time it may take [s].
"""

import contextlib
import io
import resource
import sys
import time

import numpy as np


def by_cvxpy(matrices, form, solver):
    """State all candidates at once: shares, or the dual of Wernholt and Loefberg (2007)."""
    import cvxpy as cp

    n, p = matrices.shape[:2]
    flat = matrices.reshape(n, -1)
    if form == "primal":
        w = cp.Variable(n, nonneg=True)
        information = cp.reshape(flat.T @ w, (p, p), order="C")
        problem = cp.Problem(cp.Maximize(cp.log_det(information)), [cp.sum(w) == 1])
        problem.solve(solver=solver)
        return w.value
    dual = cp.Variable((p, p), PSD=True)
    limits = flat @ cp.vec(dual, order="C") <= p
    problem = cp.Problem(cp.Maximize(cp.log_det(dual)), [limits])
    problem.solve(solver=solver)
    return limits.dual_value


def by_figaroh(matrices):
    """Use figaroh's optimal calibration, a second-order cone problem by picos and cvxopt."""
    from figaroh.optimal.base_optimal_calibration import SOCPOptimizer

    pieces = dict(enumerate(matrices))
    weights, order = SOCPOptimizer(pieces, {"NbSample": len(matrices)}).solve()
    return np.array([order[i] if i in order else weights[i] for i in range(len(matrices))])


def by_pydex(matrices):
    """Use pydex with sensitivities of which J'J is the information, solved by Clarabel."""
    from pydex.core.designer import Designer

    n, p = matrices.shape[:2]
    eigenvalues, vectors = np.linalg.eigh(matrices)
    J = np.swapaxes(vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :], 1, 2)
    designer = Designer()
    designer.simulate = lambda ti_controls, model_parameters: np.zeros(p)
    designer.model_parameters = np.ones(p)
    designer.ti_controls_candidates = np.arange(n, dtype=float)[:, None]
    designer.initialize(verbose=0)
    designer.sensitivities = J[:, None]
    designer.normalized_sensitivity = False
    designer.eval_sensitivities = lambda *_, **__: designer.sensitivities
    designer.design_experiment(designer.d_opt_criterion, package="cvxpy", optimizer="CLARABEL")
    return np.asarray(designer.efforts).ravel()


PEERS = {
    "cvxpy primal, Clarabel": lambda h: by_cvxpy(h, "primal", "CLARABEL"),
    "cvxpy dual, Clarabel": lambda h: by_cvxpy(h, "dual", "CLARABEL"),
    "cvxpy dual, SCS": lambda h: by_cvxpy(h, "dual", "SCS"),
    "figaroh": by_figaroh,
    "pydex": by_pydex,
}


def main():
    """Time one peer; its packages are imported before, by a tiny design."""
    peer, source, target, limit = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 5))
    matrices, run = np.load(source), PEERS[peer]
    with contextlib.redirect_stdout(io.StringIO()):
        run(matrices[: 2 * matrices.shape[-1]])
        start = time.perf_counter(), time.process_time()
        weights = run(matrices)
        seconds, cpu = time.perf_counter() - start[0], time.process_time() - start[1]
    np.savez(target, weights=weights, seconds=seconds, cpu_seconds=cpu)


if __name__ == "__main__":
    main()
