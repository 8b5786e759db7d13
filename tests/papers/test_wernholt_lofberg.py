"""Optimal positions in the setting of Wernholt and Loefberg (2007), [WM] section 5.2.

7920 candidate positions from a joint grid, a robot with twelve springs, shares of experiments that
minimise log det of the covariance; the paper's dual and 15 positions in its optimum. The robot is
not the paper's, so the number of positions is not asserted but bounded and printed.
"""

import cvxpy as cp
import numpy as np
import pytest

import oed
from oed.design.coordinates import whiten
from robotmodels import RelativeNoise, load_robot

SPRINGS = 12


COARSE, PAPER = (1, 5, 6, 5, 6, 1), (1, 11, 10, 9, 8, 1)
GRIDS = [COARSE, pytest.param(PAPER, marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def info(request):
    robot, counts = load_robot("manutec_r3_26"), request.param
    axes = [
        np.linspace(low, high, count) if count > 1 else np.zeros(1)
        for (low, high), count in zip(robot.position_limits, counts, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    omega = 2 * np.pi * np.linspace(2, 50, 20)
    everything = oed.information(robot, grid, omega, RelativeNoise())
    names = robot.parameters.names[:SPRINGS]
    assert all(name.endswith("stiffness") for name in names)
    return oed.InformationSet(grid, everything.matrices[:, :SPRINGS, :SPRINGS], names)


@pytest.mark.parametrize("info", GRIDS, indirect=True)
def test_primal_dual_and_newton_agree(info):
    fast = oed.optimal_design(info, solver="newton")
    primal = oed.optimal_design(info, solver="cvxpy", form="primal")
    dual = oed.optimal_design(info, solver="cvxpy", form="dual")
    assert primal.value == pytest.approx(fast.value, abs=SPRINGS * 1e-6)
    assert dual.value == pytest.approx(fast.value, abs=SPRINGS * 1e-6)
    assert max(fast.gap, primal.gap, dual.gap) <= 1e-6
    print(f"{len(fast.support)} of {len(info)} positions carry weight; the paper says 15")
    # Caratheodory's bound; the paper's point is that few positions of thousands are used.
    assert len(fast.support) <= SPRINGS * (SPRINGS + 1) // 2


@pytest.mark.parametrize("info", GRIDS, indirect=True)
def test_plan_of_fifteen_experiments(info):
    design = oed.optimal_design(info, solver="newton")
    plan = oed.exact_design(info, n_experiments=15, design=design)
    assert plan.repetitions.sum() == 15
    assert plan.efficiency > 0.98
    # Negative control: fifteen random positions are far worse.
    rng = np.random.default_rng(0)
    random = [
        np.exp(
            (
                np.linalg.slogdet(
                    info.matrices[rng.integers(0, len(info), 15)].mean(axis=0)
                ).logabsdet
                - design.value
            )
            / SPRINGS
        )
        for _ in range(20)
    ]
    assert max(random) < 0.9


@pytest.mark.parametrize("info", GRIDS[1:], indirect=True)
def test_the_papers_dual_over_all_candidates_at_once(info):
    """max log det W, tr(W H_i) <= p: one problem, no active set."""
    assert info.matrices.shape == (7920, SPRINGS, SPRINGS)
    white = whiten(info.matrices, info.total / len(info))
    W = cp.Variable((SPRINGS, SPRINGS), PSD=True)
    prices = white.reshape(len(white), -1) @ cp.vec(W, order="C")
    statement = cp.Problem(cp.Maximize(cp.log_det(W)), [prices <= SPRINGS])
    best = -statement.solve(solver=cp.SCS, eps=1e-7, max_iters=50_000)
    shift = np.linalg.slogdet(info.total / len(info)).logabsdet
    fast = oed.optimal_design(info, solver="newton")
    assert fast.value - shift == pytest.approx(best, abs=1e-4)
