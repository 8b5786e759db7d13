"""The rigid bodies of an elastic arm: their inertia, what moves them and what they carry."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robotmodels.elastic.robot import ElasticRobot


@dataclass(frozen=True)
class BodyState:
    """A rigid body between joints, passive torsions and cuts; the payload is part of its last one.

    Attributes
    ----------
    link : str
        Its link of the URDF, the first of several that are fixed to each other.
    part : str
        ``""`` for a whole link, else ``"beyond a3x, a3y"`` with the springs of the cut.
    moved_by : tuple of str
        The torsions and the joint between this body and the one before it, base to tool.
    mass : float, kg
        Mass.
    com : tuple of (float, float, float), m
        Centre of mass in the frame of the joint that moves it.
    moments : tuple of (float, float, float), kg m^2
        Principal moments of inertia about the centre of mass, ascending.
    extent : float, m
        How far it reaches from its joint: twice the distance of its centre of mass, or the distance
        of a neighbouring body's joint, whichever is more.
    carried : float, kg
        Mass of this body and all that it carries.
    """

    link: str
    part: str
    moved_by: tuple[str, ...]
    mass: float
    com: tuple[float, float, float]
    moments: tuple[float, float, float]
    extent: float
    carried: float

    @property
    def name(self) -> str:
        """The link, and which part of it."""
        return f"{self.link} {self.part}".rstrip()

    @property
    def radius_of_gyration(self) -> float:
        """Root of the largest principal moment over the mass [m]."""
        return float(np.sqrt(self.moments[-1] / self.mass))


def bodies(robot: ElasticRobot) -> tuple[BodyState, ...]:
    """Return the bodies, base to tool."""
    model = robot.arm.model
    data = model.createData()
    pin.computeSubtreeMasses(model, data)
    pin.forwardKinematics(model, data, pin.neutral(model))
    return tuple(
        _body(robot, data, joint)
        for joint in range(1, model.njoints)
        if model.inertias[joint].mass > 0
    )


def _body(robot: ElasticRobot, data: pin.Data, joint: int) -> BodyState:
    model, inertia = robot.arm.model, robot.arm.model.inertias[joint]
    moments = np.linalg.eigvalsh(inertia.inertia) + 0.0
    link, part = _link(robot, model.names[joint])
    return BodyState(
        link=link,
        part=part,
        moved_by=tuple(model.names[j] for j in _moved_by(model, joint)),
        mass=float(inertia.mass),
        com=(float(inertia.lever[0]), float(inertia.lever[1]), float(inertia.lever[2])),
        moments=(float(moments[0]), float(moments[1]), float(moments[2])),
        extent=_extent(model, data, joint),
        carried=float(data.mass[joint]),
    )


def _moved_by(model: pin.Model, joint: int) -> list[int]:
    """Return the joints between a body and its parent body, the nearest one last."""
    chain = [joint]
    while (parent := model.parents[chain[0]]) and not model.inertias[parent].mass > 0:
        chain.insert(0, parent)
    return chain


def _extent(model: pin.Model, data: pin.Data, joint: int) -> float:
    """Return how far a body reaches, going by its centre of mass and the joints around it."""
    before = model.parents[_moved_by(model, joint)[0]]
    # A torsion without a body of its own sits where the joint it precedes does.
    after = [j for j in range(1, model.njoints) if model.parents[j] == joint]
    here = data.oMi[joint].translation
    reaches = [float(np.linalg.norm(data.oMi[j].translation - here)) for j in (before, *after)]
    return max(2 * float(np.linalg.norm(model.inertias[joint].lever)), *reaches)


def _link(robot: ElasticRobot, joint: str) -> tuple[str, str]:
    """Return the link that `joint` or the cut of spring `joint` moves, and which part of it."""
    cut = next((s for s in robot.file.springs if s.name == joint and s.link is not None), None)
    if cut is not None:
        cut_point = (cut.link, cut.at)
        springs = [s.name for s in robot.file.springs if (s.link, s.at) == cut_point]
        return str(cut.link), f"beyond {', '.join(springs)}"
    moved = robot.rigid.getJointId(joint)
    links = [f.name for f in robot.rigid.frames if f.parentJoint == moved and f.type == pin.BODY]
    return (links[0] if links else joint), ""
