"""A robot at a glance, against closed forms; every rule fires where it should and not elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from robots import CRANE, PANDA, PENDULUM, SENSED, SPLIT, built, changed, with_spring

import robotmodels
from robotmodels import InvalidInput
from robotmodels.checks.diagnosis import Diagnosis, diagnose
from robotmodels.checks.warnings import suspicions

MASS, ARM, INERTIA, WEIGHT = 4.0, 0.5, 1.2, 4.0 * 9.81 * 0.5  # of the level pendulum
RATIO, ROTOR, K = 50.0, 1e-3, 5e3
HZ = 2 * np.pi
BENT = np.array([0, 0, 0, -1.5, 0, 1.5, 0])  # of the PANDA


@pytest.fixture(scope="module")
def level() -> Diagnosis:
    return diagnose(built(PENDULUM), np.zeros(1))


@pytest.fixture(scope="module")
def crane() -> Diagnosis:
    return diagnose(built(CRANE), np.array([0.0, 0.0, 0.1, 0.25, 0.0]))


def rules(diagnosis: Diagnosis) -> list[tuple[str, tuple[str, ...]]]:
    return [(s.rule, s.subjects) for s in suspicions(diagnosis)]


def test_the_body_of_a_pendulum(level: Diagnosis) -> None:
    (rod,) = level.bodies
    assert (rod.name, rod.moved_by) == ("rod", ("hinge",))
    assert (rod.mass, rod.carried, rod.com) == (MASS, MASS, (ARM, 0.0, 0.0))
    assert rod.moments == pytest.approx((0.01, 0.2, 0.2))
    assert rod.radius_of_gyration == pytest.approx(np.sqrt(0.2 / MASS))
    assert rod.extent == pytest.approx(1.0)  # its joint is at 1 m above the ground


def test_motor_and_spring_of_a_pendulum_carry_its_weight(level: Diagnosis) -> None:
    (motor,), (spring,) = level.motors, level.springs
    sag = -WEIGHT / K  # to first order
    assert spring.deflection == pytest.approx(sag, rel=1e-4)
    assert spring.torque == pytest.approx(K * spring.deflection)
    assert motor.torque == pytest.approx(WEIGHT / RATIO, rel=1e-4)
    assert motor.reflected == pytest.approx(ROTOR * RATIO**2)
    assert motor.load == pytest.approx(INERTIA)
    assert (motor.spring, motor.prismatic, motor.angle) == ("g", False, 0.0)


def test_modes_of_a_pendulum(level: Diagnosis) -> None:
    reduced = 1 / INERTIA + 1 / (ROTOR * RATIO**2)
    (resonance,), (mode,) = level.resonances, level.modes
    assert resonance == pytest.approx(np.sqrt(K * reduced), rel=1e-3)
    assert mode.frequency == pytest.approx(resonance, rel=1e-3)
    # The mode is (1 / INERTIA, -1 / rotor): 4 N m s/rad between them, 2e-3 * 50^2 on the rotor.
    damping = 4.0 * reduced + 5.0 / (ROTOR * RATIO**2) ** 2 / reduced
    assert mode.damping_ratio == pytest.approx(damping / (2 * resonance), rel=0.005)
    assert mode.energy == (1.0,)
    assert level.motors[0].anti_resonances == pytest.approx([np.sqrt(K / INERTIA)], rel=1e-3)
    assert len(level.rigid_squares) == 1
    assert level.overdamped == ()


def test_gravity_stiffens_a_hanging_pendulum_and_softens_an_upright_one() -> None:
    for angle, sign in ((-np.pi / 2, 1.0), (np.pi / 2, -1.0)):
        (spring,) = diagnose(built(PENDULUM), np.array([angle])).springs
        assert spring.gravity == pytest.approx(sign * WEIGHT)
        assert spring.deflection == pytest.approx(0.0, abs=1e-9)


def test_overdamped_modes_have_two_real_poles() -> None:
    d = diagnose(built(with_spring(PENDULUM, "g", damping=400.0)), np.zeros(1))
    assert d.modes == ()
    assert len(d.overdamped) == 2
    assert len(d.resonances) == 1


def test_every_link_cut_and_payload_is_in_a_body(crane: Diagnosis) -> None:
    by_name = {b.name: b for b in crane.bodies}
    assert by_name["boom beyond az, ay"].moved_by == ("az", "ay")
    assert by_name["floor beyond fz, fx, fy"].moved_by == ("fz", "fx", "fy")
    assert by_name["column"].moved_by == ("btx", "turn")
    moved = [name for b in crane.bodies for name in b.moved_by]
    elastic = [m.name for m in crane.motors if m.spring]
    assert tuple(moved + elastic) == crane.coordinates
    assert crane.bodies[0].carried == pytest.approx(sum(b.mass for b in crane.bodies))
    assert by_name["hand"].mass == pytest.approx(6.0)  # of which 4 kg are payload


def test_each_parameter_is_free_fixed_or_tied(crane: Diagnosis) -> None:
    robot = built(CRANE)
    state = {p.name: (p.state, p.tied_to) for p in crane.parameters}
    assert state["fz.damping"] == ("fixed", None)
    assert state["fy.stiffness"] == ("tied", "fx.stiffness")
    assert state["dl.stiffness.high"] == ("tied", "dw.damping")
    free = tuple(p.name for p in crane.parameters if p.state == "free")
    assert free == robot.parameters.names
    units = {p.name: p.unit for p in crane.parameters}
    assert units["ds.stiffness"] == "N/m"


def test_a_rigid_drive_and_a_prismatic_one(crane: Diagnosis) -> None:
    by_name = {m.name: m for m in crane.motors}
    assert by_name["mn"].spring is None
    slide = by_name["ms"]
    assert slide.prismatic
    assert slide.load == pytest.approx(25.9)  # the carriage and all it carries [kg]
    (spring,) = (s for s in crane.springs if s.name == "ds")
    assert spring.linear
    assert slide.torque * slide.gear_ratio == pytest.approx(-spring.torque)


def test_a_nonlinear_spring_has_its_slope_under_load(crane: Diagnosis) -> None:
    (dt,) = (s for s in crane.springs if s.name == "dt")
    assert dt.unloaded_stiffness == 2e4
    assert dt.stiffness > dt.unloaded_stiffness  # it hardens


def test_sensitivities_of_every_kind_of_parameter() -> None:
    position = np.array([0.2, -1.0, 0.5, 0.1, 0.3, 0.0])
    d = diagnose(built(SENSED), position, (HZ * 5, HZ * 50))
    seen = {p.name: p.sensitivity for p in d.parameters}
    for name in ("m2.inertia", "payload.mass", "a3y.at", "fx.damping"):
        assert seen[name] > 1e-4
    # |d e^{-j omega delay} / d ln delay| is omega delay.
    assert seen["delay"] == pytest.approx(HZ * 50 * 2e-4, rel=1e-6)
    assert d.outputs[-3:] == ("tip", "elbow", "foot")
    assert d.delay == 2e-4


def test_the_order_of_springs_in_a_mode_s_energy() -> None:
    d = diagnose(robotmodels.load_robot("manutec_r3"), np.zeros(6))
    for mode in d.modes:
        assert sum(mode.energy) == pytest.approx(1.0)
        assert min(mode.energy) >= 0
    # Gear by gear: the lowest mode winds up the second, the next one the first.
    assert [int(np.argmax(m.energy)) for m in d.modes] == [1, 0, 2]


@pytest.mark.parametrize("band", [(10.0, 5.0), (0.0, 5.0), (5.0, 5.0), (5.0, np.inf)])
def test_bands_that_are_none(band: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput, match="not rising positive frequencies"):
        diagnose(built(PENDULUM), np.zeros(1), band)


def test_positions_outside() -> None:
    with pytest.raises(InvalidInput, match="'hinge' at 3 is outside its limits"):
        diagnose(built(PENDULUM), np.array([3.0]))


def test_nothing_is_wrong_with_the_pendulum(level: Diagnosis) -> None:
    assert suspicions(level) == ()


def test_modes_beyond_the_band() -> None:
    robot = built(PENDULUM)
    (hertz,) = (w / HZ for w in diagnose(robot, np.zeros(1)).resonances)
    above, below = ((1.0, 0.9 * hertz), (1.1 * hertz, 80.0))
    for side, band in (("above", above), ("below", below)):
        low, high = band
        first, *_ = suspicions(diagnose(robot, np.zeros(1), (HZ * low, HZ * high)))
        assert first.rule == f"mode {side} the band"
        assert f"1 of 1 undamped modes, at {hertz:.3g} Hz, {side}" in first.message


def test_a_spring_nothing_excites_is_named_only_where_it_is_free() -> None:
    robot = robotmodels.load_robot("moberg_axis1")
    assert "nothing excites" not in {s.rule for s in suspicions(diagnose(robot, np.zeros(1)))}
    free = robot.file.model_copy(update={"parameters": type(robot.file.parameters)()})
    d = diagnose(robotmodels.ElasticRobot(free, robot.folder), np.zeros(1))
    assert ("nothing excites", ("g1.stiffness.high",)) in rules(d)


def test_a_tied_spring_is_excited_with_its_group() -> None:
    d = diagnose(built(PANDA), BENT)
    silent = next(s.subjects for s in suspicions(d) if s.rule == "nothing excites")
    assert "d7.stiffness" in silent
    tied = {"tied": [["d7.stiffness", "d6.stiffness"], ["d7.damping", "d6.damping"]]}
    d = diagnose(built(changed(PANDA, parameters=tied)), BENT)
    left = [s.subjects for s in suspicions(d) if s.rule == "nothing excites"]
    assert not any("d7.stiffness" in subjects for subjects in left)


def test_a_weak_spring_sags_and_is_softened() -> None:
    weak = built(with_spring(PENDULUM, "g", stiffness=300.0))
    assert ("large deflection", ("g",)) in rules(diagnose(weak, np.zeros(1)))
    assert ("softened by gravity", ("g",)) in rules(diagnose(weak, np.array([1.5])))
    assert ("softened by gravity", ("g",)) not in rules(diagnose(weak, np.array([-1.5])))


def test_a_motor_much_lighter_or_heavier_than_its_load() -> None:
    for inertia, expected in ((1e-5, True), (1e-3, False), (1e-2, True)):
        motor = PENDULUM["motors"][0] | {"inertia": inertia}
        d = diagnose(built(changed(PENDULUM, motors=[motor])), np.zeros(1))
        assert (("motor inertia", ("m",)) in rules(d)) is expected


@pytest.mark.parametrize(
    ("moments", "words"),
    [
        ((0.1, 0.1, 0.2), None),
        ((0.1, 0.1, 0.201), "exceeds the sum of the other two by 0.5 %"),
        ((0.0, 0.1, 0.1), "lies on a line"),
        ((0.0, 0.0, 0.0), "lies on a point"),
        ((3.0, 3.0, 4.5), "radius of gyration is 1.1 m, more than the body's length, 1 m"),
    ],
)
def test_suspicious_inertia(
    level: Diagnosis, moments: tuple[float, float, float], words: str | None
) -> None:
    body = replace(level.bodies[0], moments=moments)
    messages = [s.message for s in suspicions(replace(level, bodies=(body,)))]
    if words is None:
        assert messages == []
    else:
        assert len(messages) == 1
        assert words in messages[0]


def test_modes_that_cannot_be_told_apart_are_a_warning_not_an_end(
    level: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(model: object) -> None:
        raise robotmodels.SolverFailed("parted")

    monkeypatch.setattr("robotmodels.checks.diagnosis.damped_modes", fails)
    d = diagnose(built(PENDULUM), np.zeros(1))
    assert (d.modes, d.overdamped, d.modes_failed) == ((), (), "parted")
    assert d.resonances == level.resonances
    assert rules(d) == [("overdamped mode", ())]


def test_the_split_arm_has_no_suspicious_body() -> None:
    found = suspicions(diagnose(built(SPLIT), np.array([0.1, -1.0, 0.5, 0.0, 0.2, 0.0])))
    # Two cuts of one link about the same axes are in series.
    assert {s.rule for s in found} <= {"mode above the band", "inseparable"}
