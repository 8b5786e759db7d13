import numpy as np
import pytest

import robotmodels
from robotmodels import InvalidInput, LinearModel, SolverFailed
from robotmodels.linear.modes import anti_resonances, clamped, damped_modes, resonances, rigid_modes

J, L, K, C = 0.5, 2.0, 800.0, 0.6


def two_masses(stiffness: float = K, damping: float = C, ratio: float = 1.0) -> LinearModel:
    """A motor and a load about one axis."""
    laplacian = np.array([[1.0, -1.0], [-1.0, 1.0]])
    return LinearModel(
        np.diag([J, L]), damping * laplacian, stiffness * laplacian, np.array([[ratio], [0.0]])
    )


@pytest.fixture(scope="module")
def ur10() -> LinearModel:
    """UR10 at three positions, gravity included; one of them with the arm upright."""
    robot = robotmodels.load_robot("ur10")
    positions = [[0.1, -1.5, 0.1, 0.2, 0.3, 0.0], [0, 0.5, -1.0, 1, 1, 1], [0, 0.01, 0.0, 0, 0, 0]]
    return robot.network(np.array(positions, dtype=float)).linear_model()


def one(model: LinearModel, i: int) -> LinearModel:
    return LinearModel(model.mass[i], model.damping[i], model.stiffness[i], model.selector)


def at(model: LinearModel, s: complex) -> np.ndarray:
    """Receptance between the motors at a complex frequency, by a plain solve."""
    A = s**2 * model.mass + s * model.damping + model.stiffness
    return model.selector.T @ np.linalg.solve(A, model.selector + 0j)


def test_two_masses_in_closed_form() -> None:
    model = two_masses(ratio=-60.0)
    reduced = 1 / J + 1 / L
    omega = np.sqrt(K * reduced)
    assert resonances(model).frequencies == pytest.approx([omega])
    assert anti_resonances(model, 0) == pytest.approx([np.sqrt(K / L)])
    assert rigid_modes(model).squares == pytest.approx([0.0], abs=1e-9)
    damped = damped_modes(model)
    assert damped.frequencies == pytest.approx([omega])
    assert damped.damping_ratios == pytest.approx([C * reduced / (2 * omega)])


def test_two_masses_overdamped_keep_both_real_poles() -> None:
    c = 100.0
    reduced = 1 / J + 1 / L
    expected = np.roots([1.0, c * reduced, K * reduced])
    damped = damped_modes(two_masses(damping=c))
    assert np.sort(damped.poles.real) == pytest.approx(np.sort(expected))
    assert damped.damping_ratios == pytest.approx([1.0, 1.0])


def test_mode_shapes_solve_the_eigenproblem_with_unit_modal_mass(ur10: LinearModel) -> None:
    for modes in (resonances(ur10), rigid_modes(ur10)):
        shapes = modes.shapes
        left = ur10.stiffness @ shapes
        right = ur10.mass @ shapes * modes.squares[:, None, :]
        assert np.abs(left - right).max() < 1e-8 * np.abs(ur10.stiffness).max()
        modal = np.swapaxes(shapes, -1, -2) @ ur10.mass @ shapes
        assert np.abs(modal - np.eye(shapes.shape[-1])).max() < 1e-10


def test_one_rigid_mode_per_motor_whatever_gravity_does(ur10: LinearModel) -> None:
    rigid = rigid_modes(ur10).squares
    assert rigid.shape == (3, 6)
    assert (rigid < -1e-3).any()  # an upright arm would fall over
    assert (rigid > 1e-3).any()  # a hanging one swings
    # Without gravity (which acts on the arm alone: motors are coordinates 18 to 23) they rest.
    arm = robotmodels.load_robot("ur10")
    network = arm.network(np.array([[0.1, -1.5, 0.1, 0.2, 0.3, 0.0]]))
    a = network.incidence()
    weightless = LinearModel(
        network.mass[0],
        np.zeros((24, 24)),
        (a.T * network.spring_stiffness[0]) @ a,
        network.selector,
    )
    assert np.abs(rigid_modes(weightless).squares).max() < 1e-5
    heavy = resonances(one(ur10, 0)).frequencies
    assert resonances(weightless).frequencies == pytest.approx(heavy, rel=0.01)


def test_flexible_modes_lie_above_the_arm_with_all_motors_clamped(ur10: LinearModel) -> None:
    held = ur10
    for _ in range(6):
        held = clamped(held, 0)
    lowest = resonances(held).frequencies[:, 0]
    assert resonances(clamped(ur10)).frequencies[:, 0] == pytest.approx(lowest)
    assert (resonances(ur10).frequencies[:, 0] >= lowest * (1 - 1e-9)).all()
    assert (np.abs(rigid_modes(ur10).squares).max(axis=1) < 0.1 * lowest**2).all()


def test_leading_axes_give_the_same_as_one_position_at_a_time(ur10: LinearModel) -> None:
    for i in range(3):
        single = one(ur10, i)
        assert resonances(ur10).frequencies[i] == pytest.approx(resonances(single).frequencies)
        assert anti_resonances(ur10, 4)[i] == pytest.approx(anti_resonances(single, 4))


@pytest.mark.parametrize("motor", range(6))
def test_poles_of_the_clamped_model_are_zeros_of_the_damped_frf(
    ur10: LinearModel, motor: int
) -> None:
    model = one(ur10, 1)
    zeros = damped_modes(clamped(model, motor)).poles
    for s in zeros[:6]:
        nearby = abs(at(model, s * 1.05)[motor, motor])
        assert abs(at(model, s)[motor, motor]) < 1e-7 * nearby


def test_damped_poles_make_the_dynamic_stiffness_singular(ur10: LinearModel) -> None:
    model = one(ur10, 2)
    for s in damped_modes(model).poles:
        A = s**2 * model.mass + s * model.damping + model.stiffness
        scale = np.sqrt(np.abs(np.diag(A)))
        singular = np.linalg.svd(A / np.outer(scale, scale), compute_uv=False)
        assert singular[-1] < 1e-9 * singular[0]


def test_light_damping_leaves_the_frequencies(ur10: LinearModel) -> None:
    model = one(ur10, 0)
    light = LinearModel(model.mass, 1e-4 * model.damping, model.stiffness, model.selector)
    damped = damped_modes(light)
    assert damped.frequencies == pytest.approx(resonances(model).frequencies, rel=1e-6)
    assert (damped.damping_ratios > 0).all()


def test_anti_resonances_are_sign_changes_of_the_undamped_frf() -> None:
    robot = robotmodels.load_robot("manutec_r3")  # joints 4 to 6 are driven rigidly
    model = robotmodels.linearize(robot, np.deg2rad([-60, 20, 90, 0, -110, 0]))
    undamped = LinearModel(model.mass, 0 * model.damping, model.stiffness, model.selector)
    omega = 2 * np.pi * np.arange(3.0, 80.0, 0.01)
    G = undamped.frequency_response(omega)
    for motor in range(6):
        values = G[:, motor, motor].real
        # A sign changes through zero at a zero, through infinity at a pole.
        change = np.flatnonzero(values[1:] * values[:-1] < 0)
        through_zero = change[np.abs(values[change]) < np.abs(values[change - 1])]
        expected = anti_resonances(model, motor)
        distance = np.abs(omega[through_zero][:, None] - expected)
        assert distance.min(axis=1).max() < 0.1  # rad/s; the grid's step is 0.06
        # A zero that all but coincides with a pole may slip through the grid.
        apart = np.abs(expected[:, None] - resonances(model).frequencies).min(axis=1) > 0.5
        assert apart.any()
        assert distance.min(axis=0)[apart].max() < 0.1


def test_motors_held_by_controllers_leave_no_rigid_mode() -> None:
    free = two_masses()
    stiffness = free.stiffness + np.diag([300.0, 0.0])
    held = LinearModel(free.mass, free.damping, stiffness, free.selector)
    squares = np.linalg.eigvals(np.linalg.solve(held.mass, stiffness))
    assert resonances(held, rigid=0).squares == pytest.approx(np.sort(squares))
    assert len(damped_modes(held, rigid=0).poles) == 2


def test_a_falling_mode_has_no_frequency() -> None:
    model = LinearModel(np.eye(1), np.zeros((1, 1)), -np.eye(1), np.eye(1))
    assert rigid_modes(model).squares == pytest.approx([-1.0])
    assert rigid_modes(model).frequencies == pytest.approx([0.0])


@pytest.mark.parametrize("motor", [-1, 1])
def test_unknown_motor(motor: int) -> None:
    with pytest.raises(InvalidInput, match=rf"motor {motor}: the model has motors 0 to 0"):
        anti_resonances(two_masses(), motor)


def test_indefinite_mass() -> None:
    model = two_masses()
    bad = LinearModel(-model.mass, model.damping, model.stiffness, model.selector)
    for answer in (resonances, rigid_modes, damped_modes):
        with pytest.raises(InvalidInput, match="mass matrix is not positive definite"):
            answer(bad)


def test_damped_modes_of_many_positions(ur10: LinearModel) -> None:
    with pytest.raises(InvalidInput, match=r"leading axes \(3,\); linearise one position"):
        damped_modes(ur10)


@pytest.mark.parametrize("rigid", [-1, 3])
def test_impossible_number_of_rigid_modes(rigid: int) -> None:
    with pytest.raises(InvalidInput, match=f"{rigid} rigid modes of 2 coordinates"):
        resonances(two_masses(), rigid)


def test_damped_shapes_solve_the_damped_eigenproblem_with_unit_length(ur10: LinearModel) -> None:
    model = one(ur10, 1)
    modes = damped_modes(model)
    for s, shape in zip(modes.poles, modes.shapes.T, strict=True):
        terms = [s**2 * model.mass @ shape, s * model.damping @ shape, model.stiffness @ shape]
        assert np.abs(sum(terms)).max() < 1e-8 * max(np.abs(t).max() for t in terms)
        assert shape.conj() @ model.mass @ shape == pytest.approx(1.0)


def overdamped_arm(damping: float) -> LinearModel:
    """A motor swinging at 5 rad/s beside a load whose slow pole is at stiffness / damping."""
    return LinearModel(
        np.diag([1.0, 1.0]), np.diag([0.1, damping]), np.diag([25.0, 100.0]), np.eye(2)[:, :1]
    )


def test_an_overdamped_mode_that_leaves_the_rigid_pair_together_is_found() -> None:
    damped = damped_modes(overdamped_arm(damping=24.0))  # roots of s^2 + 24 s + 100
    expected = np.roots([1.0, 24.0, 100.0])
    assert np.sort(damped.poles.real) == pytest.approx(np.sort(expected))


def test_no_conjugate_pair_is_parted() -> None:
    with pytest.raises(SolverFailed, match=r"1 rigid modes would part .* -0\.05 \+- 5j rad/s"):
        damped_modes(overdamped_arm(damping=200.0))  # one pole at about -0.5
