"""What a log's numbers say of its channels, against signals made with given factors and lags."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import robotmodels
from estimators.logs.completion import complete_mapping
from estimators.logs.mapping_checks import mapping_findings
from estimators.logs.proposal import propose_mapping
from estimators.logs.shift_regression import angle_relation, velocity_relation
from estimators.logs.torque_balance import torque_findings
from estimators.logs.torque_sign import torque_sign
from estimators.logs.unit_hypotheses import (
    ANGLES,
    RATES,
    angle_hypotheses,
    rate_hypotheses,
    torque_side,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.inverse_dynamics import movement_torques
from robotmodels.logs.importer import Import
from robotmodels.logs.mapping_file import Mapping, TimeChoice
from robotmodels.logs.open_log import open_log
from robotmodels.logs.units import unit_factor

STEP = 0.004
TIME = STEP * np.arange(200)
OMEGA = np.array([0.9, 2.3, 5.1, 11.0])


class Movement:
    """A sum of sines that repeats nowhere, its derivatives in closed form."""

    def __init__(self, seed, n=1, count=2500):
        rng = np.random.default_rng(seed)
        self.size = rng.uniform(0.05, 0.3, (n, len(OMEGA)))
        self.phase = rng.uniform(0, 2 * np.pi, (n, len(OMEGA)))
        self.time = STEP * np.arange(count)
        self.rng = rng

    def angle(self, t):
        return (self.size * np.sin(np.multiply.outer(t, OMEGA)[:, None] + self.phase)).sum(axis=-1)

    def velocity(self, t):
        cosine = np.cos(np.multiply.outer(t, OMEGA)[:, None] + self.phase)
        return (self.size * OMEGA * cosine).sum(axis=-1)


def test_absent_channels_have_no_relation():
    absent = np.full_like(TIME, np.nan)
    assert angle_relation(TIME, np.sin(TIME), absent) is None
    assert velocity_relation(TIME, absent, np.cos(TIME)) is None


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("lag", [-0.002, 0.0, 0.0044, 0.19])
def test_factor_and_lag_of_a_velocity(seed, lag):
    """Also with an offset of the velocity, which drifts in its integral."""
    m = Movement(seed)
    velocity = -57.3 * m.velocity(m.time - lag)[:, 0] + 2.0
    relation = velocity_relation(m.time, m.angle(m.time)[:, 0], velocity)
    assert 1 / relation.factor == pytest.approx(-57.3, rel=1e-4)
    assert relation.lag == pytest.approx(lag, abs=2e-6)
    assert relation.determined


def test_real_stamps_count():
    """Samples are taken when their stamps say so: as an even grid they would be 0.5 ms wrong."""
    m = Movement(7)
    stamps = m.time + 0.0005 * m.rng.standard_normal(len(m.time))
    relation = velocity_relation(stamps, m.angle(stamps)[:, 0], m.velocity(stamps - 0.003)[:, 0])
    assert relation.lag == pytest.approx(0.003, abs=5e-6)


@pytest.mark.parametrize(
    ("memory", "runs"),
    [(0.98, 16), *(pytest.param(m, 40, marks=pytest.mark.slow) for m in (0.0, 0.98, 0.997))],
)
def test_standard_errors_of_lags_are_honest(memory, runs):
    """Twice the standard error covers at least four of five; a quarter of it must not.

    Noise is white, or remembers the past for 0.2 or 1.3 s.
    """
    pulls = []
    for seed in range(runs):
        m = Movement(seed)
        white = m.rng.standard_normal(3 * len(m.time))
        noise = lfilter([np.sqrt(1 - memory**2)], [1, -memory], white)[-len(m.time) :]
        late = m.velocity(m.time - 0.005)[:, 0]
        relation = velocity_relation(m.time, m.angle(m.time)[:, 0] + 2e-4 * noise, late)
        pulls.append(abs(relation.lag - 0.005) / relation.lag_std)
    assert np.mean(np.array(pulls) < 2) >= 0.8
    assert np.mean(np.array(pulls) < 0.25) < 0.6


def test_nothing_is_determined_at_rest_or_between_strangers():
    m, other = Movement(1), Movement(2)
    noise = 1e-5 * m.rng.standard_normal((2, len(m.time)))
    assert velocity_relation(m.time, np.zeros(len(m.time)), noise[0]) is None
    assert not velocity_relation(m.time, noise[0], noise[1]).determined
    strange = velocity_relation(m.time, m.angle(m.time)[:, 0], other.velocity(m.time)[:, 0])
    assert not strange.determined


def test_link_angles_are_late_and_of_a_slope():
    m = Movement(3)
    relation = angle_relation(m.time, 250 * m.angle(m.time)[:, 0], m.angle(m.time - 0.003)[:, 0])
    assert relation.factor == pytest.approx(250, rel=1e-5)
    assert relation.lag == pytest.approx(0.003, abs=1e-6)


@pytest.mark.parametrize(("angle", "rate"), list(itertools.product(["rad", "deg", "turn"], RATES)))
@pytest.mark.parametrize("ratio", [np.nan, 32.0, 101.0, 256.9])
def test_units_of_rates_are_told_by_the_nearest_factor(angle, rate, ratio):
    if rate.endswith("m/s"):
        assert not rate_hypotheses(1.0, angle, ratio) or rate not in [
            h.unit for _, h in rate_hypotheses(1.0, angle, ratio)
        ]
        return
    sides = {"same": 1.0} if np.isnan(ratio) else {"same": 1.0, "motor": ratio}
    for side, gear in sides.items():
        factor = 1.003 * ANGLES[angle] / RATES[rate] * gear
        best = rate_hypotheses(-factor, angle, ratio)[0][1]
        assert (best.unit, best.side) == (rate, side)
        assert not rate_hypotheses(1.3 * factor, angle, ratio)


def test_angles_must_lie_within_limits():
    limits = np.array([[-2.0, 2.0], [-3.0, 0.1]])
    ratios = np.array([100.0, -80.0])
    joint = np.array([[-1.0, 1.5], [-2.0, -0.5]])

    def best(spans):
        return angle_hypotheses(spans, ratios, limits, "", ("joint", "motor"))[0]

    assert (best(joint).unit, best(joint).side) == ("rad", "joint")
    degrees = best(np.degrees(joint))
    assert (degrees.unit, degrees.side) == ("deg", "joint")
    motor = best(np.sort(joint * ratios[:, None], axis=1))
    assert motor.side == "motor"
    assert not angle_hypotheses(1e9 * joint, ratios, limits, "", ("joint",))


def test_a_start_at_right_angles_tells_the_unit():
    """Motor angles over ratios of 32 and -45 are taken for degrees otherwise."""
    limits = np.array([[-3.0, 3.0], [-3.0, 3.0]])
    ratios = np.array([32.0, -45.0])
    start = np.array([np.pi / 2, -np.pi / 2]) * ratios
    spans = np.stack([start - 4, start + 4], axis=1)
    both = ("joint", "motor")
    assert angle_hypotheses(spans, ratios, limits, "", both)[0].unit == "deg"
    best = angle_hypotheses(spans, ratios, limits, "", both, start)[0]
    assert (best.unit, best.side) == ("rad", "motor")


def test_torques_take_the_side_that_carries_the_robot():
    ratios = np.array([256.9, 267.4])
    assert torque_side(np.array([4.0, 12.0]), ratios, 1000.0) == "motor"
    assert torque_side(np.array([900.0, 3000.0]), ratios, 1000.0) == "joint"


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("sign", [1, -1])
def test_the_sign_of_torques_is_that_of_work_against_friction(seed, sign):
    """Joint 2 alone would tell the opposite: it is driven by the other."""
    m = Movement(seed, n=2, count=8000)
    angle, velocity = m.angle(m.time), m.velocity(m.time)
    torque = 3 * np.tanh(20 * velocity) + 5 * np.gradient(velocity, m.time, axis=0)
    torque[:, 1] = -0.2 * np.tanh(20 * velocity[:, 1])
    assert torque_sign(m.time, angle, sign * torque)[0] == sign
    at_rest = torque_sign(m.time, 0 * angle, torque)
    assert at_rest == (1, "sign not determined: nothing moves")


def written(path, names, columns):
    header = ",".join(names)
    np.savetxt(
        path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.12g"
    )
    return path


@pytest.fixture(scope="module")
def robot():
    return robotmodels.load_robot("ur10")


@pytest.fixture
def log_file(tmp_path, robot):
    """Degrees, rpm of motors, one late velocity; torques in motor size and turned round."""
    m = Movement(11, n=6)
    ratios = np.array([motor.gear_ratio for motor in robot.file.motors])
    middle = robot.position_limits.mean(axis=1)
    angle, velocity = m.angle(m.time) + middle, m.velocity(m.time - 0.0021)
    names = [
        "time_ms",
        *(f"act_pos_{i}" for i in range(1, 7)),
        *(f"act_vel_{i}" for i in range(1, 7)),
    ]
    names += [f"torque_{i}" for i in range(1, 7)]
    torque = -0.5 * np.tanh(20 * m.velocity(m.time))
    rpm = velocity * ratios * 60 / (2 * np.pi)
    return written(tmp_path / "log.csv", names,
                   [1e3 * m.time, *np.degrees(angle).T, *rpm.T, *torque.T])  # fmt: skip


def test_a_whole_log_is_understood(log_file, robot):
    with open_log(log_file) as log:
        proposal = propose_mapping(log, robot)
        source = Import(log, proposal.mapping, robot)
        (movement,) = [run.read() for run in source.runs]
    signals = {signal.role: signal for signal in proposal.mapping.signals}
    assert proposal.mapping.time.unit == "ms"
    assert (signals["motor_angle"].unit, signals["motor_angle"].side) == ("deg", "joint")
    assert (signals["motor_velocity"].unit, signals["motor_velocity"].side) == ("rpm", "motor")
    assert signals["motor_torque"].sign == -1
    assert signals["motor_torque"].side == "motor"
    assert movement.sample_time == pytest.approx(STEP)
    m = Movement(11, n=6)
    assert movement.signal("motor_velocity") == pytest.approx(m.velocity(m.time - 0.0021), abs=1e-9)
    evidence = next(e.evidence for e in proposal.entries if e.family.role == "motor_velocity")
    assert "late by 2.10" in evidence


def test_what_a_mapping_leaves_open_is_completed_and_told(log_file, robot):
    mapping = Mapping.model_validate(
        {
            "schema": "import/1",
            "time": {"unit": "ms"},
            "signals": [
                {"column": "act_pos_*", "role": "motor_angle"},
                {"column": "torque_*", "role": "motor_torque", "unit": "N*m", "side": "motor"},
            ],
        }
    )
    with open_log(log_file) as log:
        complete, told = complete_mapping(log, mapping, robot)
        assert complete.signals[0].unit == "deg"
        assert complete.signals[0].side == "joint"
        assert complete.signals[1] == mapping.signals[1]
        assert len(told) == 1
        assert "unit deg, side joint" in told[0]
        assert complete_mapping(log, complete, robot) == (complete, ())


def test_a_start_pose_and_other_inertias_are_noticed(tmp_path):
    robot = robotmodels.load_robot("kr300")
    m = Movement(5, n=6)
    angle = m.angle(m.time) - m.angle(m.time)[:1]
    inertias = [motor.inertia for motor in robot.file.motors]
    inertias[3] *= 2
    np.savez(tmp_path / "log.npz", **{"rec.t": m.time, "rec.q": np.degrees(angle), "J_m": inertias,
                                      "more": np.arange(9)})  # fmt: skip
    with open_log(tmp_path / "log.npz") as log:
        findings = "\n".join(propose_mapping(log, robot).findings)
    assert "m2: angles from" in findings
    assert "start_pose" in findings
    assert "J_m: inertia of m4 is 0.00346 in the log, 0.00173 in the robot file" in findings
    assert findings.count("J_m") == 1


def test_a_log_without_angles_or_time(tmp_path, robot):
    path = written(tmp_path / "a.csv", ["t", "foo"], [np.arange(20.0), np.arange(20.0)])
    with open_log(path) as log, pytest.raises(InvalidInput, match="no channels look like angles"):
        propose_mapping(log, robot)
    path = written(tmp_path / "b.csv", ["q1", "q2"], np.random.default_rng(1).random((2, 30)))
    with open_log(path) as log:
        with pytest.raises(InvalidInput, match="no channel has time stamps"):
            propose_mapping(log)
        proposal = propose_mapping(log, None, TimeChoice(sample_time=0.01))
        assert proposal.mapping.time.sample_time == 0.01


def test_mapped_signals_are_checked_against_each_other(log_file, robot):
    """A velocity on the wrong side, late; a sign; a copy."""
    signals = [
        {"column": "act_pos_*", "role": "motor_angle", "unit": "deg", "side": "joint"},
        {"column": "act_vel_*", "role": "motor_velocity", "unit": "rpm", "side": "joint"},
        {"column": "torque_*", "role": "motor_torque", "unit": "N*m", "side": "motor"},
        {"column": "act_pos_1", "role": "other", "name": "copy"},
    ]
    document = {"schema": "import/1", "time": {"unit": "ms"}, "signals": signals}
    with open_log(log_file) as log:
        findings = mapping_findings(Import(log, Mapping.model_validate(document), robot))
    text = "\n".join(findings)
    assert "motor_velocity of m1 is 101 times what motor_angle says" in text
    assert "motor_velocity of m1 is late against motor_angle by 2.10" in text
    assert "motor_torque: its sign seems wrong" in text
    signals[1]["side"], signals[2]["sign"] = "motor", -1
    with open_log(log_file) as log:
        findings = mapping_findings(Import(log, Mapping.model_validate(document), robot))
    assert all("is late against" in line for line in findings)


def test_copies_are_told(tmp_path):
    m = Movement(3, n=2)
    angle = m.angle(m.time)
    columns = [m.time, *angle.T, angle[:, 0], m.velocity(m.time)[:, 1]]
    path = written(tmp_path / "a.csv", ["t", "q1", "q2", "r1", "r2"], columns)
    signals = [
        {"column": f"{name}*", "role": role, "unit": "rad", "side": "joint"}
        for name, role in (("q", "motor_angle"), ("r", "reference_angle"))
    ]
    mapping = Mapping.model_validate({"schema": "import/1", "signals": signals})
    with open_log(path) as log:
        (line,) = mapping_findings(Import(log, mapping, None))
    assert line.startswith("r1 (reference_angle) repeats q1 (motor_angle) number by number")


def test_a_log_of_drives_with_differing_signed_ratios(tmp_path: Path) -> None:
    """Two rows of names and units, decimal commas, turns a minute of motors, a spare channel."""
    robot = robotmodels.load_robot("manutec_r3")
    ratios = np.array([motor.gear_ratio for motor in robot.file.motors])
    time = 0.004 * np.arange(1500)
    angle = np.stack([0.3 * np.sin((2 + 0.3 * i) * time + i) for i in range(6)], axis=1)
    rpm = np.gradient(angle, 0.004, axis=0) * ratios * 60 / (2 * np.pi)
    names = ["Zeit", *(f"Achse{i}_Ist_Pos" for i in range(1, 7))]
    names += [*(f"Achse{i}_Ist_Drehzahl" for i in range(1, 7)), "Lüfter"]
    units = ["ms", *["deg"] * 6, *["1/min"] * 6, "%"]
    rows = np.column_stack([1e3 * time, np.degrees(angle), rpm, np.full(len(time), 40.0)])
    text = [";".join(names), ";".join(units)]
    text += [";".join(f"{x:.6f}".replace(".", ",") for x in row) for row in rows]
    path = tmp_path / "trace.csv"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    with open_log([path]) as log:
        proposal = propose_mapping(log, robot)
    (velocity,) = (s for s in proposal.mapping.signals if s.role == "motor_velocity")
    assert (velocity.unit, velocity.side, velocity.sign) == ("rpm", "motor", 1)
    assert proposal.unmapped == ("Lüfter",)
    assert unit_factor("1/min", "motor_velocity", False) == pytest.approx(2 * np.pi / 60)


def proposal_of(path, robot):
    with open_log(path) as log:
        proposal = propose_mapping(log, robot)
    return proposal, {signal.role: signal for signal in proposal.mapping.signals}


def test_commands_are_references_and_measurements_are_not_computed(tmp_path, robot):
    """As data sets of learning have them: action beside observation, each with joint angles."""
    m = Movement(2, n=6)
    angle, middle = m.angle(m.time), robot.position_limits.mean(axis=1)
    np.savez(
        tmp_path / "a.npz",
        **{
            "timestamp": m.time,
            "action.joint_position": angle + middle + 0.01,
            "observation.joint_positions": angle + middle,
            "observation.torques_computed": angle,
            "observation.torques_measured": angle,
        },
    )
    _, signals = proposal_of(tmp_path / "a.npz", robot)
    assert signals["motor_angle"].column == "observation.joint_positions[*]"
    assert signals["motor_torque"].column == "observation.torques_measured[*]"
    assert signals["reference_angle"].column == "action.joint_position[*]"


def test_a_state_without_a_quantity_and_with_a_gripper(tmp_path, robot):
    m = Movement(2, n=7)
    np.savez(tmp_path / "a.npz", **{"timestamp": m.time, "observation.state": m.angle(m.time)})
    proposal, signals = proposal_of(tmp_path / "a.npz", robot)
    assert signals["motor_angle"].column == tuple(f"observation.state[{i}]" for i in range(6))
    assert proposal.entries[0].evidence.startswith("taken for angles, as no name tells any")
    assert "7 channels for 6 joints; the last one, as of a gripper, is left out" in "".join(
        proposal.findings
    )


def test_counts_and_shares_are_told(tmp_path, robot):
    m = Movement(2, n=6)
    angle = m.angle(m.time)
    for turns, name in ((4096, "a"), (2**20, "b")):
        counts = np.rint(angle / (2 * np.pi) * turns * (1 if name == "a" else 100))
        names = ["t", *(f"q{i}" for i in range(6)), *(f"torque{i} [%]" for i in range(6))]
        written(tmp_path / f"{name}.csv", names, [m.time, *counts.T, *angle.T])
    proposal, signals = proposal_of(tmp_path / "a.csv", robot)
    assert "whole numbers, perhaps counts of encoders" in proposal.entries[0].evidence
    assert signals["motor_torque"].unit == "%"
    assert "state full_scale" in proposal.entries[1].evidence
    with pytest.raises(InvalidInput, match="whole numbers, perhaps counts"):
        proposal_of(tmp_path / "b.csv", robot)


def test_counts_that_the_file_states(tmp_path, robot):
    """What a mapping leaves open is told by its entry, what it states is enough."""
    counts = np.rint(2**16 * Movement(2, n=6).angle(TIME)).T
    names = ["t", *(f"Wert{i} [Inc]" for i in range(6))]
    path = written(tmp_path / "a.csv", names, [TIME, *counts])
    with pytest.raises(InvalidInput, match="in counts of encoders; state counts_per_turn and side"):
        proposal_of(path, robot)
    signal = {"column": "Wert*", "role": "motor_angle", "side": "joint", "counts_per_turn": 2**16}
    mapping = Mapping.model_validate({"schema": "import/1", "signals": [signal]})
    with open_log(path) as log:
        complete, _ = complete_mapping(log, mapping, robot)
        (movement,) = [run.read() for run in Import(log, complete, robot).runs]
        assert np.array_equal(np.rint(2**16 * movement.motor_angle / (2 * np.pi)), counts.T)
        bare = signal.copy()
        del bare["counts_per_turn"], bare["side"]
        mapping = Mapping.model_validate({"schema": "import/1", "signals": [bare]})
        complete, _ = complete_mapping(log, mapping, robot)
        with pytest.raises(
            InvalidInput, match=r"entry 1 \('Wert\*'\): unit 'Inc' .* counts_per_turn is missing"
        ):
            Import(log, complete, robot).binding  # noqa: B018


@pytest.mark.parametrize(("unit", "size"), [("mNm", 1e3), ("Nm", 1.0), ("kNm", 1e-3)])
def test_sides_of_torques_by_size_in_their_own_unit(tmp_path, robot, unit, size):
    m = Movement(3, n=6)
    torque = size * np.tanh(9 * m.velocity(m.time)) * [330, 330, 150, 56, 56, 56] / 101
    names = ["t", *(f"q{i} [rad]" for i in range(6)), *(f"torque{i} [{unit}]" for i in range(6))]
    path = written(tmp_path / "a.csv", names, [m.time, *m.angle(m.time).T, *torque.T])
    _, signals = proposal_of(path, robot)
    assert (signals["motor_torque"].unit, signals["motor_torque"].side) == (unit, "motor")


def test_quantities_by_units_alone_and_the_straightest_clock(tmp_path, robot):
    """Feedback and command of axes tell no quantity; a receiver's clock jitters."""
    m = Movement(2, n=6)
    degrees, late = np.degrees(m.angle(m.time)), m.rng.uniform(0, 1e-3, len(m.time))
    names = ["time", "robot_stamp_ms"]
    names += [f"{kind}_A{i} [{unit}]" for kind, unit in (("Ist", "°"), ("Soll", "°"), ("x", "A"))
              for i in range(1, 7)]  # fmt: skip
    columns = [m.time + late, np.round(1e3 * m.time), *degrees.T, *degrees.T, *degrees.T]
    proposal, signals = proposal_of(written(tmp_path / "a.csv", names, columns), robot)
    assert {role: signal.column for role, signal in signals.items()} == {
        "motor_angle": "Ist_A*",
        "reference_angle": "Soll_A*",
        "motor_current": "x_A*",
    }
    assert "2500 samples every 4 ms, from stamps of 'robot_stamp_ms'" in proposal.findings[-1]


def test_wrapped_angles_have_no_jumps_in_a_proposal(tmp_path, robot):
    """Jumps would turn the sign of torques round, and hide what a velocity is."""
    m = Movement(4, n=6)
    angle, velocity = np.degrees(m.angle(m.time)), np.degrees(m.velocity(m.time))
    names = ["t", *(f"pos{i} [deg]" for i in range(6)), *(f"vel{i}" for i in range(6))]
    names += [f"torque{i}" for i in range(6)]
    columns = [m.time, *(angle % 360).T, *velocity.T, *np.tanh(velocity / 5).T]
    proposal, signals = proposal_of(written(tmp_path / "a.csv", names, columns), robot)
    assert (signals["motor_angle"].unit, signals["motor_angle"].side) == ("deg", "joint")
    assert signals["motor_torque"].sign == 1
    relations = next(e for e in proposal.entries if e.family.role == "motor_velocity").relations
    assert all(relation.determined for relation in relations)


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (1.0, ""),
        (-1.0, "weight and acceleration need: its sign seems wrong"),
        (0.01, "the robot file needs here: a unit, a side of the gear or a mass is wrong"),
    ],
)
def test_torques_against_weight_and_acceleration(robot, scale, message):
    """Torques by inverse dynamics and friction, one joint of another sign or side."""
    m = Movement(6, n=6, count=4000)
    angle = m.angle(m.time) + robot.position_limits.mean(axis=1)
    speed, acceleration = m.velocity(m.time), np.gradient(m.velocity(m.time), STEP, axis=0)
    behind = movement_torques(robot, angle, speed, acceleration)
    rotors = [motor.inertia * motor.gear_ratio**2 for motor in robot.file.motors]
    torque = behind.links + robot.file.payload.mass * behind.payload + acceleration * rotors
    friction = np.sign(speed) + 0.1 * m.rng.standard_normal(speed.shape)
    torque += 0.1 * np.ptp(torque, axis=0) * friction
    torque[:, 1] *= scale
    lines = list(torque_findings(robot, STEP, angle, torque))
    assert len(lines) == bool(message)
    for line in lines:
        factor, told = re.match(
            r"motor_torque of m2 is (\S+) \+- \S+ times what (.*)", line
        ).groups()
        assert float(factor) == pytest.approx(scale, rel=0.05)
        assert told == message
