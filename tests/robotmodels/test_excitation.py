"""Periodic runs of a log become records: period, transients, positions, blocks, lines."""

import numpy as np
import pytest

import robotmodels
from estimators import estimate_frf, torque_loop
from robotmodels.common.errors import InvalidInput
from robotmodels.logs.excitation import find_excitation
from robotmodels.logs.mapping_file import Mapping
from robotmodels.records.movement import Movement

STEP, SAMPLES, PERIODS, TRANSIENT = 0.002, 400, 4, 2
LINES = np.arange(3, 60, 4)
RATIOS = np.array([50.0, -80.0])
INERTIAS = np.array([2e-3, 5e-4])  # on the motor shafts
POSITIONS = np.array([[0.3, -0.8], [-0.5, 0.4]])


def multisine(rng, amplitude):
    """Return a period of torque, and the angle of an inertia that it drives."""
    phase = rng.uniform(0, 2 * np.pi, len(LINES))
    omega = 2 * np.pi * LINES / (SAMPLES * STEP)
    wave = np.exp(1j * (np.outer(np.arange(SAMPLES) * STEP, omega) + phase))
    return amplitude * wave.real.sum(axis=1), -amplitude * (wave / omega**2).real.sum(axis=1)


def experiment(rng, noise=0.0, blocks=2):
    """Return angles on the joints, and motor torques, of all runs one behind the other."""
    angles, torques = [], []
    for position in POSITIONS:
        for _ in range(blocks):
            amplitudes = 0.02 * rng.uniform(0.5, 1, 2)
            for run in range(2):
                repeats = TRANSIENT + PERIODS
                torque, angle = np.empty((2, 2, repeats * SAMPLES))
                for j in range(2):
                    u, q = multisine(rng, amplitudes[j] * (1 if run == j else 0.3))
                    torque[j] = np.tile(u, repeats)
                    angle[j] = np.tile(q, repeats) / INERTIAS[j] / RATIOS[j]
                decay = np.exp(-np.arange(repeats * SAMPLES) / (0.15 * SAMPLES))
                angle += 5e-4 * decay
                angles.append(position[:, None] + angle)
                torques.append(torque)
        rest = np.repeat(angles[-1][:, -1:], 300, axis=1)
        angles.append(rest)
        torques.append(0 * rest)
    angle, torque = np.concatenate(angles, axis=1).T, np.concatenate(torques, axis=1).T
    return angle + noise * rng.standard_normal(angle.shape), torque


def log_file(path, angle, torque, command=None):
    time = STEP * np.arange(len(angle))
    table = np.column_stack([time, angle, torque, *([] if command is None else [command])])
    names = "t,q1,q2,tau1,tau2" + ("" if command is None else ",cmd1,cmd2")
    np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%.15g")
    return path


def mapping(**more):
    return Mapping.model_validate(
        {
            "schema": "import/1",
            "ratios": RATIOS.tolist(),
            "signals": [
                {"column": "q*", "role": "motor_angle", "unit": "rad", "side": "joint"},
                {"column": "tau*", "role": "motor_torque", "unit": "N*m", "side": "motor"},
            ],
            **more,
        }
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("noise", [0.0, 2e-6])
def test_runs_of_a_log_become_records(tmp_path, seed, noise):
    angle, torque = experiment(np.random.default_rng(seed), noise)
    path = log_file(tmp_path / "log.csv", angle, torque)
    records = robotmodels.import_records(path, mapping())
    assert records.torque.shape[:3] == (2, 2, 2)
    assert records.samples == SAMPLES
    assert records.torque.shape[3] >= PERIODS
    assert records.positions == pytest.approx(POSITIONS, abs=2e-3)
    assert np.array_equal(records.lines, LINES)
    estimate = estimate_frf(records, hold=False)
    clear = slice(0, 3 if noise else None)  # of angles, noise counts with the squared frequency
    response = estimate.response[:, clear, [0, 1], [0, 1]]
    assert response == pytest.approx(np.broadcast_to(1 / INERTIAS, response.shape), rel=0.02)
    assert np.abs(estimate.response[:, clear, 0, 1]).max() < 0.03 / INERTIAS.min()


def test_commands_beside_measured_torques_show_their_loop(tmp_path):
    """Measured torques are 3 and 5 % too large and a sample late."""
    angle, torque = experiment(np.random.default_rng(7))
    command = np.roll(torque, -1, axis=0) / [1.03, 1.05]
    path = log_file(tmp_path / "log.csv", angle, torque, command)
    signals = mapping().model_dump(mode="json", exclude_unset=True)["signals"]
    signals.append({"column": "cmd*", "role": "reference_torque", "unit": "N*m", "side": "motor"})
    records = robotmodels.import_records(path, mapping(signals=signals))
    assert not records.commanded
    loop = torque_loop(records)
    held = np.sinc(loop.omega * STEP / (2 * np.pi))
    late = np.exp(-0.5j * loop.omega * STEP)[:, None]
    expected = [1.03, 1.05] / held[:, None] * late
    np.testing.assert_allclose(loop.response, expected, rtol=1e-6)
    np.testing.assert_allclose(
        estimate_frf(records).response[0, :, 0, 0] * INERTIAS[0], 1, rtol=0.02
    )


def test_a_stated_period_and_transient(tmp_path):
    angle, torque = experiment(np.random.default_rng(4))
    path = log_file(tmp_path / "log.csv", angle, torque)
    double = robotmodels.import_records(path, mapping(period=2 * SAMPLES * STEP))
    assert double.samples == 2 * SAMPLES
    assert np.array_equal(double.lines, 2 * LINES)
    counts = [
        robotmodels.import_records(path, mapping(transient=t)).torque.shape[3] for t in (1, 2)
    ]
    assert counts[0] == counts[1] + 1
    with pytest.raises(InvalidInput, match="a whole number of 16 or more is needed"):
        robotmodels.import_records(path, mapping(period=0.7111))
    with pytest.raises(InvalidInput, match="period: 0 says that it is not periodic"):
        robotmodels.import_records(path, mapping(period=0.0))


def test_a_record_that_does_not_repeat_is_kept_as_a_movement(tmp_path):
    """One joint repeats, the other does not: the message tells by how much."""
    rng = np.random.default_rng(2)
    time = STEP * np.arange(6000)
    steady = 0.1 * np.sin(2 * np.pi * time / 0.8)
    other = np.cumsum(np.cumsum(rng.standard_normal(6000))) * 1e-5
    angle = np.stack([steady, other], axis=1)
    path = log_file(tmp_path / "log.csv", angle, np.zeros_like(angle))
    with pytest.raises(InvalidInput, match=r"not periodic: after .* joint_2 by") as error:
        robotmodels.import_records(path, mapping())
    assert "kept as a movement" in str(error.value)
    assert len(robotmodels.import_movements(path, mapping())) == 1


def test_experiments_must_be_alike(tmp_path):
    angle, torque = experiment(np.random.default_rng(4))
    cut = len(angle) - 300 - (TRANSIENT + PERIODS) * SAMPLES
    path = log_file(tmp_path / "log.csv", angle[:cut], torque[:cut])
    with pytest.raises(InvalidInput, match="experiments differ: 1 blocks of 3 runs, 2 blocks of 2"):
        robotmodels.import_records(path, mapping())


def test_movements_too_large_for_one_position_are_told():
    time = STEP * np.arange(4000)
    angle = np.stack([0.3 * np.sin(2 * np.pi * time / 0.8)] * 2, axis=1)
    movement = Movement(("a", "b"), STEP, {"motor_angle": angle, "motor_torque": angle})
    excitation = find_excitation(movement)
    assert excitation.samples == SAMPLES
    assert "a moves by 0.6 rad, too far for one position" in "".join(excitation.notes)


@pytest.mark.parametrize("seed", range(4))
def test_runs_begin_where_their_reference_does(seed):
    """Motions that go over into each other smoothly show the ends of runs to some samples only."""
    rng, blocks, periods = np.random.default_rng(seed), 5, 3
    references, angles = zip(*(multisine(rng, 1.0) for _ in range(blocks)), strict=True)
    angle = np.concatenate([np.tile(one - one[0], periods) for one in angles])[:, None]
    reference = np.concatenate([np.tile(one, periods) for one in references])[:, None]
    signals = {"motor_angle": angle, "motor_torque": reference, "reference_velocity": reference}
    excitation = find_excitation(Movement(("a",), STEP, signals))
    assert len(excitation.starts) == blocks
    for start, count in zip(excitation.starts, excitation.periods, strict=True):
        run = reference[start : start + count * SAMPLES]
        assert np.array_equal(run[SAMPLES:], run[:-SAMPLES])
    signals.pop("reference_velocity")
    seen = find_excitation(Movement(("a",), STEP, signals)).starts
    assert not np.array_equal(seen, excitation.starts)
