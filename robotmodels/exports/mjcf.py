"""The robot as MJCF: torsions as hinges, gears as tendons, motors as actuators on their shafts."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robotmodels.common.arrays import Array
from robotmodels.description.outputs import Output
from robotmodels.description.urdf_elements import number_text
from robotmodels.elastic.dynamics import gravity_torques
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.exports.formats import sensed_joint
from robotmodels.exports.mjcf_shapes import add_shapes
from robotmodels.linear.modes import resonances
from robotmodels.linear.response import linearize
from robotmodels.simulation.mujoco_model import SENSORS, PlantBuilder
from robotmodels.simulation.urdf_tree import read_tree

_STEPS = 20  # in a period of the fastest mode
_STIFFEST = 0.9999  # impedance of constraints [-]
_LONGEST_STEP = 2e-3  # MuJoCo's own [s]


def mjcf_text(robot: ElasticRobot, positions: Array) -> str:
    """Return the robot as MJCF, with one keyframe at equilibrium for each of `positions` (Q, n).

    Controls are the commanded torques on the motor shafts [N m]; sensors ``m1.position`` and
    ``m1.velocity`` of a motor m1 are on its shaft too. The third number of a sensor on a link is
    along the direction in the robot file, that of a joint's torque sensor along its axis.

    Raises
    ------
    NoEquilibrium
        If a spring is too weak for gravity.
    InvalidInput
        If MuJoCo refuses a body.
    """
    file = robot.file
    builder = PlantBuilder(file, read_tree(robot.model_file), fuse=False)
    model, spec = builder.compile(), builder.spec
    names = [model.joint(i).name for i in range(model.njnt)]
    spec.modelname = robot.name
    spec.option.disableflags = 0  # friction is a constraint
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    add_shapes(spec, robot)
    if file.delay:
        spec.add_numeric(name="delay of all sensors [s]", data=[file.delay])
    fastest = resonances(linearize(robot, positions)).frequencies.max(initial=1.0)
    spec.option.timestep = min(2 * np.pi / fastest / _STEPS, _LONGEST_STEP)
    for equality in spec.equalities:  # as stiff as steps allow
        equality.solref, equality.solimp[:2] = [2 * spec.option.timestep, 1.0], _STIFFEST
    _add_motors(spec, robot, names)
    for output in builder.sensors:
        spec.site(output.label).quat = _third_axis(output.direction)
    for output in file.outputs:
        _add_output(spec, robot, output)
    _add_keyframes(spec, robot, names, positions)
    return _exact(spec.to_xml(), spec.compile())


def _add_keyframes(
    spec: mujoco.MjSpec, robot: ElasticRobot, joints: Sequence[str], positions: Array
) -> None:
    """Add the equilibria at `positions` (Q, n), with the torques that hold the arm there."""
    equilibria = robot.equilibrium(positions).coordinates
    torques = gravity_torques(robot.arm, equilibria)[:, robot.layout.drives]
    scale = np.array([motor.gear_ratio * motor.torque_gain for motor in robot.file.motors])
    arm, arm_names = robot.arm.model, list(robot.arm.model.names)[1:]
    angles = robot.arm.joints(equilibria)
    for i, (position, q, load) in enumerate(zip(positions, angles, torques, strict=True)):
        here = dict(zip(robot.motor_names, position, strict=True))
        here |= {name: q[arm.joints[arm.getJointId(name)].idx_q] for name in arm_names}
        spec.add_key(name=f"position {i}", qpos=[here[n] for n in joints], ctrl=load / scale)


def _add_motors(spec: mujoco.MjSpec, robot: ElasticRobot, joints: Sequence[str]) -> None:
    """Add actuators, their sensors, and the friction of motors and joints."""
    for item in robot.file.friction:
        spec.joint(item.joint).frictionloss = item.coulomb
    for motor, limits in zip(robot.file.motors, robot.position_limits, strict=True):
        shaft = motor.name if motor.name in joints else motor.joint
        hinge = spec.joint(shaft)
        hinge.frictionloss = motor.coulomb * abs(motor.gear_ratio)
        if np.isfinite(limits).all():
            hinge.range, hinge.limited = limits, mujoco.mjtLimited.mjLIMITED_TRUE
        actuator = spec.add_actuator(name=motor.name, target=shaft)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.gear[0], actuator.gainprm[0] = motor.gear_ratio, motor.torque_gain
        for word, kind in (("position", "POS"), ("velocity", "VEL")):
            spec.add_sensor(
                name=f"{motor.name}.{word}",
                type=getattr(mujoco.mjtSensor, f"mjSENS_ACTUATOR{kind}"),
                objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
                objname=motor.name,
            )


def _add_output(spec: mujoco.MjSpec, robot: ElasticRobot, output: Output) -> None:
    """Note what changes a reading; add a joint's encoder, or torque sensor on its drive spring."""
    if not output.ideal:
        channel = [output.gain, output.delay, output.lag]
        spec.add_numeric(name=f"gain, delay [s] and lag [s] of {output.label}", data=channel)
    kinds = {
        "angle": mujoco.mjtSensor.mjSENS_JOINTPOS,
        "velocity": mujoco.mjtSensor.mjSENS_JOINTVEL,
    }
    if output.kind == "joint" and output.quantity in kinds:
        spec.add_sensor(
            name=output.label,
            type=kinds[output.quantity],
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=output.of,
        )
    elif (joint := sensed_joint(robot.file, output)) is not None:
        hinge = spec.joint(joint)
        hinge.parent.add_site(name=output.label, quat=_third_axis(hinge.axis))
        slides = hinge.type == mujoco.mjtJoint.mjJNT_SLIDE
        spec.add_sensor(
            name=output.label,
            type=SENSORS["force" if slides else "torque"],
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=output.label,
        )


def _third_axis(direction: Sequence[float] | Array | None) -> Array:
    """Return the quaternion of a frame whose third axis is along `direction`."""
    turn = Rotation.align_vectors([direction], [[0.0, 0.0, 1.0]])[0]
    return np.asarray(turn.as_quat(scalar_first=True))


def _exact(xml: str, model: mujoco.MjModel) -> str:
    """Return MuJoCo's XML, which has six digits, with the numbers of the compiled model."""
    root = ET.fromstring(xml)
    option = _entry(root, "option")
    option.set("gravity", number_text(model.opt.gravity))
    option.set("timestep", number_text([model.opt.timestep]))
    for body in root.iter("body"):
        _set_body(body, model)
    for tendon in (*root.iter("fixed"), *root.iter("spatial")):
        i = model.tendon(tendon.get("name")).id
        stiffness = model.tendon_stiffness[i], *model.tendon_stiffnesspoly[i]
        _set(tendon, stiffness=stiffness, damping=model.tendon_damping[[i]])
        _set(tendon, springlength=model.tendon_lengthspring[i])
    for actuator in _entry(root, "actuator"):
        it = model.actuator(actuator.get("name"))
        _set(actuator, gear=it.gear, gainprm=it.gainprm[:1])
    for i, equality in enumerate(root.findall("equality/joint")):
        _set(equality, polycoef=model.eq_data[i, :5], solref=model.eq_solref[i])
    for i, key in enumerate(_entry(root, "keyframe")):
        _set(key, qpos=model.key_qpos[i], ctrl=model.key_ctrl[i])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _set_body(body: ET.Element, model: mujoco.MjModel) -> None:
    it = model.body(body.get("name"))
    _set(body, pos=it.pos, quat=it.quat)
    if (inertial := body.find("inertial")) is not None:
        _set(inertial, pos=it.ipos, quat=it.iquat, mass=it.mass, diaginertia=it.inertia)
    for joint in body.findall("joint"):
        _set_joint(joint, model)
    for site in body.findall("site"):
        it = model.site(site.get("name"))
        _set(site, pos=it.pos, quat=it.quat)


def _set_joint(joint: ET.Element, model: mujoco.MjModel) -> None:
    i = model.joint(joint.get("name")).id
    stiffness = model.jnt_stiffness[i], *model.jnt_stiffnesspoly[i]
    _set(joint, axis=model.jnt_axis[i], stiffness=stiffness, damping=model.dof_damping[[i]])
    _set(joint, armature=model.dof_armature[[i]], frictionloss=model.dof_frictionloss[[i]])


def _set(element: ET.Element, **values: Array | Sequence[float]) -> None:
    for key, numbers in values.items():
        element.set(key, number_text(numbers))


def _entry(root: ET.Element, name: str) -> ET.Element:
    entry = root.find(name)
    assert entry is not None, name
    return entry
