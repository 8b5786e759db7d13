"""[HBH] 3.4 on chains of many sizes: masses and springs within the stated errors, or refused."""

from fractions import Fraction

import numpy as np
import pytest

from estimators.chains.inverse_eigenvalue import lanczos_chain, without_first_mass
from estimators.chains.pole_zero_spectra import first_components, zeros_between
from estimators.chains.stepwise import EIGENVALUE_PRECISION, stepwise_chain
from robotmodels.common.errors import InvalidInput, NotIdentifiable
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.modes import anti_resonances, resonances

SIZES = [(m, n) for m in range(1, 6) for n in range(2, 9)]


def random_chains(count, length, seed, decades=0.2):
    """Chains whose masses and springs are spread over so many decades to either side."""
    rng = np.random.default_rng([seed, count, length])
    masses = 2 * 10 ** rng.uniform(-decades, decades, (count, length))
    last = np.sqrt(np.outer(masses[:, -1], masses[:, -1]))
    couplings = np.triu(rng.uniform(-0.15, 0.15, (count, count)), 1) * last
    springs = 2e3 * 10 ** rng.uniform(-decades, decades, (count, length - 1))
    return CoupledChains(masses, springs, couplings + couplings.T)


def spectra(chains):
    """Each chain's squared poles, squared zeros, first mass, length and sum of masses."""
    model = chains.linear_model()
    poles = np.concatenate([[0.0], resonances(model).squares])
    for i, masses in enumerate(chains.masses):
        yield poles, anti_resonances(model, i) ** 2, masses[0], len(masses), masses.sum()


def outcomes(chains, per_step):
    """Largest error over its stated bound of each chain's solution, None where it is refused."""
    for i, spectrum in enumerate(spectra(chains)):
        try:
            solution = stepwise_chain(*spectrum, per_step=per_step)
        except NotIdentifiable:
            yield None
            continue
        errors = [solution.masses / chains.masses[i] - 1, solution.springs / chains.springs[i] - 1]
        bounds = np.concatenate([solution.mass_errors, solution.spring_errors])
        yield np.max(np.abs(np.concatenate(errors)) / np.maximum(bounds, 1e-14))


@pytest.mark.parametrize(("count", "length"), SIZES)
def test_even_chains_come_out_within_their_bounds(count, length):
    for per_step in (1, 2):
        for seed in range(3):
            ratios = list(outcomes(random_chains(count, length, seed), per_step))
            assert None not in ratios
            assert max(ratios) < 1


def test_72_chains_of_3_by_8_are_all_recovered():
    ratios = [r for seed in range(24) for r in outcomes(random_chains(3, 8, seed), 2)]
    assert len(ratios) == 72
    assert None not in ratios
    assert max(ratios) < 1


@pytest.mark.parametrize(("count", "length"), [(2, 8), (3, 6), (3, 8), (5, 5)])
def test_uneven_chains_are_right_or_refused_by_name(count, length):
    """Near-cancelling pairs and far masses that the spectra's rounding leaves open."""
    chains = [random_chains(count, length, seed, decades=0.7) for seed in range(8)]
    ratios = [r for one in chains for r in outcomes(one, 2)]
    answered = [r for r in ratios if r is not None]
    assert 0 < len(answered) < len(ratios)
    assert max(answered) < 1


def exact_solution(poles, zeros, first_mass, count, total):
    """Masses and springs as rational numbers, by monic orthogonal polynomials: no rounding."""
    poles, zeros = [Fraction(float(p)) for p in poles], [Fraction(float(z)) for z in zeros]
    weights = []
    for i, pole in enumerate(poles):
        weight = Fraction(1)
        for j, zero in enumerate(zeros):
            weight *= (zero - pole) / (poles[j if j < i else j + 1] - pole)
        weights.append(weight)
    values, before = [Fraction(1)] * len(poles), [Fraction(0)] * len(poles)
    masses, springs = [Fraction(float(first_mass))], []
    norm, beta, last = sum(weights), Fraction(0), Fraction(0)
    for j in range(count - 1):
        square = sum(w * v * v for w, v in zip(weights, values, strict=True))
        if j:
            beta = square / norm
            masses.append(last**2 / (masses[-1] * beta))
        norm = square
        alpha = sum(w * p * v * v for w, p, v in zip(weights, poles, values, strict=True)) / square
        last = alpha * masses[-1] - last
        springs.append(last)
        values, before = (
            [(p - alpha) * v - beta * b for p, v, b in zip(poles, values, before, strict=True)],
            values,
        )
    masses.append(Fraction(float(total)) - sum(masses))
    return np.array([float(v) for v in (*masses, *springs)])


@pytest.mark.parametrize("decades", [0.2, 0.5])
def test_its_own_rounding_is_small_against_that_of_the_spectra(decades):
    for seed in range(3):
        for spectrum in spectra(random_chains(2, 6, seed, decades)):
            poles, zeros, *others = spectrum
            zeros = np.clip(zeros, poles[:-1], poles[1:])
            solution = stepwise_chain(poles, zeros, *others)
            values = np.concatenate([solution.masses, solution.springs])
            bounds = np.concatenate([solution.mass_errors, solution.spring_errors])
            difference = np.abs(values / exact_solution(poles, zeros, *others) - 1)
            assert (difference <= 0.1 * bounds + 1e-14).all()


def test_what_is_refused_hangs_on_digits_that_the_spectra_do_not_have():
    """Exact arithmetic on spectra a rounding error apart: chains far apart, the true ones too."""
    rng = np.random.default_rng(4)
    spreads = []
    for seed in range(12):
        chains = random_chains(2, 8, seed, 0.7)
        for i, (poles, zeros, *others) in enumerate(spectra(chains)):
            try:
                stepwise_chain(poles, zeros, *others)
            except NotIdentifiable:
                size = EIGENVALUE_PRECISION * poles[-1]
                moved = [zeros + size * rng.choice([-1, 1], len(zeros)) for _ in range(3)]
                solutions = [exact_solution(poles, z, *others) for z in moved]
                truth = np.concatenate([chains.masses[i], chains.springs[i]])
                spreads.append(np.abs(np.array(solutions) / truth - 1).max())
    assert len(spreads) > 3
    print(np.sort(spreads))
    assert min(spreads) > 1e-3


def test_more_digits_are_used_where_they_are_stated():
    """Spectra right to the last bit: more is recovered than from those of an eigenvalue solver."""
    counts = {}
    for precision in (1e-12, EIGENVALUE_PRECISION):
        counts[precision] = 0
        for seed in range(8):
            for spectrum in spectra(random_chains(3, 6, seed, 0.6)):
                try:
                    stepwise_chain(*spectrum, precision=precision)
                    counts[precision] += 1
                except NotIdentifiable:
                    pass
    assert counts[1e-12] < counts[EIGENVALUE_PRECISION]


def test_chains_that_do_not_feel_each_other():
    """Without couplings every pole of another chain is cancelled by a zero, as double poles are."""
    chains = random_chains(3, 4, 1)
    apart = CoupledChains(chains.masses, chains.springs, np.zeros((3, 3)))
    equal = CoupledChains(
        np.tile(chains.masses[:1], (3, 1)), np.tile(chains.springs[:1], (3, 1)), np.zeros((3, 3))
    )
    for case in (apart, equal):
        for i, spectrum in enumerate(spectra(case)):
            solution = stepwise_chain(*spectrum)
            assert solution.masses == pytest.approx(case.masses[i], rel=1e-9)
            assert solution.springs == pytest.approx(case.springs[i], rel=1e-9)


def test_more_masses_than_the_motor_feels_modes_are_named():
    chains = random_chains(2, 3, 1)
    apart = CoupledChains(chains.masses, chains.springs, np.zeros((2, 2)))
    poles, zeros, mass, _, total = next(spectra(apart))
    with pytest.raises(NotIdentifiable, match=r"m4.*the motor's FRF has 3 modes") as error:
        stepwise_chain(poles, zeros, mass, 4, total)
    assert error.value.names == ("m4",)


def test_measured_precision_is_part_of_the_answer():
    poles, zeros, *others = next(spectra(random_chains(3, 3, 2)))
    solution = stepwise_chain(poles, zeros, *others, precision=1e-6)
    sharper = stepwise_chain(poles, zeros, *others, precision=1e-7)
    assert solution.mass_errors[1:-1] == pytest.approx(10 * sharper.mass_errors[1:-1])
    with pytest.raises(NotIdentifiable, match=r"of 0\.01 of the largest leave them open"):
        stepwise_chain(poles, zeros, *others, precision=0.01)


def test_a_rigid_mode_is_needed_and_a_positive_precision():
    poles, zeros, *others = next(spectra(random_chains(1, 3, 2)))
    with pytest.raises(InvalidInput, match="the rigid mode's, 0, is needed first"):
        stepwise_chain(poles + 5, zeros + 5, *others)
    with pytest.raises(InvalidInput, match="precision"):
        stepwise_chain(poles, zeros, *others, precision=0.0)
    with pytest.raises(InvalidInput, match="finite"):
        stepwise_chain(poles, zeros * np.nan, *others)


def test_pairs_out_of_order_by_rounding_count_as_cancelled():
    poles, zeros = np.array([0.0, 4.0, 9.0]), np.array([2.0, 9.0 * (1 + 1e-14)])
    assert first_components(poles, zeros, 1e-12)[2] == 0
    with pytest.raises(InvalidInput, match="do not interlace"):
        first_components(poles, zeros)


def test_small_distances_of_zeros_from_poles_are_right_to_rounding():
    """For two poles the zero is known: lambda_1 + gap w_1/(w_1 + w_2)."""
    for exponent in (1, 8, 30, 100):
        weights = np.array([10.0**-exponent, 1.0])
        _, distances = zeros_between(np.array([3.0, 7.0]), weights)
        assert -distances[0, 0] == pytest.approx(4 * weights[0] / weights.sum(), rel=1e-13)
    zeros, _ = zeros_between(np.array([0.0, 1.0, 1.0, 2.0]), np.array([1.0, 0.5, 0.5, 1.0]))
    assert zeros[1] == 1.0
    zeros, _ = zeros_between(np.array([0.0, 1.0, 3.0]), np.array([1.0, 0.0, 1.0]))
    assert zeros == pytest.approx([1.0, 1.5])


def test_taking_masses_off_is_the_lanczos_recursion():
    poles, zeros, mass, length, total = next(spectra(random_chains(2, 5, 3)))
    squares = first_components(poles, zeros) ** 2
    masses, springs = lanczos_chain(poles, squares, mass, length, total)
    left, weights = without_first_mass(poles, squares, mass)
    fewer = lanczos_chain(left, weights, 1 / weights.sum(), length - 1, total - mass)
    assert fewer[0] == pytest.approx(masses[1:], rel=1e-9)
    assert fewer[1] == pytest.approx(springs[1:], rel=1e-9)
