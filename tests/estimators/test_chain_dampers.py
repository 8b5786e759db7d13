"""Dampers that couple modes: what undamped chains make of them, and the fit that has them."""

import numpy as np
from chain_cases import noisy

from estimators import fit_dampers, identify_chains
from robotmodels import CoupledChains

MASSES, SPRINGS = np.array([[0.7, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.array([[1e3, 2e3], [3e3, 4e3]])
COUPLINGS = np.array([[0.0, 1.0], [1.0, 0.0]])
OMEGA = np.linspace(2.0, 80.0, 120)
UNLIKE = "poles and zeros are unlike those of any such chains without dampers"


def identified(dampers):
    model = CoupledChains(MASSES, SPRINGS, COUPLINGS, dampers).linear_model()
    G, variance = noisy(model, np.random.default_rng(0), 0.005, OMEGA)
    return identify_chains(OMEGA, G, 3, covariance=variance)


def test_notes_name_the_dampers_and_the_fit_with_them_is_right():
    dampers = 3 * np.array([[0.5, 0.6], [0.7, 0.8]])
    found = identified(dampers)
    (note,) = [note for note in found.notes if note.startswith(UNLIKE)]
    assert "dampers couple the modes, which `fit_dampers` allows for" in note
    assert f"note: {note}" in str(found)
    truth = found.structured.layout.join(MASSES, SPRINGS, COUPLINGS)
    damped = fit_dampers(found)
    z = (damped.estimate.values - truth) / damped.estimate.std
    assert np.sqrt(np.mean(z**2)) < 2
    biased = (found.structured.values - truth) / found.structured.std
    assert np.sqrt(np.mean(biased**2)) > 2  # the note is right to doubt it
    assert (np.abs(damped.dampers - dampers) < 4 * damped.dampers_std).all()
    assert f"damper of K4  {damped.dampers[1, 1]:.4g} +- " in str(damped)


def test_dampers_in_proportion_to_springs_couple_nothing():
    assert not any(note.startswith(UNLIKE) for note in identified(3e-4 * SPRINGS).notes)
