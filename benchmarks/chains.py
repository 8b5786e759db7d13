"""Identification of coupled chains: time against M and N, and how errors grow with noise.

Prints JSON: for each size, seconds from exact FRFs and from noisy ones, the condition number and
the errors; for the case study of [HBH], relative errors and claimed standard deviations by noise.
"""

import json
import sys
import time

import numpy as np

from estimators.chains.identification import identify_chains
from estimators.chains.inverse_eigenvalue import lanczos_chain
from estimators.chains.pole_zero_spectra import first_components
from robotmodels.common.errors import IdentificationError
from robotmodels.linear.chain_responses import chain_response, modally_damped
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import anti_resonances, resonances

SIZES = [(m, n) for m in (1, 2, 3, 5) for n in (2, 3, 4, 6)]
MOST_NOISY_MODES = 10  # larger sizes are timed without noise only
NOISE = [0.001, 0.003, 0.01, 0.03, 0.1]
CASE_STUDY = CoupledChains(
    np.array([[0.7, 2, 3], [4, 5, 6], [7, 8, 9]]),
    np.array([[1000.0, 2000], [3000, 4000], [5000, 6000]]),
    np.array([[0.0, 1, 2], [1, 0, 3], [2, 3, 0]]),
)


def random_chains(count, length):
    """Return chains of masses 1 to 3 and springs 1000 to 3000."""
    rng = np.random.default_rng([count, length])
    couplings = np.triu(rng.uniform(-0.3, 0.3, (count, count)), 1)
    return CoupledChains(
        rng.uniform(1.0, 3.0, (count, length)),
        rng.uniform(1e3, 3e3, (count, length - 1)),
        couplings + couplings.T,
    )


def noisy(model, omega, relative, rng):
    """Return FRFs with relative noise and its variances."""
    G = model.frequency_response(omega)
    largest = np.abs(G).max(axis=(1, 2), keepdims=True)
    variance = relative**2 * (np.abs(G) ** 2 + (0.3 * largest) ** 2)
    parts = rng.standard_normal((2, *G.shape)) * np.sqrt(variance / 2)
    return G + parts[0] + 1j * parts[1], variance


def error(found, chains):
    """Return the largest relative error of masses and springs."""
    return max(
        float(np.abs(found.masses / chains.masses - 1).max()),
        float(np.abs(found.springs / chains.springs - 1).max()),
    )


def size(count, length):
    """Return times and errors for one size."""
    chains = random_chains(count, length)
    model = chains.linear_model()
    begun = time.perf_counter()
    poles = np.concatenate([[0.0], resonances(model).squares])
    for i in range(count):
        first = first_components(poles, anti_resonances(model, i) ** 2)
        lanczos_chain(poles, first**2, chains.masses[i, 0], length, chains.masses[i].sum())
    spectra = time.perf_counter() - begun
    omega = np.linspace(0.02, 1.1, 60 * length) * np.sqrt(poles[-1])
    begun = time.perf_counter()
    exact = identify_chains(omega, chain_response(chains, omega), length)
    result = {
        "chains": count,
        "masses": length,
        "eigenvalues_s": spectra,
        "exact_s": time.perf_counter() - begun,
        "condition": exact.inverse.condition,
        "exact_error": error(exact, chains),
    }
    if count * (length - 1) > MOST_NOISY_MODES:
        return result
    G, variance = noisy(modally_damped(model, 0.005), omega, 0.01, np.random.default_rng(0))
    begun = time.perf_counter()
    try:
        found = identify_chains(omega, G, length, covariance=variance)
    except IdentificationError as refused:
        return result | {"noisy_s": time.perf_counter() - begun, "refused": str(refused)}
    return result | {"noisy_s": time.perf_counter() - begun, "noisy_error": error(found, chains)}


def growth(relative, runs):
    """Return medians of largest errors and of claimed deviations, both routes."""
    omega, rng = 2 * np.pi * np.arange(0.5, 10.0, 0.1), np.random.default_rng(1)
    model = modally_damped(CASE_STUDY.linear_model(), 0.005)
    truth = np.concatenate([CASE_STUDY.masses.ravel(), CASE_STUDY.springs.ravel(), [1, 2, 3]])
    errors, claimed, refused = [], [], 0
    for _ in range(runs):
        G, variance = noisy(model, omega, relative, rng)
        try:
            found = identify_chains(omega, G, 3, covariance=variance)
        except IdentificationError:
            refused += 1
            continue
        both = (found.inverse, found.structured)
        errors.append([np.median(np.abs(e.values / truth - 1)) for e in both])
        claimed.append([np.median(e.relative_std) for e in both])
    if not errors:
        return {"noise": relative, "refused": refused}
    names = ("inverse", "likelihood")
    return {
        "noise": relative,
        "refused": refused,
        "error": dict(zip(names, np.median(errors, axis=0).tolist(), strict=True)),
        "std": dict(zip(names, np.median(claimed, axis=0).tolist(), strict=True)),
    }


def main():
    """Print the report."""
    quick = "--quick" in sys.argv
    sizes = SIZES[:3] if quick else SIZES
    report = {
        "sizes": [size(*pair) for pair in sizes],
        "noise": [growth(level, 1 if quick else 5) for level in (NOISE[:2] if quick else NOISE)],
    }
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
