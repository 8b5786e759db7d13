"""A log and a mapping become movements: units, sides, signs, clocks, delays."""

import numpy as np
import pytest

import robotmodels
from robotmodels.common.errors import InvalidInput
from robotmodels.logs import clock_line
from robotmodels.logs.clocks import fitted_clock
from robotmodels.logs.importer import Import, write_import
from robotmodels.logs.mapping_file import Mapping
from robotmodels.logs.open_log import open_log
from robotmodels.logs.resampling import interpolate
from robotmodels.logs.units import full_scale_share, unit_factor
from robotmodels.records.movement import iterate_movements, save_movements

RATIOS = [50.0, -100.0]
STEP = 0.004
N = 500
TIME = STEP * np.arange(N)
ANGLES = np.stack([0.3 * np.sin(9 * TIME), 1.0 + 0.2 * np.cos(7 * TIME)], axis=1)
TORQUES = np.stack([3 * np.cos(5 * TIME), 2 * np.sin(4 * TIME)], axis=1)
ANGLE = {"column": "q*", "role": "motor_angle", "unit": "rad", "side": "joint"}
LINK = {"column": "l*", "role": "link_angle", "unit": "rad"}


def write(path, names, columns):
    header = ",".join(names)
    np.savetxt(
        path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.17g"
    )
    return path


def imported(paths, robot=None, **mapping):
    with open_log(paths) as log:
        source = Import(log, Mapping.model_validate({"schema": "import/1", **mapping}), robot)
        notes = "\n".join(source.notes)
        return [run.read() for run in source.runs], notes


def test_units_sides_signs_and_ratios(tmp_path):
    """Degrees on the motor shaft and millinewton metres, one joint turned round."""
    motor = np.degrees(ANGLES * RATIOS) * [1, -1]
    path = write(tmp_path / "a.csv", ["t", "m1", "m2", "tau1", "tau2"],
                 [TIME, *motor.T, *(1e3 * TORQUES).T])  # fmt: skip
    (movement,), _ = imported(
        path,
        ratios=RATIOS,
        signals=[
            {
                "column": "m*",
                "role": "motor_angle",
                "unit": "deg",
                "side": "motor",
                "sign": [1, -1],
            },
            {"column": "tau*", "role": "motor_torque", "unit": "mN*m", "side": "motor"},
        ],
    )
    assert movement.motor_angle == pytest.approx(ANGLES, rel=1e-12)
    assert movement.motor_torque == pytest.approx(TORQUES * RATIOS, rel=1e-12)
    assert movement.sample_time == pytest.approx(STEP, rel=1e-9)
    assert movement.joints == ("joint_1", "joint_2")


def test_counts_percent_and_currents(tmp_path):
    counts = np.round(ANGLES / (2 * np.pi) * 2**20)
    path = write(tmp_path / "a.csv", ["t", "q1", "q2", "i1", "i2", "u1", "u2"],
                 [TIME, *counts.T, *TORQUES.T, *(10 * TORQUES).T])  # fmt: skip
    (movement,), _ = imported(
        path,
        ratios=RATIOS,
        torque_constants=[0.5, 0.25],
        signals=[
            {**ANGLE, "unit": "counts", "counts_per_turn": 2**20},
            {"column": "i*", "role": "motor_current", "unit": "A"},
            {
                "column": "u*",
                "role": "reference_torque",
                "unit": "%",
                "full_scale": 10.0,
                "side": "joint",
            },
        ],
    )
    assert movement.motor_angle == pytest.approx(ANGLES, abs=2 * np.pi / 2**20)
    assert movement.motor_torque == pytest.approx(TORQUES * [25.0, -25.0])
    assert movement.signal("reference_torque") == pytest.approx(TORQUES)


def test_a_coupled_wrist(tmp_path):
    """Motor 2 over its ratio is the angle of joint 2 and that of joint 1; torques transpose."""
    motors = ANGLES @ np.array([[1, 1], [0, 1]])
    path = write(tmp_path / "a.csv", ["t", "q1", "q2", "f1", "f2"], [TIME, *motors.T, *TORQUES.T])
    (movement,), _ = imported(
        path,
        couplings={"joint_2": {"joint_1": 1.0}},
        signals=[ANGLE, {"column": "f*", "role": "motor_torque", "unit": "Nm", "side": "joint"}],
    )
    assert movement.motor_angle == pytest.approx(ANGLES)
    power = (np.gradient(motors, axis=0) * TORQUES).sum(axis=1)
    joint_power = (np.gradient(ANGLES, axis=0) * movement.motor_torque).sum(axis=1)
    assert joint_power == pytest.approx(power)


def test_joints_by_name_in_any_order(tmp_path):
    robot = robotmodels.load_robot("panda")
    names = [f"{joint}_position" for joint in reversed(robot.motor_joints)]
    values = np.outer(np.sin(TIME), np.arange(7, 0, -1.0))
    path = write(tmp_path / "a.csv", ["t", *names], [TIME, *values.T])
    (movement,), _ = imported(path, robot, signals=[{**ANGLE, "column": "*position"}])
    assert movement.joints == robot.motor_names
    assert movement.motor_angle == pytest.approx(values[:, ::-1])


def test_wrapped_angles_are_unwrapped_and_said(tmp_path):
    angle = np.degrees(9 * TIME)
    path = write(tmp_path / "a.csv", ["t", "q1"], [TIME, (angle + 180) % 360 - 180])
    (movement,), notes = imported(path, signals=[{**ANGLE, "unit": "deg"}])
    assert movement.motor_angle[:, 0] == pytest.approx(9 * TIME)
    assert "q1 (motor_angle of joint_1): 3 jumps by whole turns are taken out" in notes
    (movement,), notes = imported(path, signals=[{**ANGLE, "unit": "deg", "wrapped": False}])
    assert np.ptp(movement.motor_angle) < 2 * np.pi
    assert "jumps" not in notes


@pytest.mark.parametrize("phase", np.linspace(0, 2 * np.pi, 7).tolist())
@pytest.mark.parametrize("offset", [-12.86, 2.05, 0.93])
def test_another_recording_is_no_jump_by_whole_turns(tmp_path, offset, phase):
    """Turns of motors recorded in two positions, one behind the other: they stay where they are."""
    turns = 0.2 * np.sin(3 * TIME + phase) + offset * (TIME > 1)
    path = write(tmp_path / "a.csv", ["t", "q1"], [TIME, turns])
    (movement,), notes = imported(path, signals=[{**ANGLE, "unit": "rev"}])
    assert movement.motor_angle[:, 0] == pytest.approx(2 * np.pi * turns)
    assert "1 steps of more than 0.75 turns are left" in notes
    signals = [{**ANGLE, "unit": "rev", "wrapped": True}]
    (movement,), notes = imported(path, signals=signals)
    assert "1 jumps by whole turns are taken out" in notes


@pytest.mark.parametrize("turns", [1, 16])
def test_counters_of_several_turns_begin_anew(tmp_path, turns):
    angle = 7.3 * turns * TIME + 0.1 * np.sin(40 * TIME)
    path = write(tmp_path / "a.csv", ["t", "q1"], [TIME, (angle + turns / 2) % turns - turns / 2])
    (movement,), _ = imported(path, signals=[{**ANGLE, "unit": "rev"}])
    assert movement.motor_angle[:, 0] == pytest.approx(2 * np.pi * angle)


def test_a_known_delay_is_taken_out(tmp_path):
    late = 0.0033
    columns = [TIME, ANGLES[:, 0], 0.3 * np.sin(9 * (TIME - late))]
    path = write(tmp_path / "a.csv", ["t", "q1", "l1"], columns)
    link = {"column": "l1", "role": "link_angle", "unit": "rad", "delay": late}
    (movement,), notes = imported(path, signals=[ANGLE, link])
    middle = slice(40, -40)
    assert movement.link_angle[middle] == pytest.approx(movement.motor_angle[middle], abs=2e-5)
    assert "l1: interpolated" in notes


def test_tables_with_clocks_of_their_own(tmp_path):
    """The second file is faster and starts later; its values are interpolated."""
    fast = 0.1003 + 0.0007 * np.arange(2000)
    a = write(tmp_path / "a.csv", ["t", "q1"], [TIME, ANGLES[:, 0]])
    b = write(tmp_path / "b.csv", ["t", "tau1"], [fast, 3 * np.cos(5 * fast)])
    torque = {"column": "b:tau1", "role": "motor_torque", "unit": "Nm", "side": "joint"}
    (movement,), notes = imported([a, b], signals=[{**ANGLE, "column": "a:q1"}, torque])
    assert movement.time[0] == pytest.approx(0.104)
    assert movement.time[-1] == pytest.approx(1.496, abs=0.005)
    inside = slice(30, -30)
    assert movement.motor_torque[inside, 0] == pytest.approx(
        3 * np.cos(5 * movement.time[inside]), abs=2e-3
    )
    assert "tau1: interpolated" in notes


def test_interpolation_that_would_err_is_refused(tmp_path):
    rng = np.random.default_rng(1)
    a = write(tmp_path / "a.csv", ["t", "q1"], [TIME, ANGLES[:, 0]])
    b = write(tmp_path / "b.csv", ["t", "tau1"], [TIME + 0.001, rng.standard_normal(N)])
    torque = {"column": "b:tau1", "role": "motor_torque", "unit": "Nm", "side": "joint"}
    with pytest.raises(InvalidInput, match="tau1: interpolation to other samples would err by"):
        imported([a, b], signals=[{**ANGLE, "column": "a:q1"}, torque])


def test_noise_of_a_joint_at_rest_is_interpolated(tmp_path):
    """Beside a joint that moves, it may err; alone, it is refused as any noise."""
    noise = 1e-5 * np.random.default_rng(1).standard_normal(N)
    a = write(tmp_path / "a.csv", ["t", "q1", "q2"], [TIME, *ANGLES.T])
    b = write(tmp_path / "b.csv", ["t", "l1", "l2"], [TIME + 0.001, ANGLES[:, 0], noise])
    angle, link = {**ANGLE, "column": "a:q*"}, {**LINK, "column": "b:l*"}
    (movement,), _ = imported([a, b], signals=[angle, link])
    assert np.abs(movement.link_angle[40:-40, 1]).max() < 1e-4
    with pytest.raises(InvalidInput, match="l2: interpolation to other samples would err by"):
        imported([a, b], signals=[angle, {**link, "column": "b:l2", "joint": "joint_2"}])


@pytest.mark.parametrize("step", [0.8, 1.0, 2.7])
def test_interpolation_is_exact_below_the_band_edge(step):
    rows = np.arange(4000)
    frequencies = np.array([0.05, 0.2, 0.4]) / max(step, 1.0)

    def signal(at):
        return np.sin(2 * np.pi * np.outer(at, frequencies)).sum(axis=1)

    values = signal(rows)
    where = 500.3 + step * np.arange(900)
    result = interpolate(lambda a, b: values[a:b], len(values), where, step)
    assert result == pytest.approx(signal(where), abs=2e-3)
    constant = interpolate(lambda a, b: np.ones(4000)[a:b], 4000, where, step)
    assert constant == pytest.approx(1.0, abs=1e-12)


def test_gaps_part_a_log_and_doubled_rows_go(tmp_path):
    rows = np.r_[0:200, 199:350, 360:500]
    path = write(tmp_path / "a.csv", ["t", "q1"], [TIME[rows], ANGLES[rows, 0]])
    movements, notes = imported(path, signals=[ANGLE])
    assert [len(m) for m in movements] == [350, 140]
    assert movements[1].start == pytest.approx(TIME[360])
    assert movements[0].motor_angle[:, 0] == pytest.approx(ANGLES[:350, 0])
    assert "a gap of 10 missing samples before row 351" in notes
    assert "1 rows repeat a time" in notes


def test_late_stamps_are_jitter_and_no_gaps(tmp_path):
    rng = np.random.default_rng(3)
    stamps = TIME + 0.0005 * rng.standard_normal(N)
    stamps[100] += 0.003  # one that came late, the next is on time
    path = write(tmp_path / "a.csv", ["t", "q1"], [stamps, ANGLES[:, 0]])
    (movement,), notes = imported(path, signals=[ANGLE])
    assert len(movement) == N
    assert movement.sample_time == pytest.approx(STEP, rel=2e-4)
    assert "stamps scatter by 0.5" in notes


def test_counter_iso_stamps_and_sample_time(tmp_path):
    counts = (65000 + np.arange(N)) % 65536
    path = write(tmp_path / "a.csv", ["count", "q1"], [counts, ANGLES[:, 0]])
    for time in ({"counter": "count", "sample_time": STEP}, {"sample_time": STEP}):
        (movement,), _ = imported(path, signals=[ANGLE], time=time)
        assert movement.sample_time == pytest.approx(STEP)
        assert len(movement) == N
    with pytest.raises(InvalidInput, match="no channel has time stamps"):
        imported(path, signals=[ANGLE])


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        ([{**ANGLE, "column": "w*"}], "no channel matches"),
        ([{**ANGLE, "unit": "kelvin"}], "unit 'kelvin' is none of motor_angle"),
        ([{**ANGLE, "unit": "grmpf"}], "unit 'grmpf' is unknown"),
        ([{**ANGLE, "unit": "N*m"}], "is none of motor_angle, which is in rad"),
        ([{**ANGLE, "unit": ""}], "unit is missing"),
        ([{**ANGLE, "side": None}], "side of the gear is missing"),
        ([{**ANGLE, "side": "motor"}], "no gear ratio of joint_1"),
        ([{**ANGLE, "unit": "counts"}], "counts_per_turn is missing"),
        ([{**ANGLE, "unit": "%"}], "full_scale"),
        ([ANGLE, ANGLE], "is both 'q1' and 'q1'"),
        ([{**ANGLE, "joints": ["joint_7", "joint_1"]}], "joint 'joint_7' is unknown"),
        ([{**ANGLE, "joints": ["joint_1"]}], "2 channels"),
    ],
)
def test_mistakes_in_a_mapping(tmp_path, signals, message):
    path = write(tmp_path / "a.csv", ["t", "q1", "q2"], [TIME, *ANGLES.T])
    with pytest.raises(InvalidInput, match=message) as error:
        imported(path, signals=signals)
    assert "\n" not in str(error.value)


def test_absent_coarse_and_saturated_channels_are_told(tmp_path):
    clipped = np.clip(TORQUES[:, 0], -2, 2)
    coarse = np.round(TORQUES[:, 1] * 3) / 3
    path = write(tmp_path / "a.csv", ["t", "q1", "q2", "f1", "f2", "l1", "l2"],
                 [TIME, *ANGLES.T, clipped, coarse, ANGLES[:, 0], 0 * TIME])  # fmt: skip
    torque = {"column": "f*", "role": "motor_torque", "unit": "Nm", "side": "joint"}
    (movement,), notes = imported(path, signals=[ANGLE, torque, LINK])
    assert np.isnan(movement.link_angle[:, 1]).all()
    assert "l2 (link_angle of joint_2): zero throughout; it counts as absent" in notes
    assert "f1 (motor_torque of joint_1)" in notes
    assert "saturated" in notes
    assert "f2 (motor_torque of joint_2): only 12 levels" in notes


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_motors_at_rest_are_measured(tmp_path, angle):
    """Brakes hold a joint: its angle stays, also where it counts from there; its encoder's does."""
    rest = np.full(N, angle)
    path = write(tmp_path / "a.csv", ["t", "q1", "q2", "l1", "l2"],
                 [TIME, ANGLES[:, 0], rest, ANGLES[:, 0], rest])  # fmt: skip
    (movement,), notes = imported(path, signals=[ANGLE, LINK])
    assert (movement.motor_angle[:, 1] == angle).all()
    assert np.isnan(movement.link_angle[:, 1]).all()  # no encoder tells so from a dead one
    assert f"q2 (motor_angle of joint_2): {angle or 'zero'} throughout; nothing moves" in notes


def test_movements_come_back_from_their_file(tmp_path):
    columns = [TIME, *ANGLES.T, TORQUES[:, 0]]
    path = write(tmp_path / "a.csv", ["t", "q1", "q2", "acc"], columns)
    other = {"column": "acc", "role": "accelerometer", "unit": "g", "name": "s1"}
    mapping = Mapping.model_validate({"schema": "import/1", "signals": [ANGLE, other]})
    with open_log(path) as log:
        source = Import(log, mapping, None)
        assert write_import(source, tmp_path / "m.h5") == 1
        (direct,) = [run.read() for run in source.runs]
    (stored,) = iterate_movements(tmp_path / "m.h5")
    save_movements(tmp_path / "n.h5", [stored])
    (again,) = iterate_movements(tmp_path / "n.h5")
    for movement in (stored, again):
        assert np.array_equal(movement.motor_angle, direct.motor_angle)
        assert movement.others["s1"] == pytest.approx(9.80665 * TORQUES[:, 0])
        assert movement.provenance["files"].keys() == {"a.csv"}
        assert movement.provenance["mapping"]["signals"][0]["role"] == "motor_angle"
        assert movement.sample_time == direct.sample_time
    with pytest.raises(InvalidInput, match="link_angle is missing"):
        _ = again.link_angle


def test_clocks_do_not_depend_on_blocks(monkeypatch):
    """Gaps, doubled, missing and late stamps, at the ends of blocks too."""
    rng = np.random.default_rng(5)
    stamps = np.delete(STEP * np.arange(3000), [*range(500, 520), 1999, 2000]) + 7.0
    stamps += 0.0002 * rng.standard_normal(len(stamps))
    stamps = np.insert(stamps, [300, 300, 999], stamps[[299, 299, 998]])
    stamps[[0, 1200, 1201, 2500]] = np.nan
    whole = fitted_clock(stamps, "a", "stamps")
    assert [missing for _, missing in whole.gaps] == [20, 2, 2, 1]  # rows without stamps too
    assert whole.doubled == 3
    for size in (64, 250, 999, 1000):
        monkeypatch.setattr(clock_line, "_BLOCK", size)
        clock = fitted_clock(stamps, "a", "stamps")
        assert np.array_equal(clock.sample_rows(0, len(clock)), whole.sample_rows(0, len(whole)))
        assert clock.segments == whole.segments
        assert clock.sample_time == pytest.approx(whole.sample_time, rel=1e-9)
        assert clock.jitter == pytest.approx(whole.jitter, rel=1e-9)
    with pytest.raises(InvalidInput, match="fewer than three of them rise"):
        fitted_clock(np.zeros(50), "a", "stamps")


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("t", 1.0),
        ("t", 1e3),
        ("time_us", 1e6),
        ("%time", 1e9),
        ("t [ms]", 1e3),
        ("time_100ns", 1e7),
    ],
)
def test_units_of_stamps_are_told(tmp_path, name, scale):
    """By the file, by the name, or because controllers sample at 1 Hz to 100 kHz."""
    stamps = np.round(TIME * scale, 6 if scale == 1 else 0)
    path = write(tmp_path / "a.csv", [name, "q1"], [stamps, ANGLES[:, 0]])
    (movement,), notes = imported(path, signals=[ANGLE])
    assert movement.sample_time == pytest.approx(STEP)
    assert scale == 1 or " in " in notes.splitlines()[0]


@pytest.mark.parametrize(
    ("unit", "role", "factor"),
    [
        ("0.229 rpm", "motor_velocity", 0.229 * 2 * np.pi / 60),
        ("0.001*deg", "motor_angle", 1e-3 * np.pi / 180),
        ("1/min", "motor_velocity", 2 * np.pi / 60),
        ("RPM", "motor_velocity", 2 * np.pi / 60),
        ("Deg", "motor_angle", np.pi / 180),
        ("Grad/s", "motor_velocity", np.pi / 180),
        ("rad/s2", "motor_acceleration", 1.0),
        ("N-m", "motor_torque", 1.0),
        ("Arms", "motor_current", 1.0),
        ("mg", "accelerometer", 9.80665e-3),
    ],
)
def test_units_as_people_and_drives_write_them(unit, role, factor):
    assert unit_factor(unit, role, sliding=False) == pytest.approx(factor, rel=1e-12)


def test_shares_of_full_scale():
    """Drives by CiA 402 tell torques in parts of a thousand."""
    assert full_scale_share("0.1 %") == full_scale_share("‰") == pytest.approx(1e-3)
    assert full_scale_share("N*m") is None
    assert unit_factor("inc/s", "motor_velocity", False, 4096) == pytest.approx(2 * np.pi / 4096)


@pytest.mark.parametrize(
    "unit", ["(", "-Ω)_", "1/0", "²;/s", "bit^21/0", "A **0^2", "m°C ", "None ", "21", "\n", "if"]
)
def test_texts_that_are_no_units(unit):
    """Pint raises all kinds of errors over them, one line is told."""
    with pytest.raises(InvalidInput) as error:
        unit_factor(unit, "motor_angle", sliding=False)
    assert "\n" not in str(error.value)
