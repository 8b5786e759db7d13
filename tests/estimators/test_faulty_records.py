"""Files of records, FRFs, distortion levels and fits that are damaged, wrong or hostile."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from file_mutations import check_readers
from mass_springs import MassSprings

from estimators import (
    Distortion,
    Fit,
    FrfEstimate,
    Prior,
    read_distortion,
    read_fits,
    read_frf,
    read_records,
    simulate_frf,
    write_distortion,
    write_fits,
    write_frf,
    write_records,
)
from estimators.frf.frf_estimate import vec
from robotmodels import Records, RelativeNoise

MODEL = MassSprings()
RNG = np.random.default_rng(4)


def records() -> Records:
    shape = (2, 2, 2, 2, 12, 2)
    return Records(
        positions=RNG.normal(size=(2, 2)),
        sample_time=0.01,
        reference=RNG.normal(size=(2, 2, 2, 1, 12, 2)),
        torque=RNG.normal(size=shape),
        angle=RNG.normal(size=shape),
        lines=np.array([1, 5]),
        detection=np.array([3]),
        saturated=RNG.random((2, 2, 2, 2, 2)) < 0.5,
    )


def frf(full: bool = True) -> FrfEstimate:
    positions, omega = np.array([[0.1], [0.7]]), np.array([5.0, 9.0, 14.0])
    estimate = simulate_frf(MODEL, positions, omega, RelativeNoise(0.1, 0.1), RNG, (1, 3))
    matrices = vec(estimate.variance)[..., None] * np.eye(4) + 0j
    return replace(estimate, covariance=matrices) if full else estimate


def levels() -> Distortion:
    def some(*shape: int) -> np.ndarray:
        return RNG.random(shape)

    lines = {"odd": some(2, 4, 2), "even": some(2, 5, 2)}
    noise = {f"{k}_noise": v for k, v in lines.items()} | {f"{k}_raw": v for k, v in lines.items()}
    frequencies = {"odd_omega": some(4), "even_omega": some(5), "omega": some(3)}
    blocks = np.array([1, 4])
    excited = {"noise": some(2, 3, 2, 2), "total": some(2, 3, 2, 2), "output": some(2, 3, 2)}
    return Distortion(
        positions=some(2, 2), blocks=blocks, **excited, **lines, **noise, **frequencies
    )


ESTIMATE = frf()


def fits() -> list[Fit]:
    parameters, shape = MODEL.parameters, ESTIMATE.response.shape
    one = Fit(
        model=MODEL,
        estimate=ESTIMATE,
        residual="lls",
        weights=np.ones(shape),
        parameters=parameters,
        cost=2.0,
        start=parameters.values,
        bounds=np.array([parameters.values / 2, parameters.values * 2]),
        status=1,
        message="converged",
        evaluations=7,
        prior=Prior(("k1",), np.array([800.0]), np.array([0.1])),
    )
    return [one, replace(one, prior=None, weights=np.ones((2, 3, 4, 4)) + 0j)]


KINDS = {
    **{f"records{e}": (read_records, write_records, records) for e in (".h5", ".mat", ".csv")},
    **{f"frf{e}": (read_frf, write_frf, frf) for e in (".h5", ".mat", ".csv", ".uff")},
    "variances.csv": (read_frf, write_frf, partial(frf, full=False)),
    **{f"levels{e}": (read_distortion, write_distortion, levels) for e in (".h5", ".mat")},
    "fits.h5": (lambda path: read_fits(path, MODEL, ESTIMATE), write_fits, fits),
}


FEW, MANY = range(30), pytest.param(range(30, 3000), marks=pytest.mark.slow)


@pytest.mark.parametrize("seeds", [FEW, MANY])
@pytest.mark.parametrize("name", KINDS)
def test_readers_refuse_in_a_line_or_take(tmp_path, name, seeds):
    check_readers(tmp_path / name, KINDS, seeds, 0.3)
