"""A plant of somebody else: a bench that answers by its FRF, without any error."""

import numpy as np
import pytest

import oed
import robotmodels
from estimators import estimate_frf
from robotmodels import InvalidInput
from robotmodels.simulation.controller import default_controller
from robotmodels.simulation.imperfections import Imperfections

ROBOT = robotmodels.load_robot("moberg_axis1")


class LinearBench:
    def __init__(self, name="bench", broken=-1):
        self.settings, self.broken, self.visits = (name, 1), broken, []

    def measure(self, plan, visit, progress=None):
        if visit == self.broken:
            raise InvalidInput("bench: the drive is off")
        self.visits.append(visit)
        sine, position = plan.multisine, plan.visited[visit][None]
        torque = plan.reference(visit)[:, :, None]
        samples = torque.shape[3]
        w = 2 * np.pi * np.fft.rfftfreq(samples, sine.sample_time)[1:]
        G = robotmodels.frequency_response(ROBOT, position, w)[0]
        angle = np.fft.rfft(torque, axis=3)
        angle[:, :, :, 0] = 0
        angle[:, :, :, 1:] = np.einsum("fij,bepfj->bepfi", G, angle[:, :, :, 1:])
        angle[:, :, :, 1:] /= -(w[:, None] ** 2)
        return robotmodels.Records(
            positions=position,
            sample_time=sine.sample_time,
            reference=torque[None],
            torque=torque[None],
            angle=np.fft.irfft(angle, samples, axis=3)[None],
            lines=sine.lines,
            detection=sine.detection,
            saturated=np.zeros((1, *torque.shape[:3], torque.shape[4]), dtype=bool),
        )


def plan():
    return oed.experiment_plan(
        ROBOT,
        np.array([[0.1], [-0.2]]),
        oed.band_multisine(250, sample_time=0.002, band=(2.0, 40.0), inputs=1),
        blocks=2,
        periods=1,
        speed=1.0,
        acceleration=2.0,
        rng=np.random.default_rng(0),
        repetitions=[2, 1],
    )


def test_records_of_a_bench_give_its_frf(tmp_path):
    seen = []
    path = oed.run_plan(
        plan(), LinearBench(), tmp_path, lambda done, total: seen.append((done, total))
    )
    records = robotmodels.Records.load(path)
    assert len(records) == 3
    assert sorted(p.name for p in tmp_path.iterdir()) == ["plan.h5", "plan.yaml", "records.h5"]
    estimate = estimate_frf(records, hold=False)  # a bench of continuous signals
    truth = robotmodels.frequency_response(ROBOT, estimate.positions, estimate.omega)
    np.testing.assert_allclose(estimate.response, truth, rtol=1e-6)


def test_an_interrupted_run_goes_on_with_the_next_visit(tmp_path):
    with pytest.raises(InvalidInput, match="the drive is off"):
        oed.run_plan(plan(), LinearBench(broken=1), tmp_path)
    with pytest.raises(InvalidInput, match="a visit of another experiment"):
        oed.run_plan(plan(), LinearBench("another bench"), tmp_path)
    bench = LinearBench()
    oed.run_plan(plan(), bench, tmp_path)
    assert bench.visits == [1, 2]


def test_a_simulated_visit_does_not_depend_on_those_before():
    one = plan()
    controller, flaws = default_controller(ROBOT, 0.002), Imperfections(angle_noise=1e-6)
    plant = oed.SimulatedPlant(ROBOT, controller, flaws, np.random.default_rng(5))
    last = plant.measure(one, 2)
    first = plant.measure(one, 0)
    assert np.array_equal(plant.measure(one, 2).angle, last.angle)
    assert not np.array_equal(first.angle, last.angle)
