import base64
import json
import zlib

import numpy as np
import pytest

from reports.figures.response_data import ResponseData, between

Q, F, M, N = 2, 9, 3, 2


def unpacked(packed, shape):
    """Undo the packing as ``packed.js`` does, one number at a time."""
    raw = zlib.decompress(base64.b64decode(packed["bytes"]))
    size, values = len(raw) // 4, []
    for k in range(size):
        word = sum(raw[plane * size + k] << 8 * plane for plane in range(4))
        values.append((word >> 1) ^ -(word & 1))
    whole = np.array(values).reshape(*shape)
    for _ in range(packed["order"]):
        whole = np.cumsum(whole, axis=-1)
    return np.moveaxis(whole * packed["step"], -1, 1)


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(3)
    omega = 2 * np.pi * np.geomspace(2, 80, F)

    def response(lines):
        return rng.standard_normal((Q, lines, M, N)) + 1j * rng.standard_normal((Q, lines, M, N))

    measured = response(F)
    std = 0.02 * np.abs(measured) + 0.01
    repetitions = np.array([1, 3])
    fine = between(omega)
    ends = np.abs(measured) - std, np.abs(measured) + std
    ends[1][0] = 0.9 * np.abs(measured[0])  # one position of two lies outside
    return ResponseData(
        omega, measured, std, repetitions, fine, response(len(fine)), std / 10, ends
    )


@pytest.fixture(scope="module")
def content(data):
    names = {"inputs": ("m1", "<m2>"), "outputs": "abc", "units": "uvw"}
    words = data.embedded(("frf-1", "frf-2"), **names)
    assert words.count("<") == 2  # the tags of the script
    return json.loads(words[words.index("{") : words.rindex("}") + 1])


def test_responses_come_back_far_within_their_noise(data, content):
    for name, response, lines in (("measured", data.measured, F), ("model", data.model, 3 * F - 2)):
        size, phase = (unpacked(part, (Q, M, N, lines)) for part in content[name])
        away = np.abs(np.exp(size + 1j * phase) / response - 1)
        assert away.max() < 0.1 * np.min(data.std / np.abs(data.measured))
        assert away.max() > 0


def test_standard_deviations_and_singular_values_come_back(data, content):
    std = np.exp(unpacked(content["std"], (Q, M, N, F)))
    np.testing.assert_allclose(std, data.std, rtol=0.0051)
    model_std = np.exp(unpacked(content["modelStd"], (Q, M, N, F)))
    np.testing.assert_allclose(model_std, data.model_std, rtol=0.0102)
    gram = np.swapaxes(data.measured, -1, -2).conj() @ data.measured
    expected = np.sqrt(np.linalg.eigvalsh(gram)[..., ::-1])
    singular = np.exp(unpacked(content["singular"], (Q, min(M, N), F)))
    np.testing.assert_allclose(singular, expected, rtol=0.0051)


def test_names_lines_and_repetitions_are_told(data, content):
    assert content["inputs"] == ["m1", "<m2>"]
    assert content["repetitions"] == [1, 3]
    np.testing.assert_allclose(content["frequency"], data.omega / (2 * np.pi), atol=1e-6)
    assert content["fine"][::3] == content["frequency"]


def test_lines_between_are_even_on_a_logarithmic_scale():
    np.testing.assert_allclose(between(np.array([1.0, 8.0, 27.0])), [1, 2, 4, 8, 12, 18, 27])


def test_ends_of_the_predictive_band_come_back(data, content):
    for packed, end in zip(content["predictive"], data.predictive, strict=True):
        values = np.exp(unpacked(packed, (Q, M, N, F)))
        shown = np.maximum(end, 1e-3 * data.predictive[1])
        assert values == pytest.approx(shown, rel=0.02)
    assert data.share_predicted == pytest.approx(0.5)
