"""The kernel against plain numpy, in threads and processes, and what it refuses."""

import json
import os
import pickle
import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
from derivatives import information_of
from spring_networks import NETWORKS, error, robot

from robotmodels import kernel
from robotmodels.common.errors import InvalidInput
from robotmodels.kernel import compiling
from robotmodels.kernel.elimination_order import layout
from robotmodels.linear.noise import InputOutputNoise, RelativeNoise

NOISE = RelativeNoise()
OMEGA = 2 * np.pi * np.linspace(2, 80, 21)


@pytest.fixture(params=NETWORKS, name="network")
def _network(request):
    return NETWORKS[request.param](np.random.default_rng(7))


def _information(network, omega):
    if not omega.size or not len(network.mass):
        return np.zeros((len(network.mass), *[len(network.parameters)] * 2))
    G, J = network.sensitivity(omega)
    return information_of(J, NOISE.variance(G))


def test_frequency_responses_agree_with_direct_solves(network):
    found = kernel.frequency_response(network, OMEGA)
    assert error(found, network.frequency_response(OMEGA)) < 1e-11


def test_information_agrees_with_the_sum_over_sensitivities(network):
    found = kernel.information(network, OMEGA, NOISE)
    assert error(found, _information(network, OMEGA)) < 1e-11


class Separable:
    """Random Hermitian factors of a noise law."""

    def factors(self, network, omega):
        rng = np.random.default_rng(9)
        n = network.selector.shape[1]
        m = n if network.measurement is None else network.measurement.position.shape[-2]
        found = []
        for size in (n, m):
            A, B = rng.normal(size=(2, len(network.mass), len(omega), size, size))
            root = A + 1j * B + 2 * np.eye(size)
            found.append(root @ np.conj(root.swapaxes(-1, -2)))
        return found[0], found[1] * omega[:, None, None] ** 4


def test_information_with_separable_noise(network):
    U, V = Separable().factors(network, OMEGA)
    _, J = network.sensitivity(OMEGA)
    # Columns are stacked: the inverse covariance is U kron inv(V).
    columns = np.moveaxis(J, -1, 2).swapaxes(-1, -2).reshape(*J.shape[:2], J.shape[-1], -1)
    weights = np.einsum("qfij,qfkl->qfikjl", U, np.linalg.inv(V))
    weights = weights.reshape(*J.shape[:2], columns.shape[-1], columns.shape[-1])
    expected = (
        2 * np.einsum("qfpi,qfij,qfrj->qpr", columns.conj(), weights, columns, optimize=True).real
    )
    assert error(kernel.information(network, OMEGA, Separable()), expected) < 1e-11


@pytest.mark.parametrize("motors", [1, 2, 3])
def test_information_of_diagonal_and_other_spectra_in_any_order(motors):
    rng = np.random.default_rng(motors)
    network = robot(rng, n_positions=3, n=motors, n_torsions=2, n_free_torsions=1)
    noise = InputOutputNoise(speed=0.1, torque=0.02)
    diagonal = rng.uniform(0, 2, (4, len(OMEGA), motors))
    u = rng.normal(size=(2, len(OMEGA), motors)) + 1j * rng.normal(size=(2, len(OMEGA), motors))
    spectra = np.zeros((5, len(OMEGA), motors, motors), dtype=complex)
    spectra[[0, 2, 3]] = diagonal[:3, ..., None] * np.eye(motors)
    spectra[[1, 4]] = u[..., None] * u[:, :, None, :].conj()
    spectra[3, ::2, 0, 0] = 0.0
    G, J = network.frequency_response(OMEGA), network.sensitivity(OMEGA)[1]
    inverse = np.linalg.inv(noise.output_error(network, G, OMEGA))
    expected = [
        2 * np.einsum("qfijp,qfik,qfklr,flj->qpr", J.conj(), inverse, J, Phi, optimize=True).real
        for Phi in spectra
    ]
    informations = kernel.excitation_informations(network, OMEGA, spectra, noise)
    for one, H in zip(expected, informations.swapaxes(0, 1), strict=True):
        assert error(H, one) < 1e-11


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
def test_costs_agree_with_their_definition(network, residual):
    rng = np.random.default_rng(3)
    theta = network.parameters.values * np.exp(0.3 * rng.normal(size=(5, len(network.parameters))))
    G = network.frequency_response(OMEGA)
    measured = G * (1 + 0.5 * rng.normal(size=G.shape) + 0.5j * rng.normal(size=G.shape))
    weights = rng.uniform(0, 1, G.shape) / NOISE.variance(G)
    weights[0, 2, 0, 0] = 0.0
    evaluate = kernel.CostKernel(network, OMEGA, measured, weights, residual)
    found = evaluate(theta)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(evaluate))(theta), found)
    for cost, row in zip(found, theta, strict=True):
        model = network.frequency_response(OMEGA, row)
        apart = measured - model if residual == "nls" else np.log(measured / model)
        apart = apart.real if residual == "lls_magnitude" else apart
        assert cost == pytest.approx(np.sum(weights * np.abs(apart) ** 2), rel=1e-11)


def test_an_element_of_weight_zero_may_be_missing():
    network = robot(np.random.default_rng(0))
    measured = network.frequency_response(OMEGA)
    weights = np.ones(measured.shape)
    measured[1, 3, 2, 4] = np.nan
    weights[1, 3, 2, 4] = 0.0
    for residual in ("nls", "lls", "lls_magnitude"):
        theta = network.parameters.values[None]
        cost = kernel.costs(network, OMEGA, measured, weights, theta, residual)
        assert cost == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("frequencies", [0, 1, 7, 8, 9])
@pytest.mark.parametrize("positions", [0, 1, 2])
def test_any_number_of_positions_and_frequencies(positions, frequencies):
    full = robot(np.random.default_rng(2), n_positions=2, n=2, n_torsions=2, n_free_torsions=1)
    network = _part(full, slice(positions))
    omega = OMEGA[:frequencies]
    G = kernel.frequency_response(network, omega)
    assert G.shape == (positions, frequencies, 2, 2)
    np.testing.assert_allclose(G, network.frequency_response(omega), rtol=1e-10)
    information = kernel.information(network, omega, NOISE)
    np.testing.assert_allclose(information, _information(network, omega), rtol=1e-8, atol=1e-12)
    theta = 1.1 * network.parameters.values[None]
    cost = kernel.costs(network, omega, G, np.ones(G.shape), theta)
    expected = np.sum(np.abs(G - network.frequency_response(omega, theta[0])) ** 2)
    np.testing.assert_allclose(cost, [expected], rtol=1e-9)


def _part(network, positions):
    fields = ("mass", "damping", "stiffness", "spring_stiffness", "spring_damping", "exponents")
    return replace(network, **{f: getattr(network, f)[positions] for f in fields})


def test_threads_change_nothing():
    network = robot(np.random.default_rng(4), n_positions=90)
    before = numba.get_num_threads()
    results = []
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        results.append(kernel.information(network, OMEGA, NOISE))
    numba.set_num_threads(before)
    np.testing.assert_array_equal(*results)


def _job(network):
    return kernel.information(network, OMEGA, NOISE)


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_forked_processes_can_use_the_kernel():
    network = robot(np.random.default_rng(4), n_positions=90)
    with ProcessPoolExecutor(1) as pool:
        np.testing.assert_array_equal(pool.submit(_job, network).result(600), _job(network))


def test_it_tells_whether_code_is_compiled(monkeypatch):
    network = robot(np.random.default_rng(4), n_positions=2)
    kernel.information(network, OMEGA, NOISE)
    kernel.CostKernel(
        network, OMEGA, network.frequency_response(OMEGA), np.ones((2, len(OMEGA), 6, 6))
    ).normal_equations(network.parameters.values)
    assert kernel.is_compiled()
    monkeypatch.setattr(compiling, "_SOURCES", "of an edited kernel")
    assert not kernel.is_compiled()


@pytest.mark.slow  # test_simd.py does so for its operations
def test_a_plain_processor_without_a_cache_computes_the_same(tmp_path):
    network = robot(np.random.default_rng(6), n_positions=1)
    (tmp_path / "network").write_bytes(pickle.dumps((network, OMEGA, NOISE)))
    program = (
        "import pickle, numpy; from robotmodels import kernel;"
        f"arguments = pickle.load(open({str(tmp_path / 'network')!r}, 'rb'));"
        f"numpy.save({str(tmp_path / 'out.npy')!r}, kernel.information(*arguments))"
    )
    environment = os.environ | {
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
    }
    subprocess.run([sys.executable, "-c", program], check=True, env=environment)
    found = np.load(tmp_path / "out.npy")
    assert error(found, kernel.information(network, OMEGA, NOISE)) < 1e-12


def test_wrong_arguments_are_named():
    network = robot(np.random.default_rng(0), n_positions=1)
    G = network.frequency_response(OMEGA)
    with pytest.raises(InvalidInput, match="omega: 0; a list of positive frequencies"):
        kernel.frequency_response(network, np.array([1.0, 0.0]))
    with pytest.raises(InvalidInput, match=r"omega: shape \(1, 2\)"):
        kernel.information(network, np.array([[1.0, 2.0]]), NOISE)
    with pytest.raises(InvalidInput, match=r"measured: shape \(1, 21, 6\)"):
        kernel.CostKernel(network, OMEGA, G[..., 0], np.ones(G.shape))
    with pytest.raises(InvalidInput, match="weights: a weight is negative"):
        kernel.CostKernel(network, OMEGA, G, -np.ones(G.shape))
    with pytest.raises(InvalidInput, match=r"'lss' is unknown \(did you mean"):
        kernel.CostKernel(network, OMEGA, G, np.ones(G.shape), "lss")
    cost = kernel.CostKernel(network, OMEGA, G, np.ones(G.shape))
    with pytest.raises(InvalidInput, match="parameter k1: -1 is not a positive number"):
        cost(np.where(np.arange(26) == 1, -1.0, 1.0)[None])
    with pytest.raises(InvalidInput, match=r"\(26,\) is needed"):
        cost(np.ones((2, 25)))


CACHE_KEYS = """
import importlib, json, pkgutil
from numba.core.caching import FunctionCache
import robotmodels.kernel as kernel
keys = {}
for found in pkgutil.iter_modules(kernel.__path__, "robotmodels.kernel."):
    for name, one in vars(importlib.import_module(found.name)).items():
        if isinstance(getattr(one, "_cache", None), FunctionCache):
            keys[name] = str(one._cache._index_key((), one.targetctx.codegen()))
print(json.dumps(keys))
"""


def test_a_change_in_any_source_file_compiles_anew(tmp_path):
    # By itself numba looks for changes in a function's own file only.
    copy = shutil.copytree(
        Path(kernel.__file__).parents[1], tmp_path / "robotmodels", ignore=lambda *_: ["library"]
    )

    def keys():
        done = subprocess.run(
            [sys.executable, "-c", CACHE_KEYS],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        return json.loads(done.stdout)

    before = keys()
    assert {"responses", "cell_costs", "cell_normals", "slopes"} <= set(before)
    assert keys() == before
    with (copy / "kernel" / "bits.py").open("a") as file:
        file.write("# changed\n")
    assert not set(keys().values()) & set(before.values())


@pytest.mark.parametrize(
    ("name", "known"), [("motor speeds", True), ("motor angles", True), ("other outputs", False)]
)
def test_which_outputs_the_kernel_knows(name, known):
    network = NETWORKS[name](np.random.default_rng(7))
    assert (layout(network) is not None) == known
    if not known:
        with pytest.raises(InvalidInput, match="something else than the motors is measured"):
            network.motor_factors(OMEGA)
