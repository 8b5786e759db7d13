from types import SimpleNamespace

import numpy as np
import pytest

from oed import read_positions
from robotmodels import InvalidInput

ARM = SimpleNamespace(motor_names=("m1", "m2"), motor_joints=("base", "elbow"))
POSITIONS = [[0.0, 1.0], [2.0, -3.0]]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "0, 1\n2,-3\n"),
        ("a.csv", "# positions\nelbow, m1\n1,0\n-3,2\n"),
        ("a.csv", "# elbow,base\n1,0\n-3,2\n"),
        ("a.yaml", "- [0, 1]\n- [2, -3]\n"),
        ("a.yml", "positions: [[0, 1], [2, -3]]\n"),
    ],
)
def test_text_files(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    np.testing.assert_array_equal(read_positions(tmp_path / name, ARM), POSITIONS)


def test_numpy_files(tmp_path):
    np.save(tmp_path / "a.npy", POSITIONS)
    np.testing.assert_array_equal(read_positions(tmp_path / "a.npy", ARM), POSITIONS)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.txt", "0 1", r"a\.txt: positions are read from .csv, .yaml"),
        ("a.csv", "", r"a\.csv: positions of shape \(0,\); \(Q, 2\)"),
        ("a.csv", "0,1\n2\n", r"line 2: '2'; 2 numbers are needed"),
        ("a.csv", "0,1\n2,x\n", r"line 2: '2, x'; 2 numbers"),
        ("a.csv", "base,elbo\n0,1\n", r"column 'elbo' is neither .*did you mean 'elbow'"),
        ("a.csv", "base,m1\n0,1\n", r"motor 'm1' \(joint 'base'\) has 2 columns"),
        ("a.csv", "0,nan\n", "position 1 is not finite"),
        (
            "a.yaml",
            "- [0.1, on]\n",
            r"a.yaml:1: positions\[0\]\[1\]: .* found 'on'",
        ),
        ("a.yaml", "- [0.1, 1:40]\n", "found '1:40'"),
        ("a.yaml", "\n- [0.1, true]\n", "a.yaml:2: .*found true"),
        ("a.csv", "0.1,1_0\n", "line 1: .* 2 numbers are needed"),
        ("a.csv", "0.1,\u0663\n", "line 1: .* 2 numbers are needed"),
        ("a.csv", "0.1,\x00\n", "a.csv"),
        ("a.yaml", "candidates: []\n", "missing key 'positions'"),
        ("a.yaml", "[[0, 1\n", "not valid YAML"),
        ("a.yaml", "[[0, 1], [2]]\n", "an array of real numbers"),
        ("a.npy", "no array", "not a NumPy array file"),
    ],
)
def test_files_that_cannot_be_used(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InvalidInput, match=message):
        read_positions(tmp_path / name, ARM)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InvalidInput, match=r"none\.csv: no such file"):
        read_positions(tmp_path / "none.csv", ARM)
