"""Files of plans, information, designs and positions that are damaged, wrong or hostile."""

import json
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from file_mutations import check_readers
from random_candidates import random_set
from two_axes import plan

from oed import ExperimentPlan, InformationSet, read_positions
from oed.experiment.design_file import designed_positions
from oed.information_sets.stored_information import write_store
from robotmodels import InvalidInput

INFO = random_set(4, 30, 6, 4)
ARM = SimpleNamespace(motor_names=("m1", "m2"), motor_joints=("base", "elbow"))
DESIGN = {
    "schema": "design/1",
    "robot": "arm",
    "positions": [
        {"candidate": 4, "position": [0.1, 0.2], "weight": 0.4, "repetitions": 3},
        {"candidate": 7, "position": [-0.4, 1.0], "weight": 0.6, "repetitions": 1},
    ],
    "order": {"candidates": [7, 4], "duration": 3.0},
}


def read_store(path):
    return np.isfinite(InformationSet.open(path).total).all()


KINDS = {
    "plan.h5": (
        lambda path: ExperimentPlan.load(path.with_suffix(".yaml")),
        lambda path, contents: contents.save(path.with_suffix(".yaml")),
        plan,
    ),
    "info.h5": (InformationSet.load, lambda path, contents: contents.save(path), lambda: INFO),
    "info.oed": (
        read_store,
        lambda path, info: write_store(path, info.positions, info.names, [info.matrices]),
        lambda: INFO,
    ),
    "design.json": (
        partial(designed_positions, robot="arm"),
        lambda path, contents: path.write_text(json.dumps(contents)),
        lambda: DESIGN,
    ),
    "positions.csv": (
        partial(read_positions, robot=ARM),
        lambda path, contents: path.write_text(contents),
        lambda: "# positions\nelbow, m1\n1,0\n-3,2.5e-1\n",
    ),
    "positions.npy": (
        partial(read_positions, robot=ARM),
        lambda path, contents: np.save(path, contents),
        lambda: np.ones((4, 2)),
    ),
}
FEW, MANY = range(25), pytest.param(range(25, 3000), marks=pytest.mark.slow)


@pytest.mark.parametrize("seeds", [FEW, MANY])
@pytest.mark.parametrize("name", KINDS)
def test_readers_refuse_in_a_line_or_take(tmp_path, name, seeds):
    check_readers(tmp_path / name, KINDS, seeds, 0.1)


def test_arrays_of_a_plan_lie_beside_it(tmp_path):
    (tmp_path / "folder").mkdir()
    path = tmp_path / "folder" / "plan.yaml"
    plan().save(path)
    path.with_suffix(".h5").rename(tmp_path / "other.h5")
    for name in ("../other.h5", str(tmp_path / "other.h5"), ".."):
        text = path.read_text()
        path.write_text(text.replace("signals: plan.h5", f"signals: {name}"))
        with pytest.raises(InvalidInput, match=r"plan.yaml: signals: .* in the same folder"):
            ExperimentPlan.load(path)
        path.write_text(text)


@pytest.mark.parametrize(
    ("shape", "said"),
    [((6 * 10**9, 4), "not a NumPy array file"), ((2, 3), r"shape \(2, 3\)")],
)
def test_numpy_shapes_are_checked_before_they_are_read(tmp_path, shape, said):
    with (tmp_path / "a.npy").open("wb") as file:
        header = {"descr": "<f8", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(file, header)
        file.write(bytes(48))
    with pytest.raises(InvalidInput, match=said):
        read_positions(tmp_path / "a.npy", ARM)


@pytest.mark.parametrize("cell", ["0_1", "\u0663", "1\u00a0e", "0x1", "true"])
def test_numbers_that_only_python_takes(tmp_path, cell):
    (tmp_path / "a.csv").write_text(f"0,1\n2,{cell}\n", encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"line 2: .* 2 numbers are needed"):
        read_positions(tmp_path / "a.csv", ARM)
