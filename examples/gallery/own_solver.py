# %% [markdown]
# # A solver of your own
#
# Where people want to add something, a class with the methods of a small protocol is enough: see
# [add your own](../how-to/extend.md). Here the multiplicative algorithm of Titterington (1976) solves a D-optimal
# design, and the package certifies its answer over all candidates.

# %%
import matplotlib.pyplot as plt
import numpy as np

import oed


class Titterington:
    """The multiplicative algorithm for D and shares."""

    first_goal = 0.03  # rough answers are enough while candidates are added

    def check(self, objective):
        assert objective.name == "D"

    def solve(self, problem, goal, near=None):
        weights = problem.completed(problem.start if near is None else near.weights)
        for _ in range(5000):
            derivative = problem.objective.witness(problem.information(weights))
            sensitivity = np.einsum("nij,ji->n", problem.matrices[0], derivative[0])
            if sensitivity.max() <= 1 + goal:  # the equivalence theorem
                break
            weights = weights * sensitivity
        return oed.SolverAnswer(weights, np.array([1.0]), derivative, "Titterington")


x = np.linspace(-1, 1, 201)
rows = np.stack([np.ones_like(x), x, x**2, x**3], axis=1)
info = oed.InformationSet(x[:, None], rows[:, :, None] * rows[:, None, :], ["a", "b", "c", "d"])
design = oed.optimal_design(info, "D", solver=Titterington())
print(design)

# %% [markdown]
# Four parameters of a cubic are best measured in four points with a quarter of the experiments each. The sensitivity
# function is nowhere above one, which proves that no design is better (Kiefer and Wolfowitz 1960):

# %% picture="own_solver"
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2))
left.plot(x, design.sensitivity / design.sensitivity.max(), label="sensitivity function")
left.stem(
    x[design.support], design.weights[design.support], linefmt="C1-", basefmt=" ", label="weight"
)
left.set(xlabel="candidate x [-]", ylabel="[-]")
left.legend(loc="center")
right.semilogy(np.arange(1, len(design.gaps) + 1), design.gaps, "o-")
right.set(xlabel="round", ylabel="certified gap [-]")
figure.tight_layout()
plt.show()
